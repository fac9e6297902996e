"""``elvis render``: a picture from the command line."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from elvis.core.data.arguments import cache_option, overwrite_option
from elvis.plugins.command.running import shared
from elvis.renderer.commands.page_views import PageViews, page_options
from elvis.scene.commandline.command import OUTPUT, SceneCommand, setting_option

if TYPE_CHECKING:
    from elvis.core.base.ranks import Ranks
    from elvis.plugins.data.data import Opening
    from elvis.renderer.parts.bricks import PictureData
    from elvis.scene import Scene
    from elvis.scene.record.frame import Frame

T = TypeVar("T")
#: share of the visible pixels above which ambiguous pixels are reported
SHARE = 0.01
#: why pixels are not certain
UNSURE = {
    "failed": "an element may cover them, but its map could not be inverted",
    "ambiguous": "they lie within rounding of an element border, an edge or another surface, or it is not proved "
    "that their surface is the nearest one; -o record.npz stores the status of each pixel",
}
#: part of a plane cut that is ambiguous where the plane runs along borders, and what to make of it
ALONG = 0.5
BESIDE = (
    "the plane runs along borders of elements, so each pixel shows one of two neighbours, which have the same value "
    "where the field is continuous; move the plane by a millionth of the domain for certain pixels"
)
EPILOG = """\b
Examples:
  elvis render flow.vtu                                      writes flow.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0.2:0,0,1 -o wing.png
  elvis render plane.xml plane.fld --field u --range -1:1 --colormap coolwarm --contours 10 -o u.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0:1,1,0 --camera iso -o p.npz -o p.exr
  elvis render wing.xml wing.fld --faces wall --mesh-lines --cut sphere:0,0,0:0.5 --camera iso -o wall.png
  elvis render wing.xml wing.fld --isosurface 0.2,0.4 --opacity 0.5 --clip plane:0,0,0:0,1,0 -o iso.png
  elvis render wing.xml wing.fld --plane 0,0,0.2:0,0,1 --glyphs "plane:0,0,0.2:0,0,1:30;length=0.05" -o arrows.png
  elvis render wing.xml wing.fld --glyphs "points.csv;shape=cone" --set objects[0].style.quantity=speed -o cones.png
  elvis render wing.xml wing.fld --field speed --plane 0,0,0.2:0,0,1 --lic -o streaks.png
  elvis render wing.xml --field "sin(x)*exp(y)" --plane 0,0,0:0,0,1 -o waves.png
  elvis render wing.xml --field "distance('body.stl')" --isosurface 0.1 --camera iso -o near.png
  elvis render mine.dat --plugin my_plugin.py --plane 0,0,0:0,0,1 -o mine.png
  elvis render wing.xml wing.fld --field p --plane 0,0,0:0,0,1 --camera 3,-4,2:0,0,0:0,0,1:30 -o view.png
  elvis render wing.xml wing.fld --faces all --save-scene wing.toml -o wing.png
  elvis render wing.xml wing.fld --plane 0,0,0.2:0,0,1 --contours 10:labels --axes --bar unit=Pa,bands=8 -o wing.pdf
  elvis render wing.xml wing.fld --faces wall --camera iso --directions 12 -o wing.html
  elvis render wave.xml wave_*.chk --times all -o wave.html
  elvis render a.toml b.toml c.toml d.toml --panels 2x2 -o four.svg
  elvis render wing.toml --samples 3 --set objects[0].style.opacity=0.5 -o smooth.png
