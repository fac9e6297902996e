"""Blocks of converters' sources."""

import numpy as np


def where(source, elements):
    """(2, n) block and row of each element."""
    places = {int(i): (b, row) for b, block in enumerate(source.blocks) for row, i in enumerate(block.ids)}
    return np.array([places[int(i)] for i in elements]).T
