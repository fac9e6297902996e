"""Copies of the data in pictures: the same stages draw them, seen from where the copy is the data.

A copy X = R x + s looks in a view as the data look in the view that is moved by the inverse.  Surfaces that are given
in space are moved likewise, and quantities are those of the copy as functions of the data (`moved_expressions`).  A
copy has no elements, fields or buffers of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as default
from functools import cached_property
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.deformed.isometries import Isometry
from elvis.core.mapping.boxes import Boxes
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.moved_expressions import moved
from elvis.core.quantities.tree import Node
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.scene import Clip, CutSurface, Implicit, Isosurface, Light, Scene, SceneObject, Style, VolumeRendering
from elvis.scene.cameras.fitting import surrounding
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError
from elvis.scene.model.moved_surfaces import moved_back
from elvis.scene.model.quantities import quantities
from elvis.scene.model.surfaces import Surface

Styled = TypeVar("Styled", bound=Any)


@dataclass(frozen=True, eq=False)
class Copy:
    """One copy of the data.

    number    0 is the data themselves
    isometry  x -> R x + s from the data to the copy
    field     text of the scene's field
    names     of quantities on the device that are the copy's, by those of the scene, where they differ
    """

    number: int
    isometry: Isometry
    field: str
    names: Mapping[str, str]
    _views: WeakKeyDictionary[View, View] = default(default_factory=WeakKeyDictionary)

    def on_device(self, quantity: str | None) -> str | None:
        """The quantity of the data that a quantity of the scene is on the copy; None is the scene's field."""
        return self.names.get(self.field if quantity is None else quantity, quantity)

    @cached_property
    def _texts(self) -> dict[str, str]:
        """Quantities of the scene by those of the data."""
        return {own: text for text, own in self.names.items()}

    def in_scene(self, quantity: str | None) -> str | None:
        """The quantity of the scene that a quantity of the data is; None is the scene's field."""
        text = quantity if quantity is None else self._texts.get(quantity, quantity)
        return None if text == self.field else text

    def view(self, view: View) -> View:
        """The view in which the data look as the copy does in a view."""
        if self.isometry.is_identity:
            return view
        if view not in self._views:
            self._views[view] = view.before(self.isometry)
        return self._views[view]

    def lights(self, lights: Sequence[Light]) -> tuple[Light, ...]:
        """The lights, as they shine on the data."""
        return tuple(_moved_light(light, self.isometry) for light in lights)

    def scene(self, scene: Scene) -> Scene:
        """The scene of the data that shows what a scene shows of the copy."""
        return replace(scene, plane=None, objects=tuple(map(self._item, scene.every_object)))

    def clips(self, clips: Sequence[Clip]) -> tuple[Clip, ...]:
        """The clips, as they clip the data."""
        return tuple(replace(clip, surface=self._surface(clip.surface)) for clip in clips)

    def in_terms_of_scene(self, call: DrawCall) -> DrawCall:
        """A draw call of the data as one of the copy: its quantities are named as in the scene."""
        contours = call.style.contours
        if contours is not None:
            contours = replace(contours, quantity=self.in_scene(contours.quantity))
        style = replace(call.style, quantity=self.in_scene(call.style.quantity), contours=contours)
        return replace(call, style=style, quantity=self.in_scene(call.quantity), copy=self)

    def _surface(self, surface: Surface) -> Surface:
        if isinstance(surface, Implicit):
            return Implicit(self.on_device(surface.expression) or surface.expression)
        return moved_back(surface, self.isometry)

    def _item(self, item: SceneObject) -> SceneObject:
        """An object of the scene as one of the data."""
        if isinstance(item, VolumeRendering):
            return item
        item = replace(item, style=self._style(item.style))
        if isinstance(item, CutSurface):
            return replace(item, surface=self._surface(item.surface))
        if isinstance(item, Isosurface):
            return replace(item, quantity=self.on_device(item.quantity))
        return item

    def _style(self, style: Style) -> Style:
        """A style with the quantities of the data."""
        contours, lic = style.contours, style.lic
        if contours is not None:
            contours = replace(contours, quantity=self.on_device(contours.quantity or style.quantity))
        if lic is not None:
            components = [self.on_device(name) or name for name in lic.components]
            lic = replace(lic, velocity=",".join(components))
        return replace(style, quantity=self.on_device(style.quantity), contours=contours, lic=lic)


