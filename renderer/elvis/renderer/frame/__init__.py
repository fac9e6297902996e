"""One picture from the scene to its pixels: stages, shading, painting, and geometries next to the data."""
