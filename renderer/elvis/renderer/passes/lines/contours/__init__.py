"""Contours on faces, cuts and pyramids, and proofs of the pixels that they cross."""
