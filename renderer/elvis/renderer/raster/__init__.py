"""Cameras, pixels and tiles, and the hit buffer.

Every pass may import it.
"""
