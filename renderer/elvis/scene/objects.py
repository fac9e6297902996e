"""What a scene shows: cut surfaces, faces, isosurfaces, volumes, and how each of them looks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from elvis.scene.surfaces import PaletteName, Surface, Vector, check, positive


def check_color(color: Vector | None, what: str) -> None:
    """SceneError unless the colour is None or has three parts from 0 to 1."""
    good = color is None or (len(color) == 3 and all(0.0 <= part <= 1.0 for part in color))
    check(good, what, "red, green and blue from 0 to 1", color)


def check_range(ends: tuple[float, float] | None) -> None:
    """SceneError unless the range is None or ascends."""
    good = ends is None or (np.isfinite(ends).all() and ends[0] < ends[1])
    found = ends and f"{ends[0]:g} to {ends[1]:g}"
    check(good, "range", "a colour range from a smaller to a greater value", found)


@dataclass(frozen=True)
class Contours:
    """Lines of equal value on a surface.

    values    the values; or
    count     how many lines, evenly between the ends of the colour range
    width     in pixels
    quantity  what the lines are of: a field, an expression, a ready-made name; None takes the style's
    """

    values: tuple[float, ...] = ()
    count: int | None = None
    width: float = 1.5
    color: Vector = (0.0, 0.0, 0.0)
    quantity: str | None = None

    def __post_init__(self) -> None:
        check(len(self.values) or self.count is not None, "contours", "values or a count", "neither")
        check(not len(self.values) or self.count is None, "contours", "values or a count", "both")
        check(self.count is None or 1 <= self.count <= 1000, "contours count", "1 to 1000", self.count)
        check(np.isfinite(self.values).all(), "contours values", "finite numbers", self.values)
        positive(self.width, "contours width")
        check_color(self.color, "contours color")


@dataclass(frozen=True)
class MeshLines:
    """The borders of elements on a surface; ``width`` in pixels."""

    width: float = 1.0
    color: Vector = (0.25, 0.25, 0.25)

    def __post_init__(self) -> None:
        positive(self.width, "mesh_lines width")
        check_color(self.color, "mesh_lines color")


@dataclass(frozen=True)
class Style:
    """How an object looks.

    quantity    what colours it: a field, an expression, a ready-made name; None takes the scene's field
    color       one colour in place of the colour map
    palette     name or file of its colour map; None takes the scene's
    range       values at the ends of its colour map; None takes the scene's
    opacity     above 0, at most 1
    lit         whether lights shade it; None: faces and isosurfaces are lit, cut surfaces are not
    """

    quantity: str | None = None
    color: Vector | None = None
    palette: PaletteName | None = None
    range: tuple[float, float] | None = None
    opacity: float = 1.0
    lit: bool | None = None
    contours: Contours | None = None
    mesh_lines: MeshLines | None = None

    def __post_init__(self) -> None:
        check(0.0 < self.opacity <= 1.0, "opacity", "a number above 0 and at most 1", self.opacity)
        check_color(self.color, "color")
        check_range(self.range)


@dataclass(frozen=True)
class CutSurface:
    """What a surface meets of the volume."""

    surface: Surface
    style: Style = field(default_factory=Style)


@dataclass(frozen=True)
class Faces:
    """Element faces.

    select  any of: ``all`` (the outer faces), ``inner`` (those between elements), the name or id of a boundary or
            composite, ``element:ID``, ``shape:NAME`` and ``region:NAME`` (every face of these elements)
    """

    select: tuple[str, ...] = ("all",)
    style: Style = field(default_factory=Style)

    def __post_init__(self) -> None:
        check(self.select, "select of faces", "all, names of boundaries or elements", "none")


@dataclass(frozen=True)
class Isosurface:
    """Where a quantity (None: the scene's field) has one of the values; its style's quantity may colour it."""

    values: tuple[float, ...]
    quantity: str | None = None
    style: Style = field(default_factory=Style)

    def __post_init__(self) -> None:
        check(self.values, "values of an isosurface", "at least one", "none")
        check(np.isfinite(self.values).all(), "values of an isosurface", "finite numbers", self.values)


@dataclass(frozen=True)
class Transfer:
    """A piecewise linear transfer function.

    values     (k,) ascending values of the quantity; beyond the ends the density is that of the ends
    densities  (k,) extinction per world unit of length, 0 or more
    colors     (k,) colours; empty takes them from the colour map
    """

    values: tuple[float, ...]
    densities: tuple[float, ...]
    colors: tuple[Vector, ...] = ()

    def __post_init__(self) -> None:
        ascending = len(self.values) > 0 and np.isfinite(self.values).all() and (np.diff(self.values) > 0).all()
        check(ascending, "values of a transfer function", "ascending finite numbers", self.values)
        good = len(self.densities) == len(self.values) and all(0.0 <= d < np.inf for d in self.densities)
        check(good, "densities of a transfer function", "a finite number of 0 or more for each value", self.densities)
        enough = len(self.colors) in (0, len(self.values))
        check(enough, "colors of a transfer function", f"none or {len(self.values)}", len(self.colors))
        for color in self.colors:
            check_color(color, "colors of a transfer function")


@dataclass(frozen=True)
class VolumeRendering:
    """Light that the volume sends out and takes up along each ray.

    error  greatest error of a pixel's colour that the quadrature aims at
    """

    transfer: Transfer
    quantity: str | None = None
    error: float = 1e-3

    def __post_init__(self) -> None:
        positive(self.error, "error of a volume")


SceneObject: TypeAlias = CutSurface | Faces | Isosurface | VolumeRendering
