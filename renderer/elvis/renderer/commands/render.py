"""``elvis render``: a picture from the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from elvis.formats.commands.arguments import Parsed, overwrite_option

if TYPE_CHECKING:
    from elvis.renderer.frame import Frame
    from elvis.renderer.scene import Scene

EPILOG = """\b
Examples:
  elvis render wing.xml wing.fld --field p --plane 0,0,0.2:0,0,1 -o wing.png
  elvis render plane.xml plane.fld --field u --range -1:1 --colormap coolwarm --contours 10 -o u.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0:1,1,0 --camera iso -o p.npz -o p.exr
  elvis render wing.xml wing.fld --faces wall --mesh-lines --cut sphere:0,0,0:0.5 --camera iso -o wall.png
  elvis render wing.xml wing.fld --isosurface 0.2,0.4 --opacity 0.5 --clip plane:0,0,0:0,1,0 -o iso.png
  elvis render wing.xml --field "sin(x)*exp(y)" --plane 0,0,0:0,0,1 -o waves.png
  elvis render wing.xml --field "distance('body.stl')" --isosurface 0.1 --camera iso -o near.png
  elvis render mine.dat --plugin my_plugin.py --plane 0,0,0:0,0,1 -o mine.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0:0,0,1 --camera 3,-4,2:0,0,0:0,0,1:30 -o view.png
  elvis render wing.xml wing.fld --faces all --save-scene wing.toml -o wing.png
  elvis render wing.toml --samples 3 --set objects[0].style.opacity=0.5 -o smooth.png
