"""Curves on walls as parts of integrals: forces count per unit of span, all else per unit of length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.along_curves import CurvePiece, Values
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.wall_curves.curve import WallCurve, curves_with


@dataclass(frozen=True, eq=False)
class WallPiece(CurvePiece):
    """A curve on a wall.

    wall   the curve with the sides that it is on
    loads  (m,) numbers of the expressions that are forces on the wall
    """

    wall: WallCurve
    loads: Ints

    @property
    def has_normals(self) -> bool:
        """Always."""
        return True

    @property
    def intervals(self) -> int:
        """Values are smooth in each segment."""
        return 1

    def values(self, evaluator: Evaluator, expressions: Sequence[Expression]) -> Values:
        """Values of expressions along the curve.

        With s the distance along the unit normal N of the section's plane, a force has the density

            dF/ds = integral of f / |grad s on the wall| dl,    |grad s on the wall| = sqrt(1 - (n . N)^2),

        n the wall's normal, by the coarea formula (Federer, Geometric Measure Theory, 3.2.12).
        """
        plane = self.wall.plane

        def at(t: Floats) -> Floats:
            found = self.wall.values(evaluator, expressions, t, t)
            if plane is not None and len(self.loads):
                across = found.normals @ plane[1]
                with np.errstate(divide="ignore"):
                    found.values[:, self.loads] /= np.sqrt(np.maximum(0.0, 1 - across**2))[:, None]
            return found.values

        return at


def wall_pieces(dataset: Dataset, name: str, evaluator: Evaluator, loads: Sequence[bool]) -> tuple[WallPiece, ...]:
    """The curves of a name as parts of integrals; ``loads`` says which expressions are forces."""
    numbers = np.flatnonzero(loads)
    return tuple(
        WallPiece(wall.curve, evaluator.patches, wall, numbers) for wall in curves_with(dataset, name, evaluator)
    )
