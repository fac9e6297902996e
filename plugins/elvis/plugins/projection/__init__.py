"""From samples to the native format: numbering, projection, traces, curves, errors."""
