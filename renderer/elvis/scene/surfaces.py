"""Surfaces in space: what cuts a volume, and what bounds the regions that are clipped away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np

from elvis.core.arrays import Floats
from elvis.scene.errors import SceneError

Vector: TypeAlias = tuple[float, float, float]
#: the name of a file; in scene files relative to them
FilePath: TypeAlias = Annotated[str, "file"]
#: the name of a colour map, or of an .xml file with one
PaletteName: TypeAlias = Annotated[str, "palette"]


def unit(vector: Vector | Floats, what: str) -> Floats:
    """``vector`` at length 1; SceneError naming ``what`` where it has no direction."""
    array = np.asarray(vector, dtype=np.float64)
    length = float(np.linalg.norm(array))
    if not np.isfinite(length) or length == 0.0:
        raise SceneError(f"{what} must be a direction, found {', '.join(f'{x:g}' for x in array)}")
    return np.asarray(array / length)


def check(holds: object, what: str, expected: str, found: object) -> None:
    """SceneError naming ``what``, a key of the scene, unless ``holds``."""
    if not holds:
        raise SceneError(f"{what}: expected {expected}, found {found}")


def positive(value: float, what: str) -> None:
    """SceneError unless the value is a positive finite number."""
    check(0.0 < value < np.inf, what, "a positive number", value)


@dataclass(frozen=True)
class Plane:
    """A plane through ``point``, perpendicular to ``normal`` (of any length); its inside lies behind the normal."""

    point: Vector
    normal: Vector

    def __post_init__(self) -> None:
        unit(self.normal, "the normal of the plane")

    def basis(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors right, up and normal, right-handed; up is as near to z (else y) as the plane allows."""
        normal = unit(self.normal, "the normal of the plane")
        towards = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        right = unit(np.cross(towards, normal), "right")
        return right, np.cross(normal, right), normal


@dataclass(frozen=True)
class Sphere:
    """A sphere; radius in world units."""

    center: Vector
    radius: float

    def __post_init__(self) -> None:
        positive(self.radius, "radius of a sphere")


@dataclass(frozen=True)
class Cylinder:
    """A cylinder without ends around the line through ``point`` along ``axis``."""

    point: Vector
    axis: Vector
    radius: float

    def __post_init__(self) -> None:
        unit(self.axis, "the axis of the cylinder")
        positive(self.radius, "radius of a cylinder")


@dataclass(frozen=True)
class Cone:
    """A cone without end that opens from ``apex`` along ``axis``; degrees (0, 90) between axis and side."""

    apex: Vector
    axis: Vector
    angle: float

    def __post_init__(self) -> None:
        unit(self.axis, "the axis of the cone")
        check(0.0 < self.angle < 90.0, "angle of a cone", "degrees between 0 and 90", self.angle)


@dataclass(frozen=True)
class Implicit:
    """Where an expression of x, y, z and of the fields is zero; its inside is where it is negative."""

    expression: str


@dataclass(frozen=True)
class TriangleMesh:
    """The triangles of an STL, PLY, OBJ or GLB file; they have an inside where they are closed."""

    file: FilePath


#: surfaces that rays meet without any data
Solid: TypeAlias = Plane | Sphere | Cylinder | Cone | TriangleMesh
Surface: TypeAlias = Solid | Implicit
