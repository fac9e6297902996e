"""Meshes and solutions of PyFR, in its formats of today and before."""
