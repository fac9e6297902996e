"""One picture from the scene to its pixels: stages, shading, painting, and what is drawn next to the data."""
