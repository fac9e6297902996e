"""Integrals over isosurfaces and level lines."""
