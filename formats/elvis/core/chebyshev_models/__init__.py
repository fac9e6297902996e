"""Chebyshev models: polynomials that approximate quantities over boxes of elements, with proved bounds of their errors.

Modules import only from `elvis.core.polynomials` and `elvis.core.quantities`.
"""
