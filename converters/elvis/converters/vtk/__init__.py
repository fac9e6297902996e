"""Grids of VTK in all of its forms, read and written."""
