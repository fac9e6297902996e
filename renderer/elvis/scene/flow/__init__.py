"""Streamlines of a scene, before anything is drawn."""
