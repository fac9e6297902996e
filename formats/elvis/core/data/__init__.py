"""Datasets and what they consist of.

It imports the shapes, the polynomials and ``base``.
"""
