"""Isosurfaces of fields, of expressions and of distances."""
