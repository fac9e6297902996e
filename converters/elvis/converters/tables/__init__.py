"""Exports to tables: points, lattices of Tecplot, triangles."""
