"""Conversion plugins: what they tell (``plugin``), how they are found, run, checked, reported and kept.

The projection below does the mathematics.
"""
