"""Command-line values of scenes: vectors, planes, cameras, sizes, ranges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from elvis.renderer.scene import Camera, Plane


class PlaneType(click.ParamType):
    """``x,y,z:nx,ny,nz``: a point and a normal."""

    name = "POINT:NORMAL"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Plane:
        """The plane; usage error where it can't be read."""
        from elvis.renderer.scene import Plane

        parts = str(value).split(":")
        vectors = [vector(part) for part in parts]
        if len(parts) != 2 or None in vectors:
            self.fail(f"expected a point and a normal such as 0,0,0.2:0,0,1, found {value!r}", param, ctx)
        if not any(vectors[1] or ()):
            self.fail(f"expected a normal that is not zero, found {value!r}", param, ctx)
        return Plane(vectors[0] or (0, 0, 0), vectors[1] or (0, 0, 1))


class CameraType(click.ParamType):
    """A named view, or ``eye:at[:up[:degrees]]``."""

    name = "VIEW"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Camera | str:
        """The camera or the name of a view; usage error where it can't be read."""
        from elvis.renderer.scene import NAMED_VIEWS, Camera

        text = str(value)
        if text == "fit" or text in NAMED_VIEWS:
            return text
        parts = text.split(":")
        vectors = [vector(part) for part in parts[:3]]
        fov = number(parts[3]) if len(parts) > 3 else None
        sound = 2 <= len(parts) <= 4 and None not in vectors and (len(parts) < 4 or (fov and 0 < fov < 180))
        if not sound:
            names = ", ".join(["fit", *NAMED_VIEWS])
            self.fail(
                f"expected {names} or eye:at[:up[:degrees]] such as 3,2,1:0,0,0:0,0,1:30, found {value!r}", param, ctx
            )
        eye, at, up = (*vectors, (0.0, 0.0, 1.0))[:3]
        return Camera(eye or (0, 0, 0), at or (0, 0, 0), up or (0, 0, 1), fov)


class SizeType(click.ParamType):
    """``WIDTHxHEIGHT`` in pixels."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Width and height; usage error where they can't be read."""
        if isinstance(value, tuple):
            return value
        sides = str(value).lower().split("x")
        if len(sides) != 2 or not all(side.isdecimal() and 1 <= int(side) <= 32768 for side in sides):
            self.fail(f"expected WIDTHxHEIGHT such as 1000x800 (up to 32768 a side), found {value!r}", param, ctx)
        return int(sides[0]), int(sides[1])


class RangeType(click.ParamType):
    """``low:high``."""

    name = "LOW:HIGH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """The two values; usage error where they can't be read or don't ascend."""
        ends = [number(part) for part in str(value).split(":")]
        if len(ends) != 2 or ends[0] is None or ends[1] is None or not ends[0] < ends[1]:
            self.fail(f"expected two ascending values such as -0.5:1, found {value!r}", param, ctx)
        return ends[0], ends[1]


def number(text: str) -> float | None:
    """A finite number, None where the text is none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if abs(value) < float("inf") else None


def vector(text: str) -> tuple[float, float, float] | None:
    """Three finite numbers with commas between, None where the text is something else."""
    values = [number(part) for part in text.split(",")]
    if len(values) != 3 or None in values:
        return None
    x, y, z = (value or 0.0 for value in values)
    return x, y, z
