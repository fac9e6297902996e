"""Contours and mesh lines on what the other passes have drawn, and what is proved of them."""
