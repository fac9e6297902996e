"""Thicknesses of boundary layers, along curves that lead out of a wall (Schlichting, Boundary-Layer Theory, chapter 2).

With the speed u at the height y above the wall, and U at the end of the curve:

    delta99    the smallest y with u = 0.99 U
    delta*     integral of 1 - u/U
    theta      integral of u/U (1 - u/U)
    H          delta* / theta
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.files.columns import Columns
from elvis.core.integrals.curves import Curve
from elvis.core.integrals.integration import integrate
from elvis.core.quantities.evaluator import Sampler
from elvis.core.quantities.expression import Expression

#: part of the speed at the end that is reached at the edge of a layer
EDGE = 0.99
#: equidistant points between which the first crossing is sought, points of each refinement, and refinements
_POINTS, _REFINED, _ROUNDS = 2001, 65, 6
#: requested error of the integrals, relative to the integral of the absolute value
_ERROR = 1e-10


@dataclass(frozen=True, eq=False)
class Layer:
    """The layer along one curve.

    foot          (3,) start of the curve
    edge          speed at its end
    thickness     delta99, NaN if the speed on the wall already reaches the edge value
    displacement  delta*
    momentum      theta
    remarks       messages about undefined values, or values less precise than requested
    """

    foot: Floats
    edge: float
    thickness: float
    displacement: float
    momentum: float
    remarks: tuple[str, ...] = ()

    @property
    def shape(self) -> float:
        """H."""
        return self.displacement / self.momentum if self.momentum else np.nan


def boundary_layer(dataset: Dataset, curve: str, speed: str) -> Layer:
    """The layer of a speed along a curve.

    Parameters
    ----------
    dataset : Dataset
        The solution.
    curve : str
        A curve from the wall to the outer flow, such as ``normal:wall:0.5,0.1,0:0.2``.
    speed : str
        A field or expression, the speed along the wall.

    Raises
    ------
    ElvisError
        If the text is not a curve, or the speed is zero or unknown at its end.

    Notes
    -----
    delta99 is the first crossing between 2001 even points of the curve, refined to rounding.

    Examples
    --------
    >>> boundary_layer(ds, "normal:plate:0.5,0.1:0.1", "u").shape  # doctest: +SKIP
    """
    along = Curve.parse(dataset, curve)
    if along is None:
        raise ElvisError(f"expected a curve that starts at a wall, such as normal:wall:0.5,0.1:0.2, found {curve!r}")
    texts = [f"{name}_thickness({speed})" for name in ("displacement", "momentum")]
    found = integrate(dataset, texts, curve, _ERROR)
    displacement, momentum = (found.of(text).value for text in texts)
    speeds = _Speeds(dataset, along, speed)
    edge = float(speeds.at(np.array([along.length]))[0])
    thickness = speeds.crossing(EDGE * edge)
    remarks = list(found.remarks)
    if np.isnan(thickness):
        remarks.append(f"{curve}: {speed} on the wall is {EDGE} of that at the end or more; delta99 is unknown")
    return Layer(along.at(np.zeros(1))[0][0], edge, thickness, displacement, momentum, tuple(remarks))


def boundary_layers(dataset: Dataset, curves: Sequence[str], speed: str) -> tuple[Columns, list[str]]:
    """A table of layers along curves, a row for each, and sentences on them.

    Columns: point, along, x, y, z of the foot, edge, delta99, displacement, momentum, shape.
    """
    layers = [boundary_layer(dataset, curve, speed) for curve in curves]
    columns: dict[str, NDArray[np.generic]] = {"point": np.arange(len(layers)), "along": np.array(curves)}
    columns |= dict(zip("xyz", np.array([own.foot for own in layers]).T, strict=True))
    numbers = {"edge": "edge", "delta99": "thickness", "displacement": "displacement", "momentum": "momentum"}
    for name, attribute in (*numbers.items(), ("shape", "shape")):
        columns[name] = np.array([getattr(own, attribute) for own in layers])
    return columns, [remark for own in layers for remark in own.remarks]


class _Speeds:
    """A speed by the length of a curve."""

    def __init__(self, dataset: Dataset, curve: Curve, speed: str) -> None:
        self._curve, self._sampler = curve, Sampler(dataset, [Expression.of(dataset, speed)])

    def at(self, lengths: Floats) -> Floats:
        """(n,) at lengths (n,)."""
        points = self._curve.at(self._curve.parameters_at(lengths))[0]
        return self._sampler.sample(points).values[:, 0]

    def crossing(self, value: float) -> float:
        """The first length at which the speed has a value; NaN if it begins beyond."""
        lengths = np.linspace(0.0, self._curve.length, _POINTS)
        for _ in range(_ROUNDS):
            is_beyond = self.at(lengths) / value >= 1
            if is_beyond[0] or not is_beyond.any():
                return float(np.nan)
            first = int(is_beyond.argmax())
            lengths = np.linspace(lengths[first - 1], lengths[first], _REFINED)
        return float(lengths.mean())
