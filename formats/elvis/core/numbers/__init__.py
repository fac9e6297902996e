"""Numbers of a dataset: norms, samples, histograms, spectra, the quality of its mesh."""
