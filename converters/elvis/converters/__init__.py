"""Other solvers' files into the native format: one module a format, each a conversion plugin."""
