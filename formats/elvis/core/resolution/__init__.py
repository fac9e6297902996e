"""Resolution of fields: modal spectra on each shape, decay rates, truncated fields, and estimates of the error."""
