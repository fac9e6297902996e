"""Meshes and data of Gmsh, read and written."""
