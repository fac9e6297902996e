"""A swept wing like the ONERA M6: quadratic tetrahedra, thin and long near the wall, and an analytic pressure.

Root chord 0.8059, span 1.1963, leading edge swept by 30 degrees, trailing edge by 15.8, a symmetric section of 9.8 %
thickness; y = 0 is the plane of symmetry.  The mesh is made where the span is four times shorter and the layers at the
wall are not yet pressed together.

The pressure coefficient is no solution, but has what one looks for: at each station 1 - |W|^2 of the plane flow past a
thin body with lift, whose singular points lie within the section; two shocks that meet towards the tip; the trough of
a vortex that leaves the tip.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from meshing import meshed, name_sides, session, set_sizes, size_near

from elvis import Dataset
from elvis.core.base.arrays import Floats

ROOT, SPAN = 0.8059, 1.1963
LEADING, TRAILING = np.tan(np.radians(30)), np.tan(np.radians(15.8))
THICKNESS = 0.098
#: the span is shorter by this while the mesh is made, so that elements become long along it
STRETCH = 4.0
#: the layers at the wall: how deep, in chords, and how much they are pressed together at the wall
LAYER, PRESSED = 0.14, 0.1
BOX = np.array([[-4.0, 0.0, -4.0], [6.0, 5.0, 4.0]])


def chord(y: Floats) -> Floats:
    """Chord at a station; beyond the tip that of the tip."""
    return np.asarray(ROOT - (LEADING - TRAILING) * np.clip(y, 0, SPAN))


def leading_edge(y: Floats) -> Floats:
    """x of the leading edge; beyond the tip it goes on straight along the stream."""
    return np.asarray(LEADING * np.clip(y, 0, SPAN))


def half_thickness(s: Floats) -> Floats:
    """Of the section, over the chord, at s in [0, 1] of it: that of NACA's four digits with a sharp trailing edge."""
    powers = 0.2969 * np.sqrt(s) - 0.126 * s - 0.3516 * s**2 + 0.2843 * s**3 - 0.1036 * s**4
    return np.asarray(5 * THICKNESS * powers)


def mesh(fineness: float = 1.0) -> Dataset:
    """Quadratic tetrahedra around the wing, about 70,000 at fineness 1; more as its cube."""
    with session() as gmsh:
        occ = gmsh.model.occ
        low, high = BOX / [1, STRETCH, 1]
        air = occ.addBox(*low, *(high - low))
        occ.cut([(3, air)], [(3, _solid(occ))])
        occ.synchronize()
        tip = SPAN / STRETCH
        sides = {
            "symmetry": lambda box: np.abs(box[:, 1]).max() < 1e-3,
            "wing": lambda box: bool((np.abs(box[:, 2]) < 0.1).all() and box[1, 1] < tip + 1e-3),
            "far": lambda box: True,
        }
        name_sides(gmsh, sides)
        _sizes(gmsh, fineness)
        return meshed(gmsh, order=2, warp=warp)


def _solid(occ: Any) -> int:
    """The wing, through two sections that share their parametrization."""
    wires = []
    for station in (0.0, SPAN):
        s = (1 - np.cos(np.pi * np.linspace(0, 1, 30))) / 2
        upper = np.stack([s, 0 * s, half_thickness(s)], axis=1)
        upper[-1, 2] = 0
        upper, lower = (upper * [1, 1, side] for side in (1, -1))
        ends = [_placed(occ, upper[0], station), _placed(occ, upper[-1], station)]
        curves = []
        for line in (upper, lower):
            inner = [_placed(occ, point, station) for point in line[1:-1]]
            curves.append(occ.addBSpline([ends[0], *inner, ends[1]]))
        wires.append(occ.addWire(curves))
    return int(occ.addThruSections(wires, makeSolid=True, makeRuled=True)[0][1])


def _placed(occ: Any, point: Floats, station: float) -> int:
    y = np.array(station)
    x, _, z = point * chord(y) + [float(leading_edge(y)), 0, 0]
    return int(occ.addPoint(x, station / STRETCH, z))


def _sizes(gmsh: Any, fineness: float) -> None:
    """Finest at the leading edge, fine on the wing and at its other edges."""
    model, found = gmsh.model, {"edge": [], "rim": [], "wing": []}
    wing = next(tag for dim, tag in model.getPhysicalGroups(2) if model.getPhysicalName(dim, tag) == "wing")
    for surface in model.getEntitiesForPhysicalGroup(2, wing):
        found["wing"].append(int(surface))
    for _, curve in model.getBoundary([(2, tag) for tag in found["wing"]], combined=False, oriented=False):
        box = np.array(model.getBoundingBox(1, curve)).reshape(2, 3)
        along = box[1, 1] - box[0, 1] > 0.5 * SPAN / STRETCH
        found["edge" if along and box[0, 0] < 0.1 else "rim"].append(curve)
    near = [
        size_near(gmsh, found["edge"], [], (0.009 / fineness, 1.0 / fineness, 0.004, 2.8)),
        size_near(gmsh, found["rim"], [], (0.016 / fineness, 1.0 / fineness, 0.01, 2.8)),
        size_near(gmsh, [], found["wing"], (0.026 / fineness, 1.0 / fineness, 0.02, 2.8)),
    ]
    set_sizes(gmsh, near)


