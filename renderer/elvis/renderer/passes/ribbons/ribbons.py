"""Ribbons: strips along pieces of curves are drawn into the tiles of the picture that they reach into."""

from __future__ import annotations

from elvis.core.base.arrays import Records
from elvis.core.streamlines.lines.pieces import Pieces
from elvis.core.streamlines.ribbons import Ribbons
from elvis.renderer.passes.pieces.in_view import PiecesInView, part_of
from elvis.renderer.passes.pieces.piece_drawer import PieceDrawer, flattened, greatest_bend


class RibbonDrawer(PieceDrawer[Ribbons]):
    """Intersections of rays with ribbons in a loaded volume; the radius is half their width.

    A hit's element, reference coordinates and value belong to the middle of the ribbon, straight across from it.
    """

    kernel_name, list_name = "ribbon_draw", "strips"

    def pieces_of(self, shown: Ribbons) -> Pieces:
        """Their middle."""
        return shown.pieces

    def fill(self, records: Records, shown: Ribbons, seen: PiecesInView) -> None:
        """The vectors across, and how far the strip may be off: as far as these leave the solution at its edges."""
        across = part_of(shown.across[seen.number], seen.place)
        records["across"] = flattened(across)
        records["swing"] = greatest_bend(across)
        records["deviation"] = shown.pieces.deviation[seen.number]
