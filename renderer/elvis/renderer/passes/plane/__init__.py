"""Plane cuts: each element is drawn into the pixels of its section."""
