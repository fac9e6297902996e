"""The options that say what a scene holds, for every command that draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click

from elvis.plugins.commands.arguments import Parsed

CAMERA = (
    "fit (straight at a single plane, else iso), +x, -x, +y, -y, +z, -z (look along an axis), iso, or "
    "eye:at[:up[:degrees]]; orthographic and fitted to what is seen unless degrees are given."
)
CUT = (
    "A surface that cuts 3D data: plane:POINT:NORMAL, sphere:CENTER:RADIUS, cylinder:POINT:AXIS:RADIUS, "
    "cone:APEX:AXIS:DEGREES, mesh:FILE, implicit:EXPRESSION.  Repeatable."
)
COLORMAP = (
    "A colour map of the cmap catalogue, elvis:NAME, or a file of ParaView or the first ElVis.  [default: viridis]"
)
_Command = TypeVar("_Command", bound=Callable[..., Any])
OUTPUT = click.Path(path_type=Path, dir_okay=False)


def option(*names: str, parse: str = "", **settings: Any) -> Callable[[_Command], _Command]:
    """An option whose text a function of `parameters`, imported when it is needed, reads."""

    def read(text: str) -> Any:
        from elvis.scene.commands import parameters

        return getattr(parameters, parse)(text)

    if parse:
        settings["type"] = Parsed(read)
    return click.option(*names, **settings)


_many = partial(option, multiple=True)

#: options by the key of the scene that they set
OPTIONS = {
    "field": option("--field", "-f", help="What colours the picture: a field or a formula.  [default: the first]"),
    "plugin": option("--plugin", metavar="NAME|FILE.py", help="The runtime plugin that opens DATA."),
    "plane": _many("--plane", "planes", metavar="POINT:NORMAL", parse="plane", help="A cut plane; repeatable."),
    "objects": [
        _many("--cut", "cuts", metavar="SURFACE", parse="surface", help=CUT),
        _many(
            "--faces",
            metavar="NAMES",
            parse="faces",
            help="Any of all, inner, a boundary's name, element:ID, shape:NAME, region:NAME.",
        ),
        _many("--isosurface", "isosurfaces", metavar="[Q=]V,V", parse="isosurface", help="Where Q is V."),
        _many("--volume", "volumes", metavar="[Q=]V:D,V:D", parse="volume", help="Fog: density D where Q is V."),
        option("--contours", metavar="N|V,V", parse="contours", help="N contour lines, or those of values."),
        option("--mesh-lines", is_flag=True, default=None, help="Draw the borders of elements."),
        option("--opacity", type=float, help="Of all objects, above 0 and at most 1."),
        option("--lit/--unlit", default=None, help="Shade objects, or don't.  [default: faces and isosurfaces]"),
        option("--color", metavar="COLOR", parse="color", help="One colour for all objects."),
    ],
    "camera": option("--camera", metavar="VIEW", parse="camera", help=CAMERA),
    "size": option("--size", metavar="WxH", parse="size", help="Pixels.  [default: 1000 wide or 800 high]"),
    "samples": option("--samples", type=int, help="Colours are means over N x N points a pixel.  [default: 1]"),
    "range": option(
        "--range", metavar="LOW:HIGH|seen|all", parse="color_range", help="Ends of the colour bar.  [default: seen]"
    ),
    "palette": option("--colormap", "--palette", "palette", metavar="NAME|FILE.xml", help=COLORMAP),
    "background": option("--background", metavar="COLOR", parse="color", help="[default: white]"),
    "lights": _many("--light", "lights", metavar="X,Y,Z[:I]", parse="light", help="A light; eye is the viewer's."),
    "ambient": option("--ambient", type=float, help="What lit surfaces show without lights.  [default: 0.3]"),
    "clip": _many("--clip", metavar="SURFACE", parse="clip", help="Show nothing inside (outside:…) of it."),
    "time": option("--time", type=float, help="What t stands for in formulas.  [default: the time of the data]"),
    "timeout": option("--timeout", type=float, help="Seconds after which an unfinished picture is given up."),
    "title": option("--title", help="Above the picture.  [default: the field]"),
    "plain": option("--plain", is_flag=True, default=None, help="The bare image, without anything beside it."),
    "device": option("--device", help="See elvis devices; reference computes in NumPy.  [default: auto]"),
    "outputs": _many("--output", "-o", "outputs", type=OUTPUT, help=".png, .exr, .npz; repeatable."),
    "stats": option("--stats", type=OUTPUT, help="Write seconds, bytes and counts as JSON."),
}


def scene_options(leaving: Sequence[str] = ()) -> Callable[[_Command], _Command]:
    """All OPTIONS for a command, in their order, but for some keys."""

    def decorate(command: _Command) -> _Command:
        for options in reversed([options for key, options in OPTIONS.items() if key not in leaving]):
            for option in reversed(options if isinstance(options, list) else [options]):
                command = option(command)
        return command

    return decorate
