"""``elvis render``: a picture from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.formats.commands.arguments import data_argument, read_data
from elvis.renderer.commands import parameters

if TYPE_CHECKING:
    from elvis.renderer.frame import Frame

EPILOG = """\b
Examples:
  elvis render wing.xml wing.fld --field p --plane 0,0,0.2:0,0,1 -o wing.png
  elvis render plane.xml plane.fld --field u --range -1:1 --colormap coolwarm -o u.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0:1,1,0 --camera iso -o p.npz -o p.exr
  elvis render wing.xml --field "sin(x)*exp(y)" --plane 0,0,0:0,0,1 -o waves.png
  elvis render mine.dat --plugin my_plugin.py --plane 0,0,0:0,0,1 -o mine.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0:0,0,1 --camera 3,-4,2:0,0,0:0,0,1:30 -o view.png
"""
CAMERA = (
    "fit (straight at the plane), +x, -x, +y, -y, +z, -z (look along an axis), iso, or eye:at[:up[:degrees]]; "
    "orthographic and fitted to what is seen unless degrees are given."
)
OUTPUT = click.Path(path_type=Path, dir_okay=False)


@click.command(epilog=EPILOG, short_help="Draw a cut plane or a 2D solution, exact at every pixel.")
@data_argument
@click.option(
    "--field",
    "-f",
    help='The field that colours the picture, or a formula such as "sin(x)*exp(y)".  [default: the first]',
)
@click.option("--plugin", metavar="NAME|FILE.py", help="The runtime plugin that opens DATA.  [default: one that can]")
@click.option("--plane", metavar="POINT:NORMAL", callback=parameters.plane, help="The cut plane, for 3D data.")
@click.option("--camera", metavar="VIEW", default="fit", show_default=True, callback=parameters.camera, help=CAMERA)
@click.option(
    "--size",
    metavar="WxH",
    callback=parameters.size,
    help="Pixels of the image.  [default: 1000 wide or 800 high, in the proportions of what is seen]",
)
@click.option(
    "--range",
    "range_",
    metavar="LOW:HIGH",
    callback=parameters.color_range,
    help="Values at the ends of the colour bar.  [default: what is seen]",
)
@click.option("--colormap", default="viridis", show_default=True, help="A colour map of the cmap catalogue.")
@click.option("--plain", is_flag=True, help="The bare image, without colour bar and title.")
@click.option("--device", default="auto", show_default=True, help="See elvis devices; reference computes in NumPy.")
@click.option(
    "--output", "-o", "outputs", multiple=True, required=True, type=OUTPUT, help=".png, .exr, .npz; repeatable."
)
@click.option("--stats", type=OUTPUT, help="Write seconds, bytes and counts as JSON.")
def render(data: tuple[Path, ...], outputs: tuple[Path, ...], stats: Path | None, plain: bool, **options: Any) -> None:
    """Draw DATA (mesh and field files, in any order): every pixel from the solver's own functions."""
    from elvis.formats.output import check_place
    from elvis.renderer.saving import check_suffix

    for output in outputs:
        check_suffix(output)
    for place in (*outputs, *([stats] if stats else [])):
        check_place(place)
    frame = _frame(data, **options)
    for output in outputs:
        frame.save(output, plain=plain)
    if stats:
        _write_stats(frame, stats)
    failed = frame.counts()["failed"]
    if failed:
        _warn(f"{failed} pixels failed: an element may be there, but its map did not invert")
    for remark in frame.stats.get("remarks", ()):
        _warn(remark)


def _warn(sentence: str) -> None:
    click.echo(f"elvis: warning: {sentence}", err=True)


def _frame(
    data: tuple[Path, ...], field: str | None, plugin: str | None, colormap: str, device: str, **options: Any
) -> Frame:
    """Read the data, or let a runtime plugin open them, and draw them."""
    from elvis.formats.terminal import stage
    from elvis.plugins.opening import open_files
    from elvis.renderer import Scene, default_field
    from elvis.renderer import render as draw

    dataset = open_files(data, plugin, _warn) or read_data(data)
    scene = Scene(
        field=field or default_field(dataset),
        plane=options["plane"],
        camera=options["camera"],
        size=options["size"],
        palette=colormap,
        range=options["range_"],
    )
    with stage("drawing"):
        return draw(dataset, scene, device=device)


def _write_stats(frame: Frame, path: Path) -> None:
    """The numbers of a frame as JSON."""
    import json

    from elvis.formats.output import write_text

    write_text(path, json.dumps(frame.stats, indent=2) + "\n")
