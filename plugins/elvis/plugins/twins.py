"""Elements of a runtime plugin in NumPy: where a part says its shape and gives `Part.evaluate`, all else follows.

Points are those of the shape in `elvis.formats.shapes`, whatever coordinates the plugin takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.formats.shapes import Shape
from elvis.plugins.volume import Part, Volume

#: distance of the points that derivatives are made of: the error is some 1e-11 of what is smooth over an element
_STEP = 0.02
#: monomials of a polynomial through seven points, from its values there
_THROUGH = np.linalg.inv(np.vander(np.arange(-3.0, 4.0), increasing=True))


@dataclass(frozen=True, eq=False)
class Twin:
    """The elements of a part."""

    part: Part
    shape: Shape

    def __len__(self) -> int:
        return len(self.part)

    def evaluated(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World positions (n, 3) and values (n,) in elements ``rows`` (n,) at points (n, d)."""
        assert self.part.evaluate is not None
        own = np.zeros((len(points), 3))
        own[:, : self.shape.dimension] = (1 + points) / 2 if self.part.unit else points
        positions, values = self.part.evaluate(rows, own)
        return np.asarray(positions, np.float64), np.asarray(values, np.float64)

    def slopes(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """Derivatives of positions (n, 3, d) and values (n, d); see `slopes_of`."""
        every = slopes_of(lambda rows, points: np.column_stack(self.evaluated(rows, points)), rows, points)
        return every[:, :3], every[:, 3]


def slopes_of(function: Callable[[Ints, Floats], Floats], rows: Ints, points: Floats) -> Floats:
    """(n, …, d) derivatives of a function of elements (n,) and points (n, d), which gives (n, …).

    They are those of polynomials of degree 6 through points nearby, in [-1, 1]^d.
    """
    found = []
    for axis in range(points.shape[1]):
        middle = np.clip(points[:, axis], -1 + 3 * _STEP, 1 - 3 * _STEP)
        place = (points[:, axis] - middle) / _STEP
        weights = place[:, None] ** np.arange(6) * np.arange(1, 7) @ _THROUGH[1:] / _STEP
        near = np.repeat(points, 7, axis=0)
        near[:, axis] = (middle[:, None] + _STEP * np.arange(-3, 4)).ravel()
        values = function(np.repeat(rows, 7), near)
        found.append(np.einsum("nk,nk...->n...", weights, values.reshape(-1, 7, *values.shape[1:])))
    return np.stack(found, axis=-1)


def twins_of(volume: Volume) -> list[Twin] | None:
    """The elements of each part; None where there is none, or one doesn't say its shape or has no `evaluate`."""
    found = [Twin(part, part.shape) for part in volume.parts if part.shape is not None and part.evaluate is not None]
    return found if found and len(found) == len(volume.parts) else None
