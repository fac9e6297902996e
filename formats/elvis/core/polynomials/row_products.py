"""Products of many rows with one small matrix, in which no row depends on how many others there are."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats

#: rows that are multiplied together
_ROWS = 32


def row_products(rows: Floats, matrix: Floats) -> Floats:
    """(..., k) the rows (..., m), each times the matrix (m, k).

    BLAS sums in a different order if a matrix has few rows, or one, than if it has many: results of an element would
    depend on the other elements in the call.  The product is therefore taken in blocks of one size, the last padded
    with zeros.
    """
    flat = np.ascontiguousarray(rows).reshape(-1, rows.shape[-1])
    products = np.empty((len(flat), matrix.shape[1]))
    whole = len(flat) // _ROWS * _ROWS
    np.matmul(_blocks(flat[:whole]), matrix, out=_blocks(products[:whole]))
    if whole < len(flat):
        last = np.zeros((_ROWS, rows.shape[-1]))
        last[: len(flat) - whole] = flat[whole:]
        products[whole:] = (_blocks(last) @ matrix)[0, : len(flat) - whole]
    return products.reshape(*rows.shape[:-1], matrix.shape[1])


def _blocks(rows: Floats) -> Floats:
    """(b, _ROWS, m) whole blocks of rows; the same memory."""
    return rows.reshape(-1, _ROWS, rows.shape[-1])
