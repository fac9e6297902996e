"""Streamlines of many seeds, followed on the device (the twin of elvis.core.streamlines.tracer)."""
