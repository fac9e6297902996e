"""``elvis render``: a picture from the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from elvis.renderer.commands import parameters

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
CUT = "A surface that cuts 3D data: " + ", ".join(
    [f"{kind}:{form}" for kind, (_, form, _) in parameters.SURFACES.items()] + ["mesh:FILE, implicit:EXPRESSION."]
)
_Command = TypeVar("_Command", bound=Callable[..., Any])
OUTPUT = click.Path(path_type=Path, dir_okay=False)


def _many(*names: str, metavar: str, parse: parameters.Callback, help: str) -> Callable[[_Command], _Command]:
    """An option that can be given several times."""
    return click.option(*names, multiple=True, metavar=metavar, callback=parameters.each(parse), help=help)


def _one(*names: str, metavar: str | None = None, parse: parameters.Callback | None = None, help: str) -> Any:
    return click.option(*names, metavar=metavar, callback=parse, help=help)


#: options by the key of the scene that they set
OPTIONS = {
    "field": _one("--field", "-f", help="What colours the picture: a field or a formula.  [default: the first field]"),
    "plugin": _one("--plugin", metavar="NAME|FILE.py", help="The runtime plugin that opens DATA."),
    "plane": _many(
        "--plane", "planes", metavar="POINT:NORMAL", parse=parameters.plane, help="A cut plane; repeatable."
    ),
    "objects": [
        _many("--cut", "cuts", metavar="SURFACE", parse=parameters.surface, help=f"{CUT}  Repeatable."),
        _many(
            "--faces", metavar="NAMES", parse=parameters.faces, help="Faces: all, boundaries, element:ID, shape:NAME."
        ),
        _many("--isosurface", "isosurfaces", metavar="[Q=]V,V", parse=parameters.isosurface, help="Where Q is V."),
        _many(
            "--volume", "volumes", metavar="[Q=]V:D,V:D", parse=parameters.volume, help="Fog: density D where Q is V."
        ),
        _one("--contours", metavar="N|V,V", parse=parameters.contours, help="N contour lines, or those of values."),
        click.option("--mesh-lines", is_flag=True, default=None, help="Draw the borders of elements."),
        click.option("--opacity", type=float, help="Of all objects, above 0 and at most 1."),
        click.option("--lit/--unlit", default=None, help="Shade objects, or don't.  [default: faces and isosurfaces]"),
        _one("--color", metavar="COLOR", parse=parameters.color, help="One colour for all objects."),
    ],
    "camera": _one("--camera", metavar="VIEW", parse=parameters.camera, help=CAMERA),
    "size": _one("--size", metavar="WxH", parse=parameters.size, help="Pixels.  [default: 1000 wide or 800 high]"),
    "samples": click.option("--samples", type=int, help="Colours are means over N x N points a pixel.  [default: 1]"),
    "range": _one(
        "--range",
        metavar="LOW:HIGH|seen|all",
        parse=parameters.color_range,
        help="Ends of the colour bar.  [default: seen]",
    ),
    "palette": _one(
        "--colormap",
        "--palette",
        "palette",
        metavar="NAME|FILE.xml",
        help="A colour map of the cmap catalogue, elvis:NAME, or a file of ParaView or the first ElVis.  "
        "[default: viridis]",
    ),
    "background": _one("--background", metavar="COLOR", parse=parameters.color, help="[default: white]"),
    "lights": _many(
        "--light", "lights", metavar="X,Y,Z[:I]", parse=parameters.light, help="A light; eye is the viewer's."
    ),
    "ambient": click.option("--ambient", type=float, help="What lit surfaces show without lights.  [default: 0.3]"),
    "clip": _many("--clip", metavar="SURFACE", parse=parameters.clip, help="Show nothing inside (outside:…) of it."),
    "timeout": click.option("--timeout", type=float, help="Seconds after which an unfinished picture is given up."),
    "title": _one("--title", help="Above the picture.  [default: the field]"),
    "plain": click.option("--plain", is_flag=True, default=None, help="The bare image, without anything beside it."),
    "device": _one("--device", help="See elvis devices; reference computes in NumPy.  [default: auto]"),
    "outputs": click.option(
        "--output", "-o", "outputs", multiple=True, type=OUTPUT, help=".png, .exr, .npz; repeatable."
    ),
    "stats": click.option("--stats", type=OUTPUT, help="Write seconds, bytes and counts as JSON."),
}


def _scene_options(command: _Command) -> _Command:
    """The command with all OPTIONS, in their order."""
    every = [option for options in OPTIONS.values() for option in (options if isinstance(options, list) else [options])]
    for option in reversed(every):
        command = option(command)
    return command


@click.command(epilog=EPILOG, short_help="Draw cuts, faces, isosurfaces and volumes, exact at every pixel.")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@_scene_options
@_many("--set", "settings", metavar="KEY=VALUE", parse=parameters.setting, help="Any other key of the scene.")
@click.option("--save-scene", type=OUTPUT, help="Write the scene as it was drawn: .toml, .yaml, .json.")
def render(
    data: tuple[Path, ...], settings: tuple[tuple[str, str], ...], save_scene: Path | None, **options: Any
) -> None:
    """Draw DATA (mesh and field files, in any order): every pixel from the solver's own functions.

    A scene file (.toml, .yaml, .json) may say all that the options say, and name the data.
    """
    from elvis.renderer.commands.composing import composed

    options["mesh_lines"] = _mesh_lines(options["mesh_lines"])
    options["outputs"] = tuple(map(str, options["outputs"]))
    options["stats"] = options["stats"] and str(options["stats"])
    scene = composed(data, options, settings)
    _check_places(scene, save_scene)
    frame = _frame(scene)
    for output in scene.outputs:
        frame.save(output, plain=scene.plain)
    _write_rest(frame, scene, save_scene)
    _report(frame)


def _mesh_lines(wanted: bool | None) -> Any:
    from elvis.renderer.scene import MeshLines

    return MeshLines() if wanted else None


def _check_places(scene: Scene, save_scene: Path | None) -> None:
    """Errors about outputs, before any long work."""
    from elvis.formats.output import check_place
    from elvis.renderer.saving import check_suffix
    from elvis.renderer.scene.files import check_scene_suffix

    if not scene.outputs:
        raise click.UsageError("Missing option '--output' / '-o', and the scene names no outputs")
    for output in scene.outputs:
        check_suffix(Path(output))
    if save_scene:
        check_scene_suffix(save_scene)
    for place in (*scene.outputs, scene.stats, save_scene):
        if place:
            check_place(place)


def _frame(scene: Scene) -> Frame:
    """Read the data, or let a runtime plugin open them, and draw them."""
    from elvis.formats.commands.arguments import read_data
    from elvis.plugins.opening import open_files
    from elvis.renderer import SceneError
    from elvis.renderer import render as draw

    if not scene.data:
        raise SceneError("the scene names no data: give the mesh and field files too")
    files = tuple(map(Path, scene.data))
    dataset = open_files(files, scene.plugin, _warn) or read_data(files)
    with _progress() as progress:
        return draw(dataset, scene, device=scene.device, progress=progress)


@contextmanager
def _progress() -> Iterator[Callable[[int, int], object] | None]:
    """A bar on a terminal, which is told how much of how much is drawn."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("drawing", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _write_rest(frame: Frame, scene: Scene, save_scene: Path | None) -> None:
    """The numbers of a frame as JSON, and its scene with the camera and size that were found."""
    import json

    from elvis.formats.output import write_text
    from elvis.renderer.scene.files import write_scene

    if scene.stats:
        write_text(scene.stats, json.dumps(frame.stats, indent=2) + "\n")
    if save_scene:
        size = (frame.view.width, frame.view.height)
        write_scene(replace(scene, camera=frame.view.camera, size=size), save_scene)


def _report(frame: Frame) -> None:
    """Warnings; on a terminal also what is known of the pixels."""
    counts = frame.counts()
    if counts["failed"]:
        _warn(f"{counts['failed']} pixels failed: an element may be there, but its map did not invert")
    if counts["not_a_number"]:
        _warn(f"{counts['not_a_number']} pixels, in magenta, show what is not a finite number")
    for remark in frame.stats.get("remarks", ()):
        _warn(remark)
    if sys.stderr.isatty():
        click.echo(", ".join(f"{counts[name]} pixels {name}" for name in ("certain", "ambiguous", "failed")), err=True)


def _warn(sentence: str) -> None:
    click.echo(f"elvis: warning: {sentence}", err=True)
