"""The curves among the names of targets: in the world, and on walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.along_curves import CurvePiece
from elvis.core.integrals.curves import KINDS, Curve
from elvis.core.integrals.integrands import Integrand
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.wall_curves.curve import SECTION
from elvis.core.wall_curves.pieces import wall_pieces


@dataclass(frozen=True, eq=False)
class LineTargets:
    """Curves by their names.

    curves    in the world
    sections  of walls with planes
    """

    curves: Mapping[str, Curve]
    sections: Sequence[str]

    @staticmethod
    def of(dataset: Dataset, names: Sequence[str]) -> LineTargets:
        """Curves among names of targets; raises ElvisError for an invalid curve."""
        curves = {name: curve for name in names if (curve := Curve.parse(dataset, name)) is not None}
        return LineTargets(curves, [name for name in names if name.partition(":")[0] == SECTION])

    def __contains__(self, name: str) -> bool:
        return name in self.curves or name in self.sections

    def __len__(self) -> int:
        return len(self.curves) + len(self.sections)

    def end(self, names: Sequence[str]) -> Floats | None:
        """(3,) the end of the curve that is the only one of some names, None for others."""
        return self.curves[names[0]].end if len(names) == 1 and names[0] in self.curves else None

    def pieces(
        self, dataset: Dataset, evaluator: Evaluator, wanted: Sequence[Integrand]
    ) -> dict[str, tuple[CurvePiece, ...]]:
        """Pieces that integrals are taken over, by name."""
        loads = [each.is_load for each in wanted]
        found = {name: (CurvePiece(curve, evaluator.patches),) for name, curve in self.curves.items()}
        return found | {name: wall_pieces(dataset, name, evaluator, loads) for name in self.sections}


def is_line(name: str) -> bool:
    """Whether a name denotes a curve."""
    kind, colon, _ = name.partition(":")
    return bool(colon) and kind in (*KINDS, SECTION)