@dataclass(frozen=True, eq=False)
class CopiedData:
    """The copies that a scene shows of data.

    copies       the data themselves first; none without copies
    expressions  quantities of the data that only copies show
    """

    copies: tuple[Copy, ...] = ()
    expressions: tuple[Expression, ...] = ()

    @staticmethod
    def of(scene: Scene, names: Names) -> CopiedData:
        """The copies in a scene whose periods are known; SceneError for quantities that copies don't have."""
        if scene.copies is None:
            return CopiedData()
        try:
            asked = [Expression.parse(text, names) for text in quantities(scene)]
            return _copied(scene, asked, names)
        except ElvisError as error:
            raise SceneError(str(error)) from error

    def draw_calls(self, scene: Scene, draw: Callable[[Scene, bool], list[DrawCall]]) -> list[DrawCall]:
        """The draw calls of all copies.

        draw  makes those of the data for a scene, with or without isosurfaces at values that the data don't have
        """
        found = []
        for copy in self.copies:
            found += [copy.in_terms_of_scene(call) for call in draw(copy.scene(scene), True)]
        known = {call.name for call in found}
        wanted = [name for item in _levels(scene) for name in item]
        # an error names the values that no copy has
        return found if known.issuperset(wanted) else draw(scene, False)


def _levels(scene: Scene) -> list[list[str]]:
    """Names of the draw calls of all isosurfaces."""
    first = -1 if scene.plane else 0
    named = enumerate(scene.every_object, start=first)
    return [level_names(number, item) for number, item in named if isinstance(item, Isosurface)]


def level_names(number: int, item: Isosurface) -> list[str]:
    """Names of the draw calls of an isosurface, the object of this number."""
    return [f"objects[{number}] at {value:g}" for value in item.values]


def _copied(scene: Scene, asked: Sequence[Expression], names: Names) -> CopiedData:
    """See CopiedData.of."""
    assert scene.copies is not None
    labels: dict[tuple[str, Node], str] = {(each.text, each.root): each.text for each in asked}
    added: list[Expression] = []
    copies = []
    for number, isometry in enumerate(scene.copies.isometries()):
        own = {}
        for each in asked:
            image = moved(each, isometry, names)
            key = each.text, image.root
            if key not in labels:
                labels[key] = f"copy {number} of {each.text}"
                added.append(Expression(labels[key], image.root))
            if labels[key] != each.text:
                own[each.text] = labels[key]
        copies.append(Copy(number, isometry, scene.field, own))
    return CopiedData(tuple(copies), tuple(added))


def _moved_light(light: Light, isometry: Isometry) -> Light:
    if light.direction is None:
        return light
    return replace(light, direction=_vector(isometry.directions_before(np.asarray(light.direction, np.float64))))


def _vector(array: Floats) -> tuple[float, float, float]:
    x, y, z = (array + 0.0).tolist()
    return x, y, z


def is_in_view(view: View, box: Floats) -> bool:
    """Whether something in a box (2, 3) may be in a view: False only if nothing is."""
    corners = Isometry().corners(box)
    placed = view.projected(corners)
    if not (placed[:, 2] > 0.0).all():
        return True
    image = placed[:, :2] / placed[:, 2:]
    is_before = (image.max(axis=0) < view.first - 1.0).any()
    is_beyond = (image.min(axis=0) > view.last + 1.0).any()
    return not (is_before or is_beyond)


def surrounding_copies(box: Floats, copies: Sequence[Copy]) -> Floats:
    """(2, 3) box around all copies of a box (2, 3); the box itself without copies."""
    boxes = np.array([copy.isometry.box(box) for copy in copies] or [box])
    return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def boxes_of_copies(boxes: Sequence[Boxes], copies: Sequence[Copy]) -> list[Boxes]:
    """A box (1, 6) around each further copy of some boxes; none without boxes."""
    if not copies or not sum(map(len, boxes)):
        return []
    box = surrounding(boxes)
    return [np.asarray(copy.isometry.box(box).reshape(1, 6), np.float32) for copy in copies[1:]]
