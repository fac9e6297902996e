"""Devices, their memory and their kernels.

May be imported by everything here; it knows no scene.
"""
