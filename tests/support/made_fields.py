"""Datasets with fields that functions give."""

import numpy as np

from elvis import Dataset
from elvis.core.testing import approximated


def data(mesh, **functions):
    """A dataset with fields of degree 4."""
    bare = Dataset(mesh)
    return Dataset(mesh, tuple(approximated(bare, name, own, 5) for name, own in functions.items()))


def constant(value):
    """A field with the same value everywhere."""
    return lambda p: np.full(len(p), float(value))
