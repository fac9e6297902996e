"""How ``elvis probe`` plots values along a curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from elvis.core.errors import ElvisError
from elvis.core.hints import perhaps

if TYPE_CHECKING:
    from elvis.core.arrays import Floats
    from elvis.core.files.columns import Columns
    from elvis.scene.time_plot import Plot

#: columns that are no quantities
_PLACES = ("curve", "point", "length", "x/c", "x", "y", "z", "nx", "ny", "nz", "element", "status")


@dataclass(frozen=True)
class Look:
    """How values along a curve are plotted.

    abscissa     the column that they are plotted over; None for the length
    is_reversed  whether values grow downwards
    overlays     tables of measured points, as FILE.csv or FILE.csv:X,Y
    """

    abscissa: str | None = None
    is_reversed: bool = False
    overlays: tuple[str, ...] = ()

    def along(self, columns: Columns) -> Plot:
        """The plot of a table; ElvisError for an abscissa that it does not have, and for tables that can't be read."""
        import numpy as np

        from elvis.core.queries import pairs_in_table
        from elvis.scene.time_plot import Plot

        over = self.abscissa or "length"
        if over not in columns or over in ("point", "element", "status"):
            known = [name for name in columns if name not in ("point", "curve", "element", "status")]
            raise ElvisError(f"--x: there is no column {over!r}{perhaps(over, known)}; there are {', '.join(known)}")
        curve = np.asarray(columns.get("curve", np.zeros(len(columns["point"]))))
        breaks = np.flatnonzero(np.diff(curve)) + 1

        def apart(name: str) -> Floats:
            """A column with a gap between curves."""
            return np.insert(np.asarray(columns[name], np.float64), breaks, np.nan)

        values = {name: apart(name)[None] for name in columns if name not in (*_PLACES, over)}
        overlays = {Path(text.partition(":")[0]).name: pairs_in_table(text) for text in self.overlays}
        return Plot(apart(over), [""], values, over, self.is_reversed, overlays)
