"""Defaults of a scene that depend on the data: its field, its objects, and the plugin that draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, cast

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.axis_planes import box_of
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.core.summary.picturing import Kind
from elvis.plugins.command.registry import load, plugins
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import names_of, volume_of
from elvis.plugins.runtime.volume import corners_of_volume
from elvis.renderer.device.adapters import KINDS
from elvis.renderer.frame.copy_checks import with_periods
from elvis.scene import CutSurface, Faces, Glyphs, Plane, Scene, Streamlines
from elvis.scene.model.errors import SceneError
from elvis.scene.model.middle_planes import with_middles
from elvis.scene.model.objects import SceneObject
from elvis.scene.model.quantities import quantities, with_velocities
from elvis.scene.record.frame import Frame

if TYPE_CHECKING:
    from elvis.renderer.parts.bricks import Bricks
    from elvis.renderer.parts.parts import RankPart

#: how names of elements begin among those of faces
ELEMENT_WORDS = ("element:", "shape:", "region:")
#: what a plugin of ``elvis.devices`` is
Drawing: TypeAlias = Callable[[Dataset | PluginData, Scene], Frame]


def other_device(device: str) -> Drawing | None:
    """The device plugin of that name; None for the devices of this renderer, which is the plugin ``auto``."""
    if device.split(":")[0] in ("auto", *KINDS) or device not in plugins("elvis.devices"):
        return None
    return cast(Drawing, load("elvis.devices", device))


def default_field(data: Dataset | PluginData) -> str:
    """The first field; SceneError where the data have none."""
    names = names_of(data).fields
    if not names:
        raise SceneError(
            "the data contain a mesh but no field: also pass the field file, or name a quantity, such as --field x"
        )
    return names[0]


def located(scene: Scene, data: Dataset | PluginData, source: Bricks | RankPart | None) -> Scene:
    """The scene with its field, with planes through the middle of the data, and copies by their periods.

    source  the whole, if data are only some of its elements
    """

    def corners() -> Floats:
        if source is not None:
            return source.corners
        if isinstance(data, Dataset):
            return box_of(data)
        return corners_of_volume(volume_of(data, data.fields[:1]))

    scene = scene if scene.field else replace(scene, field=default_field(data))
    return with_middles(with_periods(scene, data), corners)


def kind_of(data: Dataset | PluginData, scene: Scene) -> Kind:
    """The kind of picture, by dimension."""
    return Kind.of(data) if isinstance(data, Dataset) else Kind(volume_of(data, quantities(scene)).dimension)


def completed(dataset: Dataset, scene: Scene) -> Scene:
    """The scene with its quantity checked and its objects: 2D data and surfaces show themselves."""
    kind = Kind.of(dataset)
    return arranged(with_velocities(with_quantity(scene, dataset), names_of(dataset), kind), kind)


def with_quantity(scene: Scene, data: Dataset | PluginData) -> Scene:
    """The scene, if its field is a quantity of the data; SceneError where it is none."""
    try:
        Expression.parse(scene.field, names_of(data))
    except ElvisError as error:
        raise SceneError(str(error)) from error
    return scene


def arranged(scene: Scene, kind: Kind) -> Scene:
    """The scene with its objects: where none are given, 2D data in their plane, and outer faces of the rest."""
    # 2D data that are drawn show their domain themselves
    is_flat = kind is Kind.PLANE and any(isinstance(item, CutSurface) for item in scene.every_object)
    scene = replace(scene, domain_outline=scene.shows_domain and not is_flat)
    if kind is Kind.LINE:
        return scene
    if kind is Kind.SURFACE and any(not isinstance(item, Faces | Streamlines | Glyphs) for item in scene.every_object):
        raise SceneError("surfaces in space are drawn as they are: remove cuts, isosurfaces and volumes")
    if kind is Kind.PLANE:
        ground = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        if not scene.every_object:
            return replace(scene, plane=ground)
        _check_faces(scene)
        if any(isinstance(item, CutSurface) and item.surface != ground for item in scene.every_object):
            raise SceneError("2D data are drawn in their own plane: remove the cut plane")
        objects = tuple(_in_plane(item, ground) for item in scene.objects)
        shown = replace(scene, objects=objects)
        return shown if shown.only_plane or scene.camera != "fit" else replace(shown, camera="top")
    return scene if scene.every_object else replace(scene, objects=(Faces(),))


def _check_faces(scene: Scene) -> None:
    """Raise SceneError for faces of 2D data that are not their elements."""
    for item in scene.every_object:
        for name in item.select if isinstance(item, Faces) else ():
            if name != "all" and not name.startswith(ELEMENT_WORDS):
                known = ", ".join(f"{word}NAME" for word in ELEMENT_WORDS)
                raise SceneError(f"faces of 2D data are their elements: expected all, {known}, found {name!r}")


def _in_plane(item: SceneObject, ground: Plane) -> SceneObject:
    """An object of a scene of 2D data: all elements become a cut by their plane, and some stay faces, unlit."""
    if not isinstance(item, Faces):
        return item
    if "all" in item.select:
        return CutSurface(ground, item.style)
    return replace(item, style=replace(item.style, lit=bool(item.style.lit)))
