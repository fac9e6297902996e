"""Datasets from files of any kind, and what is chosen or derived before a command works on them."""
