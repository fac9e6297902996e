"""Functions on the unit cube that are small against an offset."""

import numpy as np

from elvis import Dataset
from elvis.core.data.dataset import Block, Field
from elvis.core.testing import grid, with_field


def exact(shape, function, scale=1.0, offset=0.0, cells=1):
    """A function on the unit cube, times a scale, and an offset: coefficients of few binary digits."""
    mesh, modes = grid(shape, cells), []
    for own in (function, lambda p: np.ones(len(p))):
        block = with_field(mesh, own, 4).fields[0].blocks[0]
        modes.append(np.rint(block.coefficients * 2.0**20) / 2.0**20)
    values = scale * modes[0] + offset * modes[1]
    return Dataset(mesh, (Field("u", (Block(block.expansion, block.element_ids, values),)),))
