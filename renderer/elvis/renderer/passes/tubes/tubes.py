"""Tubes about curves: pieces of curves are drawn into the tiles of the picture that their tubes reach into."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Ints, Records
from elvis.core.streamlines.lines.pieces import Pieces
from elvis.renderer.device.device import Kernel
from elvis.renderer.passes.pieces.in_view import PiecesInView
from elvis.renderer.passes.pieces.piece_drawer import PieceDrawer

#: number of listed curves that have a ball together (tube_draw.slang)
GROUP_SIZE = 16


class TubeDrawer(PieceDrawer[Pieces]):
    """First points where rays enter or leave tubes in a loaded volume.

    A hit's element, reference coordinates and value belong to the point of the curve whose ball is hit.
    """

    kernel_name, list_name = "tube_draw", "curves"

    def pieces_of(self, shown: Pieces) -> Pieces:
        """They are that."""
        return shown

    def fill(self, records: Records, shown: Pieces, seen: PiecesInView) -> None:
        """How far curves may be off, and how far their points are from their middles."""
        records["deviation"] = shown.deviation[seen.number]
        # |P(u) - P(0)| is at most the sum of the lengths of all other coefficients
        records["reach"] = np.linalg.norm(seen.points[:, 1:], axis=2).sum(axis=1)

    def around(self, kernel: Kernel, records: Records, listed: Ints) -> dict[str, Records]:
        """Balls around groups of listed curves, by which rays skip them together.

        Thousands of short pieces share tiles where lines nearly come to rest.
        """
        groups = np.zeros(max(1, len(listed) // GROUP_SIZE), kernel.dtype("groups"))
        numbers = listed[: len(listed) // GROUP_SIZE * GROUP_SIZE].reshape(-1, GROUP_SIZE)
        centres = np.ascontiguousarray(records["points"][:, :3])[numbers]
        middle = centres.mean(axis=1)
        distance = np.linalg.norm(centres - middle[:, None], axis=2)
        for axis, name in enumerate("xyz"):
            groups[name][: len(numbers)] = middle[:, axis]
        groups["reach"][: len(numbers)] = (1.0 + 1e-12) * (distance + records["reach"][numbers]).max(axis=1)
        groups["deviation"][: len(numbers)] = records["deviation"][numbers].max(axis=1)
        return {"groups": groups}
