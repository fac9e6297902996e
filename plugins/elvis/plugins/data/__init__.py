"""Datasets from files of any kind, and the selections and derived fields that commands start from."""
