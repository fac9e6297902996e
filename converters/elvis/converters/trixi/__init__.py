"""Meshes and solutions of Trixi.jl, and of HOHQMesh, whose meshes it takes."""
