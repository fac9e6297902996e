"""Streamlines, ribbons and arrows of a picture."""
