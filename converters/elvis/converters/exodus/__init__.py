"""Exodus files: whole meshes, and the pieces of parallel runs."""
