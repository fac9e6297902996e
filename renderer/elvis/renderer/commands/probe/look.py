"""How ``elvis probe`` plots values along a curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.files.columns import Columns
    from elvis.scene.figure.time_plot import Plot, Profiles

#: columns that are not quantities
_PLACES = ("along", "curve", "point", "length", "x/c", "x", "y", "z", "nx", "ny", "nz", "element", "status")
#: of these the ones that nothing is plotted over
_NUMBERS = ("along", "point", "curve", "element", "status")


@dataclass(frozen=True)
class Look:
    """How values along a curve are plotted.

    abscissa     the column that they are plotted over; None for the length
    is_reversed  whether values grow downwards
    overlays     tables of measured points, as FILE.csv or FILE.csv:X,Y
    profiles     whether curves are profiles above their first points, and the abscissas per unit of a value; None for
                 curves that are not, 0 for a scale that suits the stations
    """

    abscissa: str | None = None
    is_reversed: bool = False
    overlays: tuple[str, ...] = ()
    profiles: float | None = None

    def along(self, columns: Columns) -> Plot | Profiles:
        """The plot of a table, as `_over` or as profiles."""
        if self.profiles is None:
            return self._over(columns)
        import numpy as np

        from elvis.scene.figure.time_plot import Profiles

        curve = np.asarray(columns.get("curve", np.zeros(len(columns["point"]))))
        parts = [np.flatnonzero(curve == number) for number in np.unique(curve)]
        names = [name for name in columns if name not in _PLACES]
        return Profiles(
            np.array([columns["x"][rows[0]] for rows in parts], np.float64),
            [np.asarray(columns["length"][rows], np.float64) for rows in parts],
            {name: [np.asarray(columns[name][rows], np.float64) for rows in parts] for name in names},
            self.profiles or None,
        )

    def _over(self, columns: Columns) -> Plot:
        """The plot of a table; ElvisError for an abscissa that it does not have, and for tables that can't be read."""
        import numpy as np

        from elvis.core.numbers.queries import pairs_in_table
        from elvis.scene.figure.time_plot import Plot

        over = self.abscissa or ("length" if "length" in columns else "x")
        if over not in columns or over in _NUMBERS:
            known = [name for name in columns if name not in _NUMBERS]
            raise ElvisError(f"--x: there is no column {over!r}{perhaps(over, known)}; there are {', '.join(known)}")
        curve = np.asarray(columns.get("curve", np.zeros(len(columns["point"]))))
        breaks = np.flatnonzero(np.diff(curve)) + 1
        # boundary layers have a row for each curve, and one line joins them
        names = np.asarray(columns["along"]) if "along" in columns and "length" in columns else None
        places = [""] if names is None else list(dict.fromkeys(names.tolist()))
        own = [np.ones(len(curve), bool)] if names is None else [names == place for place in places]

        def apart(column: Floats) -> Floats:
            """A column with a gap between curves."""
            return np.insert(column, breaks, np.nan)

        def lines(name: str) -> Floats:
            """(places, n) values, NaN on the curves of other places."""
            return np.stack([apart(np.where(here, np.asarray(columns[name], np.float64), np.nan)) for here in own])

        values = {name: lines(name) for name in columns if name not in (*_PLACES, over)}
        overlays = {Path(text.partition(":")[0]).name: pairs_in_table(text) for text in self.overlays}
        return Plot(apart(np.asarray(columns[over], np.float64)), places, values, over, self.is_reversed, overlays)
