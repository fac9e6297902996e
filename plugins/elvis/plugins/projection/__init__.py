"""Conversion of samples to the native format: numbering, projection, traces, curves, errors."""
