"""Curves in the world, from their names: where they are, and places along them by length.

line:P:Q            from P to Q; a point is X,Y or X,Y,Z
polyline:P:Q:R:…    straight from each point to the next
circle:C:N:R        with centre C, normal N and radius R
spline:P:Q:R:…      the natural cubic spline through points, by the distances of these
normal:B:P:L        of length L, along the normal of boundary B at its place nearest to P: towards P, or into the data
                    if P lies on the boundary or outside the data
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.distances import nearest, surface_of, vectors_away
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.quadrature import gauss

KINDS = ("line", "polyline", "circle", "spline", "normal")
_FORMS = {
    "line": "line:P:Q",
    "polyline": "polyline:P:Q:R",
    "circle": "circle:CENTRE:NORMAL:RADIUS",
    "spline": "spline:P:Q:R",
    "normal": "normal:BOUNDARY:POINT:LENGTH",
}
#: Gauss points in each interval of a part of a curve, by which lengths are found
_POINTS = 8


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve x(t), t from 0 to ``parts``, smooth between whole numbers.

    at         points (n, 3) and derivatives (n, 3) at parameters (n,)
    intervals  in each part, by which lengths are found
    """

    name: str
    parts: int
    at: Callable[[Floats], tuple[Floats, Floats]]
    intervals: int = 64

    @staticmethod
    def parse(dataset: Dataset, name: str) -> Curve | None:
        """The curve that a name says; None for other names, ElvisError for wrong ones."""
        kind, colon, rest = name.partition(":")
        if not colon or kind not in KINDS:
            return None
        texts = rest.split(":")
        try:
            return _made(dataset, name, kind, texts)
        except ValueError:
            raise ElvisError(f"expected {_FORMS[kind]}, points as 0,0,0, found {name!r}") from None

    @property
    def end(self) -> Floats:
        """(3,) the last point."""
        return np.asarray(self.at(np.array([float(self.parts)]))[0][0])

    def evenly(self, count: int) -> tuple[Floats, Floats]:
        """Points (n, 3) at even steps of length, both ends included, and the length (n,) up to each."""
        t, lengths = self.parameters(count)
        return self.at(t)[0], lengths

    def parameters(self, count: int) -> tuple[Floats, Floats]:
        """Parameters (n,) at even steps of length, both ends included, and the length (n,) up to each."""
        wanted = np.linspace(0.0, self.length, count)
        return self.parameters_at(wanted), wanted

    def lengths_at(self, t: Floats) -> Floats:
        """Lengths of the curve up to parameters t, between its intervals as if these had even speed."""
        return np.interp(t, *self._lengths)

    def parameters_at(self, lengths: Floats) -> Floats:
        """(n,) parameters up to which the curve has these lengths (n,)."""
        return self._at_lengths(lengths, *self._lengths)

    @property
    def length(self) -> float:
        """Length of the whole curve."""
        return float(self._lengths[1][-1])

    @cached_property
    def _lengths(self) -> tuple[Floats, Floats]:
        """Parameters (n,) of the ends of intervals, and the length (n,) up to each."""
        ends = np.linspace(0.0, self.parts, self.parts * self.intervals + 1)
        nodes, weights = gauss(_POINTS)
        t = ends[:-1, None] + np.diff(ends)[:, None] * (1 + nodes) / 2
        speed = np.linalg.norm(self.at(t.reshape(-1))[1], axis=1).reshape(t.shape)
        return ends, np.concatenate([[0.0], np.cumsum(speed @ weights * np.diff(ends) / 2)])

    def _at_lengths(self, wanted: Floats, ends: Floats, lengths: Floats) -> Floats:
        """(n,) parameters of the requested lengths, by Newton steps inside intervals."""
        nodes, weights = gauss(_POINTS)
        number = np.clip(np.searchsorted(lengths, wanted, side="right") - 1, 0, len(ends) - 2)
        first, t = ends[number], np.interp(wanted, lengths, ends)
        for _ in range(4):
            places = first[:, None] + (t - first)[:, None] * (1 + nodes) / 2
            speed = np.linalg.norm(self.at(places.reshape(-1))[1], axis=1).reshape(places.shape)
            found = lengths[number] + speed @ weights * (t - first) / 2
            t = t - (found - wanted) / np.maximum(np.linalg.norm(self.at(t)[1], axis=1), 1e-300)
            t = np.clip(t, first, ends[number + 1])
        return t