def warp(points: Floats, strength: Floats) -> Floats:
    """Press the layers near the wall together, as strongly as ``strength`` (n,) says, then give the span its length."""
    y = points[:, 1] * STRETCH
    c, start = chord(y), leading_edge(y)
    section = np.stack([(points[:, 0] - start) / c, points[:, 2] / c], axis=1)
    near = np.flatnonzero((np.abs(section - [0.5, 0]) < [0.7, 0.25]).all(axis=1) & (y < SPAN))
    foot = _foot(section[near])
    away = section[near] - foot
    far = np.linalg.norm(away, axis=1)
    factor = 1 - strength[near] * (1 - _pressed(far, foot[:, 0], y[near]))
    section[near] = foot + away * factor[:, None]
    return np.stack([start + c * section[:, 0], y, c * section[:, 1]], axis=1)


def _pressed(far: Floats, s: Floats, y: Floats) -> Floats:
    """By how much points at a distance from the wall come nearer: not at all at the edges of the wing and its tip."""
    ratio = np.minimum(far / LAYER, 1.0)
    there = _step((s - 0.02) / 0.15) * _step((1.0 - s) / 0.15) * _step((SPAN - y) / (0.15 * SPAN))
    least = 1 - (1 - PRESSED) * there
    return np.asarray(least + (1 - least) * ratio * (2 - ratio))


def _step(t: Floats) -> Floats:
    """0 below 0, 1 above 1, smooth between."""
    t = np.clip(t, 0, 1)
    return np.asarray(t**2 * (3 - 2 * t))


def _foot(points: Floats) -> Floats:
    """(n, 2) the points of the section nearest to points (n, 2) near it."""
    s = (1 - np.cos(np.pi * np.linspace(0, 1, 4001))) / 2
    line = np.stack([s, half_thickness(s)], axis=1)
    mirrored = np.abs(points)
    mirrored[:, 0] = points[:, 0]
    nearest = _nearest(mirrored, line)
    foot = _on_segments(mirrored, line, nearest)
    foot[:, 1] *= np.where(points[:, 1] < 0, -1, 1)
    return foot


def _nearest(points: Floats, line: Floats) -> Any:
    """(n,) the number of the nearest point of the line."""
    parts = np.array_split(points, max(1, len(points) // 2000))
    return np.concatenate([((p[:, None] - line) ** 2).sum(axis=2).argmin(axis=1) for p in parts])


def _on_segments(points: Floats, line: Floats, nearest: Any) -> Floats:
    """(n, 2) the nearest points of the two pieces of the line next to its points ``nearest``."""
    best, least = line[nearest].copy(), np.full(len(points), np.inf)
    for side in (-1, 0):
        first = np.clip(nearest + side, 0, len(line) - 2)
        a, d = line[first], line[first + 1] - line[first]
        t = np.clip(((points - a) * d).sum(axis=1) / (d * d).sum(axis=1), 0, 1)
        candidate = a + t[:, None] * d
        square = ((points - candidate) ** 2).sum(axis=1)
        better = square < least
        best[better], least[better] = candidate[better], square[better]
    return best


def pressure(points: Floats) -> Floats:
    """(n,) the pressure coefficient."""
    x, y, z = np.moveaxis(points, -1, 0)
    c = chord(y)
    s, h = (x - leading_edge(y)) / c, z / c
    inboard = _step((SPAN - y) / (0.35 * SPAN)) ** 0.5
    at = s + 1j * h
    source = 1 - (at - 0.5) / ((at - 0.006) * np.sqrt((at - 0.985) / (at - 0.006)))
    lift = np.sqrt((at - 1) / (at - 0.006))
    velocity = 1 + inboard * (0.13 * (1 - 0.95 * _step((s - 0.5) / 0.5)) * source - 0.075j * lift)
    shock = 0.42 * inboard * _shocks(s, y / SPAN) * np.where(h > 0, np.exp(-h / 0.25), 0.0)
    behind = x - leading_edge(np.array(SPAN)) - 0.6 * chord(np.array(SPAN))
    core = 0.035 + 0.02 * np.maximum(behind, 0)
    trough = np.exp(-((y - 0.985 * SPAN) ** 2 + (z - 0.03 - 0.02 * behind) ** 2) / core**2)
    return np.asarray(1 - np.abs(velocity) ** 2 - shock - 0.55 * trough * _step(behind / 0.3 + 0.5))


def _shocks(s: Floats, station: Floats) -> Floats:
    """1 between the shocks that run along the span, the front one from the apex, the rear one from the middle."""
    front = 0.10 + 0.28 * station
    rear = 0.62 - 0.20 * station
    suction = 0.5 * (np.tanh((s - 0.03) / 0.02) - np.tanh((s - front) / 0.03))
    plateau = 0.5 * (np.tanh((s - 0.03) / 0.02) - np.tanh((s - rear) / 0.03))
    return np.asarray(0.45 * suction + 0.55 * plateau)
