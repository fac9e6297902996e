"""Chebyshev models: polynomials that stand for quantities over boxes of elements, with proved bounds of what they lack.

Modules import from `elvis.core.polynomials` and `elvis.core.quantities` alone.
"""