def _made(dataset: Dataset, name: str, kind: str, texts: list[str]) -> Curve:
    """A curve of a kind; raises ValueError if the texts don't say one."""
    if kind == "circle":
        centre, normal = map(_point, texts[:2])
        (radius,) = map(float, texts[2:])
        return _circle(name, centre, normal, radius)
    if kind == "normal":
        place, length = _point(texts[-2]), float(texts[-1])
        return _normal(dataset, name, ":".join(texts[:-2]), place, length)
    points = np.array([_point(text) for text in texts])
    if len(points) < 2 or (kind == "line" and len(points) > 2) or not np.diff(points, axis=0).any(axis=1).all():
        raise ValueError
    return _spline(name, points) if kind == "spline" else _polyline(name, points)


def _point(text: str) -> Floats:
    parts = [float(part) for part in text.split(",")]
    if len(parts) not in (2, 3) or not np.isfinite(parts).all():
        raise ValueError
    return np.array([*parts, 0.0][:3])


def _polyline(name: str, points: Floats) -> Curve:
    steps = np.diff(points, axis=0)

    def at(t: Floats) -> tuple[Floats, Floats]:
        part = np.clip(t.astype(np.int64), 0, len(steps) - 1)
        return points[part] + (t - part)[:, None] * steps[part], steps[part]

    return Curve(name, len(steps), at)


def _circle(name: str, centre: Floats, normal: Floats, radius: float) -> Curve:
    size = float(np.linalg.norm(normal))
    if not size > 0 or not 0 < radius < np.inf:
        raise ValueError
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal / size, helper)
    first /= np.linalg.norm(first)
    second = np.cross(normal / size, first)

    def at(t: Floats) -> tuple[Floats, Floats]:
        angle = 2 * np.pi * t[:, None]
        place = centre + radius * (np.cos(angle) * first + np.sin(angle) * second)
        return place, 2 * np.pi * radius * (np.cos(angle) * second - np.sin(angle) * first)

    return Curve(name, 1, at)


def _spline(name: str, points: Floats) -> Curve:
    """Second derivatives M at the knots follow from continuity of the first ones; they vanish at both ends."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    count = len(steps)
    matrix, right = np.eye(count + 1), np.zeros((count + 1, 3))
    slopes = np.diff(points, axis=0) / steps[:, None]
    for k in range(1, count):
        matrix[k, k - 1 : k + 2] = steps[k - 1], 2 * (steps[k - 1] + steps[k]), steps[k]
        right[k] = 6 * (slopes[k] - slopes[k - 1])
    bends = np.linalg.solve(matrix, right)

    def at(t: Floats) -> tuple[Floats, Floats]:
        part = np.clip(t.astype(np.int64), 0, count - 1)
        h, s = steps[part][:, None], (t - part)[:, None]
        a, b = bends[part], bends[part + 1]
        bend = h**2 / 6 * ((1 - s) ** 3 - (1 - s)) * a + h**2 / 6 * (s**3 - s) * b
        slope = h**2 / 6 * (1 - 3 * (1 - s) ** 2) * a + h**2 / 6 * (3 * s**2 - 1) * b
        place = (1 - s) * points[part] + s * points[part + 1] + bend
        return place, points[part + 1] - points[part] + slope

    return Curve(name, count, at)


def _normal(dataset: Dataset, name: str, boundary: str, point: Floats, length: float) -> Curve:
    if not 0 < length < np.inf or not boundary:
        raise ValueError
    surface = surface_of(dataset, boundary)
    near = nearest(surface, point[None])
    away = vectors_away(surface, point[None], near)[0]
    if not np.isfinite(away).all():
        raise ElvisError(f"{name}: expected a point off the boundary, to determine the direction of the normal")
    into = vectors_away(surface, near.place, nearest(surface, near.place))[0]
    if into @ away < 0 and not _is_inside(dataset, point):
        away = into
    return _polyline(name, np.stack([near.place[0], near.place[0] + length * away]))


def _is_inside(dataset: Dataset, point: Floats) -> bool:
    """Whether a point lies in the data."""
    return bool(Locator(patches(dataset)).locate(point[None]).status[0] == Status.INSIDE)
