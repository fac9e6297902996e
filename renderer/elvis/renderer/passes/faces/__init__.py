"""Curved faces: patches of them are drawn into the pixels that they may cover."""
