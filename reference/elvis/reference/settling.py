"""Extensions of a plain picture: colour ranges of whole fields, several samples per pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from elvis.reference.sources import Source
from elvis.scene import Glyphs, Scene, SceneObject, Streamlines, VolumeRendering
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Drawing, Frame
from elvis.scene.record.palette import automatic_range

Draw = Callable[[Source, Scene], Frame]


def settle_range(source: Source, scene: Scene) -> Scene:
    """The scene with the range ``all`` replaced by two values: certified bounds; raises SceneError without bounds."""
    if scene.range != "all":
        return scene

    def settle_styles(item: SceneObject) -> SceneObject:
        if isinstance(item, VolumeRendering) or item.style.quantity is None or item.style.range is not None:
            return item
        return replace(
            item,
            style=replace(item.style, range=_bounds(source, item.style.quantity, item.style.palette or scene.palette)),
        )

    return replace(
        scene, range=_bounds(source, scene.field, scene.palette), objects=tuple(map(settle_styles, scene.objects))
    )


def _bounds(source: Source, name: str, palette: str) -> tuple[float, float]:
    found = source.bounds(name)
    if found is None:
        raise SceneError(f"no bounds of {name!r} over all data are known: use two values for the range, or visible")
    return automatic_range(found, palette)


def supersample(draw: Draw, source: Source, scene: Scene) -> Frame:
    """The picture with colours averaged over n x n points of each pixel; records belong to its centre."""
    frame, n = draw(source, replace(scene, samples=1)), scene.samples
    height, width = frame.status.shape
    fine = replace(_finer(frame.scene, n), camera=frame.view.camera, size=(n * width, n * height))
    color = draw(source, replace(fine, range=frame.range)).color
    mean = color.reshape(height, n, width, n, 3).mean(axis=(1, 3))
    told = frame.drawing.line_status if frame.drawing else None
    drawing = Drawing(frame.depth, frame.normal, mean, frame.legends, frame.uncertainty, told)
    return replace(frame, scene=replace(frame.scene, samples=n), drawing=drawing)


def _finer(scene: Scene, n: int) -> Scene:
    """The scene for pictures with n times the pixels each way: lines are as many times wider in pixels."""

    def widen(item: SceneObject) -> SceneObject:
        if isinstance(item, VolumeRendering | Glyphs):
            return item
        if isinstance(item, Streamlines):
            return replace(item, width=item.width and n * item.width)
        style, kept = item.style, {}
        for name in ("contours", "mesh_lines"):
            lines = getattr(style, name)
            kept[name] = lines and replace(lines, width=n * lines.width)
        lic = style.lic
        kept["lic"] = lic and replace(lic, length=n * lic.length, width=n * lic.width)
        return replace(item, style=replace(style, **kept))

    return replace(scene, objects=tuple(map(widen, scene.objects)))
