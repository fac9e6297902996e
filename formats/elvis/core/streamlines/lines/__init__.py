"""Pieces and steps of traced lines, and files of them."""