"""
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


def _option(*names: str, parse: str = "", **settings: Any) -> Callable[[_Command], _Command]:
    """An option whose text a function of `parameters`, imported when it is needed, reads."""

    def read(text: str) -> Any:
        from elvis.renderer.commands import parameters

        return getattr(parameters, parse)(text)

    if parse:
        settings["type"] = Parsed(read)
    return click.option(*names, **settings)


_many = partial(_option, multiple=True)

#: options by the key of the scene that they set
OPTIONS = {
    "field": _option("--field", "-f", help="What colours the picture: a field or a formula.  [default: the first]"),
    "plugin": _option("--plugin", metavar="NAME|FILE.py", help="The runtime plugin that opens DATA."),
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
        _option("--contours", metavar="N|V,V", parse="contours", help="N contour lines, or those of values."),
        _option("--mesh-lines", is_flag=True, default=None, help="Draw the borders of elements."),
        _option("--opacity", type=float, help="Of all objects, above 0 and at most 1."),
        _option("--lit/--unlit", default=None, help="Shade objects, or don't.  [default: faces and isosurfaces]"),
        _option("--color", metavar="COLOR", parse="color", help="One colour for all objects."),
    ],
    "camera": _option("--camera", metavar="VIEW", parse="camera", help=CAMERA),
    "size": _option("--size", metavar="WxH", parse="size", help="Pixels.  [default: 1000 wide or 800 high]"),
    "samples": _option("--samples", type=int, help="Colours are means over N x N points a pixel.  [default: 1]"),
    "range": _option(
        "--range", metavar="LOW:HIGH|seen|all", parse="color_range", help="Ends of the colour bar.  [default: seen]"
    ),
    "palette": _option("--colormap", "--palette", "palette", metavar="NAME|FILE.xml", help=COLORMAP),
    "background": _option("--background", metavar="COLOR", parse="color", help="[default: white]"),
    "lights": _many("--light", "lights", metavar="X,Y,Z[:I]", parse="light", help="A light; eye is the viewer's."),
    "ambient": _option("--ambient", type=float, help="What lit surfaces show without lights.  [default: 0.3]"),
    "clip": _many("--clip", metavar="SURFACE", parse="clip", help="Show nothing inside (outside:…) of it."),
    "time": _option("--time", type=float, help="What t stands for in formulas.  [default: the time of the data]"),
    "timeout": _option("--timeout", type=float, help="Seconds after which an unfinished picture is given up."),
    "title": _option("--title", help="Above the picture.  [default: the field]"),
    "plain": _option("--plain", is_flag=True, default=None, help="The bare image, without anything beside it."),
    "device": _option("--device", help="See elvis devices; reference computes in NumPy.  [default: auto]"),
    "outputs": _many("--output", "-o", "outputs", type=OUTPUT, help=".png, .exr, .npz; repeatable."),
    "stats": _option("--stats", type=OUTPUT, help="Write seconds, bytes and counts as JSON."),
}


def scene_options(leaving: Sequence[str] = ()) -> Callable[[_Command], _Command]:
    """All OPTIONS for a command, in their order, but for some keys."""

    def decorate(command: _Command) -> _Command:
        for options in reversed([options for key, options in OPTIONS.items() if key not in leaving]):
            for option in reversed(options if isinstance(options, list) else [options]):
                command = option(command)
        return command

    return decorate


@click.command(epilog=EPILOG, short_help="Draw cuts, faces, isosurfaces and volumes, exact at every pixel.")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@scene_options()
@_many("--set", "settings", metavar="KEY=VALUE", parse="setting", help="Any other key of the scene.")
@click.option("--save-scene", type=OUTPUT, help="Write the scene as it was drawn: .toml, .yaml, .json.")
@overwrite_option
def render(
    data: tuple[Path, ...],
    settings: tuple[tuple[str, str], ...],
    save_scene: Path | None,
    overwrite: bool,
    **options: Any,
) -> None:
    """Draw DATA (mesh and field files, in any order): every pixel from the solver's own functions.

    A scene file (.toml, .yaml, .json) may say all that the options say, and name the data.
    """
    from elvis.renderer.commands.composing import composed

    options["outputs"] = tuple(map(str, options["outputs"]))
    options["stats"] = options["stats"] and str(options["stats"])
    scene = composed(data, options, settings)
    _check_places(scene, data, save_scene, overwrite)
    frame = _frame(scene)
    _write(frame, scene, save_scene)
    _report(frame)


def _check_places(scene: Scene, data: tuple[Path, ...], save_scene: Path | None, overwrite: bool) -> None:
    """Errors about outputs, before any long work."""
    from elvis.core.files.output import check_places
    from elvis.formats.commands.arguments import inputs
    from elvis.renderer.saving import check_suffix
    from elvis.renderer.scene.files import check_scene_suffix, scene_text
    from elvis.renderer.scene.tables import input_files

    if not scene.outputs:
        raise click.UsageError("Missing option '--output' / '-o', and the scene names no outputs")
    for output in scene.outputs:
        check_suffix(Path(output))
    if save_scene:
        check_scene_suffix(save_scene)
        scene_text(scene, save_scene)
    written = [place for place in (*scene.outputs, scene.stats, save_scene) if place]
    check_places(written, [*inputs(data, scene.plugin), *input_files(scene)], overwrite)


def _frame(scene: Scene) -> Frame:
    """Read the data, or let a runtime plugin open them, and draw them."""
    from elvis.core.terminal import progress, warn
    from elvis.formats.commands.arguments import read_data
    from elvis.plugins.opening import open_files
    from elvis.renderer import SceneError
    from elvis.renderer import render as draw

    if not scene.data:
        raise SceneError("the scene names no data: give the mesh and field files too")
    files = tuple(map(Path, scene.data))
    dataset = open_files(files, scene.plugin, warn) or read_data(files)
    with progress("drawing") as told:
        return draw(dataset, scene, device=scene.device, progress=told)


def _write(frame: Frame, scene: Scene, save_scene: Path | None) -> None:
    """All files at once: pictures, numbers as JSON, and the scene with the camera and size that were found."""
    import json

    from elvis.core.files.output import Outputs, write_text
    from elvis.core.terminal import warn
    from elvis.renderer.scene.files import write_scene

    left_out: tuple[str, ...] = ()
    with Outputs() as outputs:
        for output in scene.outputs:
            frame.save(output, plain=scene.plain, outputs=outputs)
        if scene.stats:
            write_text(scene.stats, json.dumps(frame.stats, indent=2) + "\n", outputs)
        if save_scene:
            size = (frame.view.width, frame.view.height)
            left_out = write_scene(replace(scene, camera=frame.view.camera, size=size), save_scene, outputs)
    for key in left_out:
        warn(f"{save_scene}: without {key}, which goes further than a scene file may: give it as an option again")


def _report(frame: Frame) -> None:
    """Warnings; on a terminal also what is known of the pixels."""
    from elvis.core.terminal import warn

    counts = frame.counts()
    if counts["failed"]:
        warn(f"{counts['failed']} pixels failed: an element may be there, but its map did not invert")
    if counts["not_a_number"]:
        warn(f"{counts['not_a_number']} pixels, in magenta, show what is not a finite number")
    for remark in frame.stats.get("remarks", ()):
        warn(remark)
    if sys.stderr.isatty():
        click.echo(", ".join(f"{counts[name]} pixels {name}" for name in ("certain", "ambiguous", "failed")), err=True)
