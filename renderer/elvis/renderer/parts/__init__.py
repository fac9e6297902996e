"""Data that are drawn in parts: bricks, bands of pixels, parts of ranks, and only the elements that a picture needs."""
