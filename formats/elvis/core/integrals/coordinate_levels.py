"""Clips that depend on coordinates alone, at points that belong to no element."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.levels.of_elements import Level
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, fold


def coordinate_clip(dataset: Dataset, clip: str) -> Node:
    """The expression that is negative where a clip leaves the data.

    clip  ``plane:P:N``, ``sphere:C:R`` or ``cylinder:P:A:R``, whose inside is cut away, or its outside with the prefix
          ``outside:``

    Raises ElvisError for clips that depend on more than coordinates.
    """
    level = Level.clip(dataset, clip).expression
    if any(leaf.op != "coordinate" for leaf in level.leaves):
        raise ElvisError(f"--clip: expected plane:P:N, sphere:C:R or cylinder:P:A:R, found {clip!r}")
    return level.root


def heights(root: Node, points: Floats) -> Floats:
    """(n,) values of an expression of coordinates at points (n, 3)."""

    def leaf(node: Node) -> Floats | float:
        return node.value if node.op == "number" else points[:, node.axes[0]]

    return np.broadcast_to(fold(root, leaf, lambda node, parts: function(node).numpy(*parts)), len(points))
