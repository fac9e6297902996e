"""Data on a device: elements, where points lie in them, and values at points."""
