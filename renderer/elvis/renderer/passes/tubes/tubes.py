"""Tubes about curves: pieces of curves are drawn into the tiles of the picture that their tubes reach into."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Records
from elvis.core.streamlines.line_pieces import Pieces
from elvis.renderer.piece_drawer import PieceDrawer
from elvis.renderer.pieces_in_view import PiecesInView


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
