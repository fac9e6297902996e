"""Meshes and functions of MFEM."""
