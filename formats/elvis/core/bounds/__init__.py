"""Certified extrema, ranges and zeros of fields and quantities."""
