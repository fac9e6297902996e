"""Cameras, pixels and tiles, and the buffer of what each pixel sees.

May be imported by every pass.
"""
