"""Meshes, blocks, fields and datasets, moments of a series, and arguments that select data."""
