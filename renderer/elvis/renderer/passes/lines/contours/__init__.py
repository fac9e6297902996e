"""Contours on faces, cuts and pyramids, and the proof of which pixels they pass."""
