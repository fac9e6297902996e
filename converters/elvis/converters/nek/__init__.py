"""Files of Nek5000, NekRS and Neko."""
