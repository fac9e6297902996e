"""Command-line values of scenes: surfaces, objects, cameras, sizes, ranges; each a callback for an option."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, cast

import click

from elvis.formats.commands.arguments import numbers, triples

if TYPE_CHECKING:
    from elvis.renderer import scene as kinds

LARGEST_SIDE = 32768
SURFACES = {
    "plane": ("Plane", "POINT:NORMAL", 1),
    "sphere": ("Sphere", "CENTER:RADIUS", 1),
    "cylinder": ("Cylinder", "POINT:AXIS:RADIUS", 2),
    "cone": ("Cone", "APEX:AXIS:DEGREES", 2),
}
Callback = Callable[[click.Context, click.Parameter, Any], Any]


def each(parse: Callback) -> Callback:
    """The callback of an option that can be repeated: a tuple of values."""

    @wraps(parse)
    def all_of(context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> tuple[Any, ...]:
        return tuple(parse(context, parameter, value) for value in values)

    return all_of


def checked(parse: Callback) -> Callback:
    """A callback that is not asked where the option was not given, and whose SceneError is an error of usage."""

    @wraps(parse)
    def careful(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
        from elvis.renderer.errors import SceneError

        try:
            return None if value is None else parse(context, parameter, value)
        except SceneError as error:
            raise click.BadParameter(str(error)) from error

    return careful


@checked
def plane(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Plane:
    """``x,y,z:nx,ny,nz``: a point and a normal."""
    from elvis.renderer.scene import Plane

    point, normal = triples(2)(context, parameter, value)
    if not any(normal):
        raise click.BadParameter(f"expected a normal that is not zero, found {value!r}")
    return Plane(point, normal)


@checked
def surface(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Surface:
    """``plane:…``, ``sphere:…``, ``cylinder:…``, ``cone:…`` (see SURFACES), ``mesh:FILE``, ``implicit:EXPRESSION``."""
    from elvis.renderer import scene

    kind, _, rest = value.partition(":")
    if kind == "plane":
        return cast("kinds.Plane", plane(context, parameter, rest))
    if kind in ("mesh", "implicit") and rest:
        return scene.TriangleMesh(rest) if kind == "mesh" else scene.Implicit(rest)
    if kind not in SURFACES:
        raise click.BadParameter(f"expected {', '.join(SURFACES)}, mesh or implicit and a colon, found {value!r}")
    name, form, count = SURFACES[kind]
    *vectors, last = rest.split(":")
    if len(vectors) != count:
        raise click.BadParameter(f"expected {kind}:{form}, found {value!r}")
    found = triples(count)(context, parameter, ":".join(vectors))
    made: kinds.Surface = getattr(scene, name)(*found, *numbers(1)(context, parameter, last))
    return made


@checked
def clip(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Clip:
    """A surface, after ``outside:`` where its outside is to go."""
    from elvis.renderer.scene import Clip

    outside = value.startswith("outside:")
    within = surface(context, parameter, value.removeprefix("outside:").removeprefix("inside:"))
    return Clip(within, "outside" if outside else "inside")


@checked
def faces(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Faces:
    """Names with commas between them."""
    from elvis.renderer.scene import Faces

    return Faces(tuple(name.strip() for name in value.split(",")))


@checked
def isosurface(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Isosurface:
    """``VALUE,VALUE…``, or ``QUANTITY=VALUE,VALUE…``."""
    from elvis.renderer.scene import Isosurface

    quantity, _, values = value.rpartition("=")
    return Isosurface(_values(context, parameter, values), quantity.strip() or None)


@checked
def volume(context: click.Context, parameter: click.Parameter, value: str) -> kinds.VolumeRendering:
    """``VALUE:DENSITY,VALUE:DENSITY…``, or the same after ``QUANTITY=``."""
    from elvis.renderer.scene import Transfer, VolumeRendering

    quantity, _, points = value.rpartition("=")
    pairs = [numbers(2)(context, parameter, pair.replace(":", ",", 1)) for pair in points.split(",")]
    transfer = Transfer(tuple(pair[0] for pair in pairs), tuple(pair[1] for pair in pairs))
    return VolumeRendering(transfer, quantity.strip() or None)


@checked
def contours(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Contours:
    """A whole number: so many lines; else their values, with commas or a decimal point."""
    from elvis.renderer.scene import Contours

    return Contours(count=int(value)) if value.isdecimal() else Contours(_values(context, parameter, value))


@checked
def camera(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Camera | str:
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
    return Camera(eye, at, up[0] if up else (0.0, 0.0, 1.0), fov)


@checked
def size(context: click.Context, parameter: click.Parameter, value: str) -> tuple[int, int]:
    """``WIDTHxHEIGHT`` in pixels."""
    sides = value.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() and 1 <= int(side) <= LARGEST_SIDE for side in sides):
        raise click.BadParameter(
            f"expected WIDTHxHEIGHT such as 1000x800, up to {LARGEST_SIDE} a side, found {value!r}"
        )
    return int(sides[0]), int(sides[1])


@checked
def color_range(context: click.Context, parameter: click.Parameter, value: str) -> tuple[float, float] | str:
    """``LOW:HIGH``, ascending; or ``seen`` or ``all``."""
    if value in ("seen", "all"):
        return value
    low, high = numbers(2)(context, parameter, value.replace(":", ",", 1))
    if not low < high:
        raise click.BadParameter(f"expected two ascending values such as -0.5:1, seen or all, found {value!r}")
    return low, high


@checked
def color(context: click.Context, parameter: click.Parameter, value: str) -> tuple[float, float, float]:
    """A name or ``#rrggbb``, as CSS has them, or three parts from 0 to 1 with commas between them."""
    from PIL import ImageColor

    if value.count(",") == 2:
        r, g, b = numbers(3)(context, parameter, value)
        return r, g, b
    try:
        r, g, b = ImageColor.getrgb(value)[:3]
    except ValueError as error:
        raise click.BadParameter(f"expected a colour such as white, #ff8000 or 1,0.5,0, found {value!r}") from error
    return r / 255, g / 255, b / 255


@checked
def light(context: click.Context, parameter: click.Parameter, value: str) -> kinds.Light:
    """``x,y,z`` towards the lamp or ``eye``, then ``:intensity`` where it is not the usual one."""
    from elvis.renderer.scene import Light

    direction, _, intensity = value.partition(":")
    towards = None if direction == "eye" else triples(1)(context, parameter, direction)[0]
    return Light(towards, *(numbers(1)(context, parameter, intensity) if intensity else ()))


@checked
def setting(context: click.Context, parameter: click.Parameter, value: str) -> tuple[str, str]:
    """``KEY=VALUE``."""
    key, equals, text = value.partition("=")
    if not key.strip() or not equals:
        raise click.BadParameter(f"expected KEY=VALUE such as objects[0].style.opacity=0.5, found {value!r}")
    return key.strip(), text.strip()


def _values(context: click.Context, parameter: click.Parameter, text: str) -> tuple[float, ...]:
    """Any number of numbers with commas between them."""
    found: tuple[float, ...] = numbers(text.count(",") + 1)(context, parameter, text)
    return found
