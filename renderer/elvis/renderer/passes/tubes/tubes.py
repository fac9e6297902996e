"""Tubes about curves: pieces of curves are drawn into the tiles of the picture that their tubes reach into."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from elvis.core.streamlines.line_pieces import Pieces
from elvis.renderer.piece_drawer import PieceDrawer
from elvis.renderer.pieces_in_view import PiecesInView


class TubeDrawer(PieceDrawer[Pieces]):
    """Tubes in a loaded volume: where rays first enter or leave them.

    A hit's element, reference coordinates and value are those of the curve's point whose ball is met.
    """

    kernel_name, list_name = "tube_draw", "curves"

    def pieces_of(self, shown: Pieces) -> Pieces:
        """They are that."""
        return shown

    def fill(self, records: NDArray[Any], shown: Pieces, seen: PiecesInView) -> None:
        """How far curves may be off."""
        records["deviation"] = shown.deviation[seen.number]
