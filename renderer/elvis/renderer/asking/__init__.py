"""Requests for pictures, the data they refer to, and defaults that are taken from the data."""
