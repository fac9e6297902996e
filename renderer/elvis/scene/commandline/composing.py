"""Scenes from a scene file and options; options come last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.scene.model.errors import SceneError

if TYPE_CHECKING:
    from elvis.scene import Scene, SceneObject
    from elvis.scene.record.frame import Frame

#: settings of a style that apply only to surfaces
LINES = ("contours", "mesh_lines", "lic")
#: keys that a scene file may set within limits, and options without
OVERRIDDEN = {"outputs", "stats", "plugin"}


def composed(
    files: tuple[Path, ...],
    options: dict[str, Any],
    settings: tuple[tuple[str, str], ...],
    unused: tuple[str, ...] = (),
    base: Scene | None = None,
) -> Scene:
    """The scene of a scene file among ``files``, else ``base`` or the default scene, changed by the options.

    options   scene keys to values, None for options that were not given; planes and OBJECTS are added to the objects,
              STYLES apply to every object
    settings  pairs of a key such as ``objects[0].style.opacity`` and a TOML value
    unused    keys of a scene file that have no meaning for the caller
    """
    from elvis.scene import CutSurface, Plane, Scene
    from elvis.scene.commandline.options import OBJECTS, STYLES
    from elvis.scene.model.files import is_scene_file, read_scene

    scene_files = [file for file in files if is_scene_file(file)]
    if len(scene_files) > 1:
        options, scene_files = {**options, "scenes": tuple(map(str, scene_files))}, []
    given = {key: value for key, value in options.items() if value is not None and value != ()}
    scene = read_scene(scene_files[0], (*(OVERRIDDEN & given.keys()), *unused)) if scene_files else base or Scene()
    style = {key: given.pop(key) for key in STYLES if key in given}
    scene = _with_copies(_with_deform(scene, given), given)

    # one plane without a style of its own is the shortcut
    cuts = [CutSurface(plane) for plane in given.pop("plane", ())]
    cuts += given.pop("cut", ())
    others = [item for key in OBJECTS for item in given.pop(key, ())]
    if len(cuts) == 1 and isinstance(cuts[0].surface, Plane) and not (others or style or scene.every_object):
        given["plane"] = cuts.pop().surface
    data = tuple(str(file) for file in files if not is_scene_file(file))
    scene = replace(scene, **given, objects=(*scene.objects, *cuts, *others), data=data or scene.data)
    scene = _apply_style(scene, style) if style else scene
    return with_settings(scene, settings)


def outputs_of_file(
    scene: Scene, files: tuple[Path, ...], options: dict[str, Any], settings: tuple[tuple[str, str], ...]
) -> tuple[str, ...]:
    """The outputs of a composed scene that its scene file names; none that the command line names."""
    from elvis.scene.model.files import is_scene_file
    from elvis.scene.model.tables import steps_of

    if not any(map(is_scene_file, files)):
        return ()
    given = {key for key, value in options.items() if value}
    given |= {str(steps_of(key)[0]) for key, _ in settings}
    outputs = () if "outputs" in given else scene.outputs
    stats = () if "stats" in given or scene.stats is None else (scene.stats,)
    return (*outputs, *stats)


def panels(scene: Scene) -> tuple[Scene, ...]:
    """The scenes of a figure's panels, with what the scene that lists them says for all; itself where it lists none."""
    from elvis.scene.model.files import read_scene
    from elvis.scene.model.settings import given_values

    given = {key: value for key, value in given_values(scene).items() if key not in ("scenes", "title")}
    listed = tuple(replace(read_scene(file, OVERRIDDEN), **given) for file in scene.scenes)
    rows, columns = scene.panels or (1, len(listed))
    if rows * columns < len(listed):
        raise SceneError(f"panels: expected room for {len(listed)} scenes, found {rows} x {columns}")
    return listed or (scene,)


def in_one_range(frames: Sequence[Frame]) -> tuple[float, float] | None:
    """The range of all that several pictures show, where they show the same field in the same automatic colours."""
    maps = [[legend for legend in frame.legends if legend.palette] for frame in frames]
    free = all(frame.scene.range in (None, "visible") for frame in frames)
    alike = {(frame.scene.field, frame.scene.palette) for frame in frames}
    if not free or len(alike) != 1 or any(len(own) != 1 or own[0].title != frames[0].scene.field for own in maps):
        return None
    return min(frame.range[0] for frame in frames), max(frame.range[1] for frame in frames)


def _with_deform(scene: Scene, given: dict[str, Any]) -> Scene:
    """The scene with the deformation of the options, which are removed from ``given``."""
    from elvis.scene.commandline.options import DEFORM
    from elvis.scene.model.whole import Deform

    own = given.pop("deform", scene.deform)
    parts = {name: given.pop(f"deform_{name}") for name in DEFORM if f"deform_{name}" in given}
    if parts and own is None and "height" not in parts:
        raise SceneError(f"expected --deform or --height with --{next(iter(parts))}")
    if parts:
        own = Deform(**parts) if own is None else replace(own, **parts)
    return replace(scene, deform=own)


def _with_copies(scene: Scene, given: dict[str, Any]) -> Scene:
    """The scene with the copies of the options, which are removed from ``given``."""
    from elvis.scene.commandline.options import COPIES
    from elvis.scene.model.copies import Copies

    own = given.pop("copies", scene.copies)
    parts = {name: given.pop(f"copies_{name}") for name in COPIES if f"copies_{name}" in given}
    if parts:
        own = Copies(**parts) if own is None else replace(own, **parts)
    return replace(scene, copies=own)


def _apply_style(scene: Scene, style: dict[str, Any]) -> Scene:
    """The scene with values of the style in every object; without objects, of all outer faces."""
    from elvis.scene import Faces, Glyphs, Streamlines, VolumeRendering

    def with_style(item: SceneObject) -> SceneObject:
        if isinstance(item, VolumeRendering):
            return item
        own = {
            key: value for key, value in style.items() if key not in LINES or not isinstance(item, Streamlines | Glyphs)
        }
        return replace(item, style=replace(item.style, **own))

    objects = scene.every_object or (Faces(),)
    return replace(scene, plane=None, objects=tuple(map(with_style, objects)))


def with_settings(scene: Scene, settings: tuple[tuple[str, str], ...], option: str = "--set") -> Scene:
    """The scene with single keys, such as ``objects[0].style.opacity``, set to TOML values.

    option  by which they are given, for errors
    """
    from elvis.scene.model.files import toml_value
    from elvis.scene.model.tables import scene_of, steps_of, table_of

    if not settings:
        return scene
    table = table_of(scene)
    for key, text in settings:
        *way, last = steps_of(key)
        place: Any = table
        try:
            for step in way:
                place = place[step] if isinstance(step, int) else place.setdefault(step, {})
            place[last] = toml_value(text)
        except (IndexError, TypeError, KeyError, AttributeError) as error:
            raise SceneError(f"{option} {key}: the scene has no such key") from error
    return scene_of(table)
