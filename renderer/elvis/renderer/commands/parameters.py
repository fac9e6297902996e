"""Command-line values of scenes: planes, cameras, sizes, ranges; each a callback for an option."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from elvis.formats.commands.arguments import numbers, triples

if TYPE_CHECKING:
    from elvis.renderer.scene import Camera, Plane

LARGEST_SIDE = 32768


def plane(context: click.Context, parameter: click.Parameter, value: str | None) -> Plane | None:
    """``x,y,z:nx,ny,nz``: a point and a normal."""
    from elvis.renderer.scene import Plane

    found = triples(2)(context, parameter, value)
    if found is None:
        return None
    if not any(found[1]):
        raise click.BadParameter(f"expected a normal that is not zero, found {value!r}")
    return Plane(*found)


def camera(context: click.Context, parameter: click.Parameter, value: str) -> Camera | str:
    """The name of a view, or ``eye:at[:up[:degrees]]``."""
    from elvis.renderer.scene import NAMED_VIEWS, Camera

    if value == "fit" or value in NAMED_VIEWS:
        return value
    parts = value.split(":")
    if not 2 <= len(parts) <= 4:
        names = ", ".join(["fit", *NAMED_VIEWS])
        raise click.BadParameter(f"expected {names} or eye:at[:up[:degrees]], found {value!r}")
    eye, at, *up = triples(min(len(parts), 3))(context, parameter, ":".join(parts[:3]))
    fov = numbers(1)(context, parameter, parts[3])[0] if len(parts) == 4 else None
    if fov is not None and not 0 < fov < 180:
        raise click.BadParameter(f"expected a field of view between 0 and 180 degrees, found {parts[3]}")
    return Camera(eye, at, up[0] if up else (0.0, 0.0, 1.0), fov)


def size(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """``WIDTHxHEIGHT`` in pixels."""
    if value is None:
        return None
    sides = value.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() and 1 <= int(side) <= LARGEST_SIDE for side in sides):
        raise click.BadParameter(
            f"expected WIDTHxHEIGHT such as 1000x800, up to {LARGEST_SIDE} a side, found {value!r}"
        )
    return int(sides[0]), int(sides[1])


def color_range(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, float] | None:
    """``LOW:HIGH``, ascending."""
    if value is None:
        return None
    found = numbers(2)(context, parameter, value.replace(":", ",", 1))
    if not found[0] < found[1]:
        raise click.BadParameter(f"expected two ascending values such as -0.5:1, found {value!r}")
    return found[0], found[1]
