"""Surfaces in space that cut the data: spheres, cylinders, cones, triangle meshes."""
