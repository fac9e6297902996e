"""Contours and mesh lines on the results of the other passes, and proofs about them."""
