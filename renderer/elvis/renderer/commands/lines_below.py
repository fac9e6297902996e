"""Streamlines compared with those of the fields without their highest modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elvis.core.base.arrays import Bools, Floats
    from elvis.core.streamlines import TracedLines


@dataclass(frozen=True, eq=False)
class LinesBelow:
    """Streamlines of truncated fields, from the same seeds.

    label  the order of the fields in words
    """

    label: str
    lines: TracedLines

    def distances(self, whole: TracedLines) -> Floats:
        """(n,) distance between the ends of each pair of lines; NaN for lines without points."""
        import numpy as np

        return np.asarray(np.linalg.norm(_last(whole.points, whole) - _last(self.lines.points, self.lines), axis=1))

    def facts(self, whole: TracedLines) -> dict[str, Any]:
        """Ends and lengths of the lines of truncated fields, and the distances between the ends of pairs."""
        lengths = _last(self.lines.length[:, None], self.lines)[:, 0]
        return {
            "without_top_modes": {
                "ends": self.lines.counts(),
                "lengths": lengths.tolist(),
                "distances": self.distances(whole).tolist(),
                "other_ends": int(self._ends_differ(whole).sum()),
            }
        }

    def sentence(self, whole: TracedLines) -> str:
        """The differences in words."""
        import numpy as np

        known = self.distances(whole)
        known = known[np.isfinite(known)]
        if not len(known):
            return f"{self.label}: no line has an end"
        moved = f"ends move by up to {known.max():.4g}, by {np.median(known):.4g} in the median"
        return (
            f"{self.label}: {moved}; {int(self._ends_differ(whole).sum())} of {len(whole)} lines end for other reasons"
        )

    def _ends_differ(self, whole: TracedLines) -> Bools:
        """(n,) whether the two lines of a pair end for different reasons."""
        import numpy as np

        pairs = zip(whole.end, self.lines.end, strict=True)
        return np.array([whole.ends[one] != self.lines.ends[other] for one, other in pairs], bool)


def _last(values: Floats, lines: TracedLines) -> Floats:
    """(n, k) values (m, k) at the last points of lines; NaN for lines without points."""
    import numpy as np

    found = np.full((len(lines), values.shape[1]), np.nan)
    held = np.diff(lines.offsets) > 0
    found[held] = values[lines.offsets[1:][held] - 1]
    return found
