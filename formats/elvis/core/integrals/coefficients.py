"""Coefficients of drag, lift and moment: forces on walls by dynamic pressure and area.

Anderson, Fundamentals of Aerodynamics, section 1.5.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, inf, isfinite, radians, sin

from elvis.core.base.errors import ElvisError
from elvis.core.integrals.integrands import Integrand
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.predefined import PARAMETERS
from elvis.core.quantities.reference_values import REFERENCE

_FORM = "RHO,U,AREA,AXIS[,LENGTH[,X,Y,Z]], such as 1.2,30,0.5,x or 1,1,1,xy:4,0.8,0.25,0,0, or only AXIS"
#: reference values for the numbers before the axis
_BEFORE = ("rho_ref", "u_ref", "area")


@dataclass(frozen=True)
class Coefficients:
    """The divisors of forces, and the axes of drag and lift.

    pressure  dynamic pressure of the flow far away, rho u^2 / 2
    area      of reference, in 2D a length
    length    of reference of moments
    drag      axis of the flow at zero angle of attack, "x", "y" or "z"
    lift      axis of lift at zero angle; None for y in 2D and z in 3D, or x if the flow is along these
    angle     of attack, degrees, which turns drag towards lift
    about     (x, y, z) of the reference point of moments; None for the point given in the data, or else the origin
    """

    pressure: float
    area: float
    length: float
    drag: str
    lift: str | None = None
    angle: float = 0.0
    about: tuple[float, float, float] | None = None

    @staticmethod
    def parse(text: str, names: Names) -> Coefficients:
        """Parse ``RHO,U,AREA,AXIS[,LENGTH[,X,Y,Z]]``, where AXIS is x, xy or xy:4, or only AXIS for reference values.

        Raises ElvisError for other texts, and for unknown values.
        """
        parts = [part.strip() for part in text.split(",")]
        if len(parts) == 1:
            parts = _with_reference(parts[0], names)
        axes, _, angle = (parts[3] if len(parts) > 3 else "").partition(":")
        try:
            density, speed, area, length = (float(part) for part in (*parts[:3], *(parts[4:5] or ["1"])))
            about = tuple(float(part) for part in parts[5:])
            attack = float(angle or 0.0)
        except ValueError:
            raise ElvisError(f"expected {_FORM}, found {text!r}") from None
        is_axes = len(axes) in (1, 2) and set(axes) <= set("xyz") and len(set(axes)) == len(axes)
        if (
            not is_axes
            or not all(0 < abs(value) < inf for value in (density, speed, area, length))
            or abs(attack) > 360
            or len(about) not in (0, 3)
            or not all(map(isfinite, about))
        ):
            raise ElvisError(f"expected {_FORM}, found {text!r}")
        point = (about[0], about[1], about[2]) if about else None
        return Coefficients(0.5 * density * speed**2, area, length, axes[0], axes[1:] or None, attack, point)

    def integrands(self, names: Names) -> Iterator[Integrand]:
        """Drag, lift and moments: total, by pressure and by friction; only by pressure if the viscosity is unknown.

        Raises ElvisError if forces are unknown, and for axes that the data lack.
        """
        axes = "xyz"[: names.dimension]
        lift = self.lift or next(axis for axis in axes[::-1] if axis != self.drag)
        if self.drag not in axes or lift not in axes:
            raise ElvisError(f"--coefficients: expected axes among {', '.join(axes)}, found {self.drag}{lift}")
        Expression.parse(f"pressure_force_{self.drag}", names)  # raises an error that names missing inputs
        along, across = cos(radians(self.angle)), sin(radians(self.angle))
        for part, suffix in self._parts(names):
            for name, (a, b) in {"drag": (along, across), "lift": (-across, along)}.items():
                text = f"({a!r}*{part}_{self.drag} + {b!r}*{part}_{lift})/{self.pressure * self.area!r}"
                yield Integrand(f"{name}_coefficient{suffix}", Expression.parse(text, names), is_load=True)
        for axis in {2: "z", 3: "xyz"}.get(names.dimension, ""):
            text = f"moment_{axis}{self._point(axis)}/{self.pressure * self.area * self.length!r}"
            yield Integrand(f"moment_coefficient_{axis}", Expression.parse(text, names), is_load=True)

    def _point(self, axis: str) -> str:
        """The parameters of a moment about an axis: coordinates of the point across it."""
        if self.about is None:
            return ""
        across = [f"{own}_ref={value!r}" for own, value in zip("xyz", self.about, strict=True) if own != axis]
        return f"({', '.join(across)})"

    @staticmethod
    def _parts(names: Names) -> list[tuple[str, str]]:
        """Forces, and the suffixes of their coefficients' names."""
        if "viscous_force_x" in names.flow.available:
            return [("force", ""), ("pressure_force", " (pressure)"), ("viscous_force", " (friction)")]
        return [("pressure_force", " (pressure)")]


def assumption(text: str, names: Names) -> Iterator[str]:
    """A message about the reference density of an incompressible flow, if coefficients take it to be 1."""
    if "," not in text and not {"rho_ref", "density"} & set(names.parameters) and _density(names) is not None:
        yield (
            "rho_ref is taken to be 1, as the data contain no density: their pressure is then a kinematic one; "
            "--set rho_ref=… gives another value"
        )


def _density(names: Names) -> float | None:
    """The reference density of data without one: that of an incompressible flow, 1 by default."""
    if "density" in names.parameters:
        return names.parameters["density"]
    return PARAMETERS["density"].default if names.flow.is_incompressible else None


def _with_reference(axis: str, names: Names) -> list[str]:
    """The parts of coefficients taken from reference values; raises ElvisError with the names of unknown ones."""
    density = _density(names)
    known = dict(names.parameters) if density is None else {"rho_ref": density, **names.parameters}
    missing = [name for name in _BEFORE if name not in known]
    if missing:
        words = ", ".join(f"{name} ({REFERENCE[name]})" for name in missing)
        settings = " ".join(f"{name}=…" for name in missing)
        raise ElvisError(
            f"--coefficients {axis}: expected {words}, which the data don't contain: pass --set {settings}"
        )
    about = [known.get(f"{axis}_ref", 0.0) for axis in "xyz"]
    values = [known[name] for name in _BEFORE]
    return [*map(repr, values), axis, repr(known.get("length", 1.0)), *map(repr, about)]