"""


@click.command(
    cls=SceneCommand, epilog=EPILOG, short_help="Draw cuts, faces, isosurfaces and volumes, exact at every pixel."
)
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@setting_option
@page_options
@click.option("--save-scene", type=OUTPUT, help="Write the scene that was drawn as .toml, .yaml or .json.")
@overwrite_option
@cache_option
@shared
def render(
    ranks: Ranks,
    data: tuple[Path, ...],
    settings: tuple[tuple[str, str], ...],
    views: PageViews,
    save_scene: Path | None,
    overwrite: bool,
    no_cache: bool,
    **options: Any,
) -> None:
    """Draw DATA (mesh and field files, in any order); every pixel comes from the solver's own functions.

    Without --output the picture is named after the scene or the first file, in the current folder, with a number if
    that name is taken.  A scene file (.toml, .yaml, .json) can contain all settings of the options and name the data.
    """
    from elvis.core.base.terminal import note, say, warn
    from elvis.renderer.asking.series_range import with_range
    from elvis.renderer.parts.bricks import peak_note
    from elvis.scene.commandline.composing import composed, outputs_of_file, panels
    from elvis.scene.model.ownership import check_own

    scene = composed(data, options, settings)
    is_named = bool(scene.outputs)
    suffix = ".html" if views.are_several else ".png"
    scene = scene if is_named else replace(scene, outputs=(_free_name(data, overwrite, suffix),))
    _check_places(scene, data, save_scene, overwrite)
    views.check(scene, ranks.size)
    if not overwrite:
        check_own(outputs_of_file(scene, data, options, settings))
    scenes = tuple(with_range(each, not no_cache, ranks=ranks) for each in panels(scene))
    if views.are_several:
        scenes = views.in_time(scenes[0], not no_cache)
    opened = _opened(scenes, not no_cache, ranks)
    scenes = views.seen(scenes, opened[_key(scenes[0])])
    frames, notes = _frames(scenes, opened, ranks)
    if ranks.rank:
        return
    _write(frames, scene, views, save_scene)
    for frame in frames:
        _report_counts(frame)
    for remark in dict.fromkeys(remark for frame in frames for remark in frame.remarks):
        (note if remark in notes else warn)(remark)
    if peak := peak_note(scenes[0]):
        note(peak)
    if not is_named:
        say(f"wrote {scene.outputs[0]}")


def _free_name(data: tuple[Path, ...], overwrite: bool, suffix: str) -> str:
    """The picture where none is named: in the current folder, after the scene or the first file; nothing stands there.

    overwrite  whether something may
    """
    from itertools import count

    from elvis.scene.model.files import is_scene_file

    first = next(filter(is_scene_file, data), data[0])
    stem = Path(os.path.basename(os.path.abspath(first)).removesuffix(".gz")).stem
    names = (f"{stem}{suffix}" if number == 1 else f"{stem}-{number}{suffix}" for number in count(1))
    return next(name for name in names if overwrite or not os.path.lexists(name))


def _check_places(scene: Scene, data: tuple[Path, ...], save_scene: Path | None, overwrite: bool) -> None:
    """Errors about outputs, before any long work."""
    from elvis.core.data.arguments import inputs
    from elvis.core.files.output import check_places
    from elvis.scene.figure.saving import check_suffix
    from elvis.scene.model.files import check_scene_suffix, scene_text
    from elvis.scene.model.tables import input_files

    for output in scene.outputs:
        check_suffix(Path(output))
    if save_scene:
        check_scene_suffix(save_scene)
        scene_text(scene, save_scene)
    written = [place for place in (*scene.outputs, scene.stats, save_scene) if place]
    check_places(written, [*inputs(data, scene.plugin), *input_files(scene)], overwrite)


def _opened(scenes: tuple[Scene, ...], is_kept: bool, ranks: Ranks) -> dict[object, PictureData]:
    """The data of scenes by their dependencies, each opened once; with ranks, only the parts that are needed."""
    from elvis.renderer.parts.bricks import opening_for
    from elvis.renderer.parts.parts import of_ranks, opening_for_ranks

    alike: dict[object, list[Scene]] = {}
    for scene in scenes:
        alike.setdefault(_key(scene), []).append(scene)
    if ranks.size == 1:
        return {key: _open(some, opening_for(some), is_kept) for key, some in alike.items()}
    parts = {key: _open(some, opening_for_ranks(some, ranks), is_kept) for key, some in alike.items()}
    return dict(of_ranks(parts, alike, ranks))


def _frames(
    scenes: tuple[Scene, ...], opened: dict[object, PictureData], ranks: Ranks
) -> tuple[list[Frame], list[str]]:
    """The pictures of scenes, and notes on their data; on the first rank, while the others have their own rows.

    Pictures that are coloured by the same field share one range, so that one bar is valid for all.
    """
    from itertools import compress

    from elvis.plugins.runtime.opening import PluginData
    from elvis.renderer.asking.completing import other_device
    from elvis.renderer.parts.bricks import Bricks
    from elvis.renderer.parts.parts import RankPart
    from elvis.scene.commandline.composing import in_one_range

    is_several = len(scenes) > 1
    data = [opened[_key(scene)] for scene in scenes]
    if ranks.rank:
        # other devices draw all rows at once, for the first rank
        chosen = [not other_device(scene.device) for scene in scenes]
        data, scenes = list(compress(data, chosen)), tuple(compress(scenes, chosen))
    frames = _drawn(data, scenes, ranks)
    if is_several:
        shared = ranks.exchange(None if ranks.rank else in_one_range(frames), "a range")[0]
        if shared is not None:
            scenes = tuple(replace(scene, range=shared) for scene in scenes)
            frames = _drawn(data, scenes, ranks)
    every = [own.dataset if isinstance(own, RankPart | Bricks) else own for own in opened.values()]
    datasets = [own for own in every if not isinstance(own, PluginData)]
    rates = [own.rates.remark for own in datasets if own.rates is not None]
    return frames, [*rates, *(remark for own in datasets for remark in own.remarks)]


def _key(scene: Scene) -> object:
    """Key of everything that the data of a scene depend on."""
    of_files = (scene.data, scene.plugin, scene.reader, scene.others, scene.reference, scene.deform)
    return *of_files, scene.step, scene.time, scene.between


def _open(scenes: list[Scene], opening: Opening[T], is_kept: bool) -> T:
    """The data of scenes, which are the same, as ``opening`` gives them."""
    from elvis.core.base.terminal import warn
    from elvis.renderer.asking.request import reading_for
    from elvis.scene.model.errors import SceneError

    data = scenes[0].data
    if not data:
        raise SceneError("the scene names no data; also give the mesh and field files")
    return opening(tuple(map(Path, data)), reading_for(scenes, is_kept), warn)


def _drawn(data: list[PictureData], scenes: tuple[Scene, ...], ranks: Ranks) -> list[Frame]:
    """The pictures of scenes, each of its data; neighbours of the same data share them on the device."""
    from itertools import groupby

    from elvis.core.base.terminal import progress
    from elvis.renderer.frame.rendering import Pictures

    frames = []
    pairs = zip(data, scenes, strict=True)
    for _, group in groupby(pairs, key=lambda pair: (id(pair[0]), pair[1].device)):
        alike = list(group)
        opened, first = alike[0]
        with progress("drawing") as told, Pictures(opened, first.device, told, ranks) as pictures:
            frames += [pictures.draw(scene) for _, scene in alike]
    return frames


def _write(frames: list[Frame], scene: Scene, views: PageViews, save_scene: Path | None) -> None:
    """All files at once: pictures, numbers as JSON, and the scene with the camera and size that were found."""
    import json

    from elvis.core.base.terminal import warn
    from elvis.core.files.output import Outputs, write_text
    from elvis.scene.figure.saving import save_panels, save_views
    from elvis.scene.model.files import write_scene
    from elvis.scene.model.ownership import SOFTWARE

    frame = frames[0]
    left_out: tuple[str, ...] = ()
    with Outputs() as outputs:
        for output in scene.outputs:
            if scene.scenes:
                save_panels(frames, Path(output), plain=scene.plain, outputs=outputs)
            elif views.are_several:
                save_views(frames, views.angles, Path(output), plain=scene.plain, outputs=outputs)
            else:
                frame.save(output, plain=scene.plain, outputs=outputs)
        if scene.stats:
            key = "panels" if scene.scenes else "directions" if views.times is None else "views"
            is_several = scene.scenes or len(frames) > 1
            told = {key: [one.stats for one in frames]} if is_several else frame.stats
            write_text(scene.stats, json.dumps({"software": SOFTWARE, **told}, indent=2) + "\n", outputs)
        if save_scene:
            size = (frame.view.width, frame.view.height)
            drawn = scene if scene.scenes else replace(scene, camera=frame.view.camera, size=size)
            left_out = write_scene(drawn, save_scene, outputs)
    for key in left_out:
        warn(f"{save_scene}: {key} is omitted, as a scene file may not contain it; give it as an option again")


def _report_counts(frame: Frame) -> None:
    """Print warnings about pixels; on a terminal also their status counts."""
    from elvis.core.base.terminal import warn

    counts = frame.counts()
    shown = max(1, sum(counts[name] for name in ("certain", "ambiguous", "failed")))
    reasons = dict(UNSURE)
    if frame.scene.only_plane and counts["ambiguous"] > ALONG * shown:
        reasons["ambiguous"] = BESIDE
    for name, reason in reasons.items():
        if counts[name] > (0 if name == "failed" else SHARE * shown):
            verb = "failed" if name == "failed" else f"are {name}"
            warn(f"{counts[name]} pixels {verb}, {100 * counts[name] / shown:.3g} % of the visible pixels: {reason}")
    if counts["not_a_number"]:
        end = ", or lie outside the other data" if frame.scene.others else ""
        warn(f"{counts['not_a_number']} pixels, in magenta, have values that are not finite{end}")
    if sys.stderr.isatty():
        click.echo(", ".join(f"{counts[name]} pixels {name}" for name in ("certain", "ambiguous", "failed")), err=True)
