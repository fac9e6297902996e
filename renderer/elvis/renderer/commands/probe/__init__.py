"""``elvis probe``: values at points and along curves, their plots and spectra."""
