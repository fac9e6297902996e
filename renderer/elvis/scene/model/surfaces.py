"""Surfaces in space: what cuts a volume, and what bounds the regions that are clipped away."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from elvis.scene.model.errors import SceneError
from elvis.scene.model.settings import FilePath, Model, Quantity, Setting, check

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats

Vector: TypeAlias = tuple[float, float, float]
#: sine of the angle below which two directions are the same or opposite
PERPENDICULAR = 1e-12


def unit(vector: "Vector | Floats", what: str) -> "Floats":
    """``vector`` at length 1; SceneError naming ``what`` where it has no direction."""
    import numpy as np

    array = np.asarray(vector, dtype=np.float64)
    # squares of very large and very small numbers are beyond the range
    largest = float(np.abs(array).max())
    if not np.isfinite(largest) or largest == 0.0:
        raise SceneError(f"{what} must be a direction, found {', '.join(f'{x:g}' for x in array)}")
    scaled = array if 1e-100 < largest < 1e100 else array / largest
    return np.asarray(scaled / np.linalg.norm(scaled))


def cross(a: "Floats", b: "Floats") -> "Floats":
    """The cross product of two vectors (3,), bitwise equal to NumPy's, which is slow for single vectors."""
    import numpy as np

    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


@dataclass(frozen=True, repr=False)
class Plane(Model, of="a plane"):
    """A plane, whose inside is the side behind the normal."""

    point: Annotated[Vector, Setting("Point of the plane.")]
    normal: Annotated[Vector, Setting("Normal of the plane, of any length.")]
    kind: Literal["plane"] = field(default="plane", kw_only=True)

    def check(self) -> None:
        """Raise SceneError if the normal is zero."""
        unit(self.normal, "the normal of the plane")

    def is_across(self, direction: "Vector | Floats") -> bool:
        """Whether the plane is perpendicular to a direction."""
        sine = cross(unit(direction, "the direction"), unit(self.normal, "the normal of the plane"))
        return bool(abs(sine).max() < PERPENDICULAR)

    def basis(self) -> "tuple[Floats, Floats, Floats]":
        """Unit vectors right, up and normal, right-handed; up is as near to z (else y) as the plane allows."""
        import numpy as np

        normal = unit(self.normal, "the normal of the plane")
        towards = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        right = unit(cross(towards, normal), "right")
        return right, cross(normal, right), normal


@dataclass(frozen=True, repr=False)
class Sphere(Model, of="a sphere"):
    """A sphere."""

    center: Annotated[Vector, Setting("Center of the sphere.")]
    radius: Annotated[float, Setting("Radius in world units.", gt=0, expected="a positive number")]
    kind: Literal["sphere"] = field(default="sphere", kw_only=True)


@dataclass(frozen=True, repr=False)
class Cylinder(Model, of="a cylinder"):
    """An infinite cylinder."""

    point: Annotated[Vector, Setting("Point of the axis.")]
    axis: Annotated[Vector, Setting("Direction of the axis, of any length.")]
    radius: Annotated[float, Setting("Radius in world units.", gt=0, expected="a positive number")]
    kind: Literal["cylinder"] = field(default="cylinder", kw_only=True)

    def check(self) -> None:
        """Raise SceneError if the axis is zero."""
        unit(self.axis, "the axis of the cylinder")


@dataclass(frozen=True, repr=False)
class Cone(Model, of="a cone"):
    """An infinite cone, on one side of its apex."""

    apex: Annotated[Vector, Setting("Apex of the cone.")]
    axis: Annotated[Vector, Setting("Direction in which the cone opens, of any length.")]
    angle: Annotated[float, Setting("Half-angle, between the axis and the side.", gt=0, lt=90, unit="degrees")]
    kind: Literal["cone"] = field(default="cone", kw_only=True)

    def check(self) -> None:
        """Raise SceneError if the axis is zero."""
        unit(self.axis, "the axis of the cone")


@dataclass(frozen=True, repr=False)
class Implicit(Model, of="an implicit surface"):
    """The zero set of an expression, which is negative on the inside."""

    expression: Annotated[Quantity, Setting("Expression in x, y, z and the fields.")]
    kind: Literal["implicit"] = field(default="implicit", kw_only=True)


@dataclass(frozen=True, repr=False)
class TriangleMesh(Model, of="a triangle mesh"):
    """Triangles from a file, which have an inside if they are closed."""

    file: Annotated[FilePath, Setting("STL, PLY, OBJ or GLB file.")]
    kind: Literal["mesh"] = field(default="mesh", kw_only=True)


@dataclass(frozen=True, repr=False)
class Middle(Model, of="a plane through the middle"):
    """The plane across an axis through the middle of the data's box; it becomes a plane once the data are known."""

    axis: Annotated[str, Setting("Axis that the plane is across: x, y or z.")]
    kind: Literal["middle"] = field(default="middle", kw_only=True)

    def check(self) -> None:
        """Raise SceneError for another axis."""
        check(self.axis in ("x", "y", "z"), "axis of a plane through the middle", "x, y or z", repr(self.axis))

    def plane(self, corners: "Floats") -> Plane:
        """The plane in data with the corners (2, 3) of their box."""
        x, y, z = (0.5 * (corners[0] + corners[1])).tolist()
        normal = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
        return Plane((x, y, z), normal[self.axis])


#: surfaces that rays meet without any data
Solid: TypeAlias = Plane | Sphere | Cylinder | Cone | TriangleMesh
#: surfaces with a place in space
Placed: TypeAlias = Solid | Implicit
Surface: TypeAlias = Placed | Middle


def placed(surface: Surface) -> Placed:
    """The surface; SceneError for a plane through the middle of data that are not known (see `with_middles`)."""
    if isinstance(surface, Middle):
        raise SceneError("plane: the middle of these data is not known: give a coordinate, such as z=0.2")
    return surface
