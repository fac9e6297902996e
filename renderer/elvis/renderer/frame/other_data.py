"""Quantities that name data on another mesh: both are evaluated at the visible points.

The parts of such an expression in the dataset itself are quantities of its volume.  The parts in other datasets are
evaluated at the hits of a surface: on a plane by the same cut of the other volume, whose pixels have the same
positions, else by point location.  Operators are applied on the host, to one number per pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as default
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.margins import heights
from elvis.core.quantities import Expression
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, coordinate, leaves, ordered, other_of
from elvis.core.shapes import Shape
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.device.device import Device
from elvis.renderer.passes.plane.cut import Cutter
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import BORDER, NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.probing import Finder, Places
from elvis.scene import CutSurface, Implicit, Isosurface, Plane, Scene, VolumeRendering
from elvis.scene.cameras.view import PlaneView, View
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Status

#: objects that are not drawn of quantities on two meshes, and alternatives
_INSTEAD = {
    "a volume": "a quantity of one mesh for a volume, or planes, cuts and faces that this one colours",
    "an isosurface": "a quantity of one mesh for an isosurface, which this one colours as the quantity of its style, "
    "--set objects[0].style.quantity=…",
    "contours": "contours of a quantity of one mesh, or steps of colour, --bar bands=10, whose borders are this one's",
    "a surface or clip": "a surface of one mesh, whose cut this one colours",
}
#: relative to elements: distance from a side within which points count as on it, and distance at which another element
#: is searched
_NEAR, _AWAY = 2 * BORDER, 1e-6


@dataclass(frozen=True, eq=False)
class Compound:
    """An expression of several datasets.

    own    its largest parts in the dataset itself, as quantities of its volume
    steps  the others, which name other datasets, each after its operands
    """

    expression: Expression
    own: Mapping[Node, Expression]
    steps: Sequence[Node]

    @staticmethod
    def of(expression: Expression) -> Compound:
        """The parts of an expression."""
        steps = _naming_others(expression.root)
        own: dict[Node, Expression] = {}
        for node in (operand for step in steps for operand in step.operands):
            if node not in steps and node not in own and leaves(node):
                is_field = node.op == "field" and not node.axes
                own[node] = Expression(node.name if is_field else f"part {len(own)} of {expression.text}", node)
        return Compound(expression, own, tuple(steps))

    @property
    def others(self) -> list[tuple[str, str]]:
        """Names of other datasets, each with a text that is asked of it."""
        found = (other_of(leaf.name) for leaf in self.expression.leaves if leaf.op == "attribute")
        return [pair for pair in found if pair is not None]

    def value(self, of: Callable[[Expression], Floats], other: Callable[[str, str], Floats]) -> Floats:
        """Values (n,), from the values of its own parts and of texts in other datasets."""
        known: dict[Node, Floats | float] = {node: of(part) for node, part in self.own.items()}
        for node in self.steps:
            asked = other_of(node.name)
            if asked is not None:
                known[node] = other(*asked)
                continue
            operands = [known.get(operand, operand.value) for operand in node.operands]
            with np.errstate(all="ignore"):
                known[node] = function(node).numpy(*operands)
        return np.asarray(known[self.steps[-1]])


def _naming_others(root: Node) -> dict[Node, None]:
    """The parts of an expression that name other datasets, each after its operands."""
    found: dict[Node, None] = {}
    for node in ordered(root):
        is_other = node.op == "attribute" and other_of(node.name) is not None
        if is_other or not found.keys().isdisjoint(node.operands):
            found[node] = None
    return found


class OtherVolume:
    """Another dataset on a device, with the quantities that are asked of it."""

    def __init__(self, device: Device, dataset: Dataset, texts: Sequence[str]) -> None:
        self.dataset, self.texts = dataset, tuple(texts)
        expressions = [Expression.of(dataset, text) for text in texts]
        first = _carrier(dataset, expressions)
        self._own = first.text
        self.loaded = DeviceVolume(device, volume_of(dataset, [first, *expressions]))
        self._cutter, self._finder = Cutter(self.loaded), Finder(self.loaded)
        self._seen: tuple[object, Plane | None, HitBuffer] | None = None

    def values(self, text: str, found: HitBuffer) -> Floats:
        """(n,) a quantity at places in this volume, NaN where there are none."""
        return found.field if text == self._own else values_at_hits(self.loaded, found, text)

    def at(self, hits: HitBuffer, view: View, plane: Plane | None) -> HitBuffer:
        """The places in this volume of the hits in a view; what several quantities are asked at is looked up once.

        plane  that all hits lie on, None for other surfaces
        """
        if self._seen is None or self._seen[0] is not hits.owner or self._seen[1] != plane:
            cut = None if plane is None else PlaneView.on(view, plane)
            found = self._located(hits, view) if cut is None else self._cutter.draw(cut, references=len(self.texts) > 1)
            self._seen = hits.owner, plane, found
        return self._seen[2]

    def _located(self, hits: HitBuffer, view: View) -> HitBuffer:
        """The places of hits, by point location."""
        found, pixel = HitBuffer.empty(view.count), np.flatnonzero(hits.owner != NOBODY)
        if len(pixel):
            origins, directions = view.rays_of(pixel)
            points = origins + hits.depth[pixel, None] * directions
            places = self._finder.find(points)
            places.status[self._along_outer_sides(points, hits.normal[pixel], places)] = Status.CERTAIN
            for name in ("owner", "field", "reference", "status"):
                getattr(found, name)[pixel] = getattr(places, name)
        return found

    def _along_outer_sides(self, points: Floats, normal: Floats, places: Places) -> Ints:
        """Points on the border of the domain that only one element contains, as on surfaces that follow the border.

        They lie on one side of the element, not on its edges, and a little away from the surface there is that element
        to one side and none to the other.
        """
        near = np.flatnonzero((places.status == Status.AMBIGUOUS) & (places.owner != NOBODY))
        near = near[self._on_one_side(places.element[near], places.reference[near])]
        if not len(near):
            return near
        corners = self._boxes[places.owner[near]].astype(np.float64)
        away = _AWAY * np.linalg.norm(corners[:, 3:] - corners[:, :3], axis=1)[:, None] * normal[near]
        there, back = (self._finder.find(points[near] + step) for step in (away, -away))
        is_none = [found.status == Status.MISS for found in (there, back)]
        is_same = [(found.owner == places.owner[near]) & (found.status == Status.CERTAIN) for found in (there, back)]
        is_alone: Bools = (is_none[0] & is_same[1]) | (is_same[0] & is_none[1])
        return np.asarray(near[is_alone])

    @cached_property
    def _boxes(self) -> NDArray[np.float32]:
        """(n, 6) of all elements."""
        return np.concatenate([part.boxes for part in self.loaded.parts])

    def _on_one_side(self, element_ids: Ints, reference: Floats) -> Bools:
        """Whether reference points (n, 3) on borders of elements lie on exactly one of their sides."""
        found = np.zeros(len(element_ids), bool)
        for shape, ids in self._ids.items():
            own = np.flatnonzero(np.isin(element_ids, ids))
            near = heights(shape, reference[own, : shape.dimension]) <= _NEAR
            found[own] = near.sum(axis=1) == 1
        return found

    @cached_property
    def _ids(self) -> dict[Shape, Ints]:
        """The ids of elements by shape."""
        blocks = geometry(self.dataset)
        shapes = dict.fromkeys(block.expansion.shape for block in blocks)
        return {
            shape: np.concatenate([block.element_ids for block in blocks if block.expansion.shape is shape])
            for shape in shapes
        }


def _carrier(dataset: Dataset, expressions: Sequence[Expression]) -> Expression:
    """The quantity whose elements are looked in: the first, or x, which all have, where not all are on the same."""
    carried = {frozenset(_elements(dataset, expression)) for expression in expressions}
    return expressions[0] if len(carried) == 1 else Expression("x", coordinate(0))


def _elements(dataset: Dataset, expression: Expression) -> Iterator[bytes]:
    """Keys of the elements that carry the fields of an expression."""
    for name in expression.fields:
        ids = [block.element_ids for block in dataset.field(name).blocks]
        yield np.sort(np.concatenate(ids)).tobytes()


@dataclass(eq=False)
class OtherData:
    """The quantities of a scene that name data on other meshes, with these.

    compounds  by their texts
    field      the text of the scene's field where it is one of them
    own        the quantities of the dataset's own volume, its field first
    """

    dataset: Dataset | None = None
    compounds: Mapping[str, Compound] = default(default_factory=dict)
    field: str | None = None
    own: Sequence[Expression] = ()
    volumes: Mapping[str, OtherVolume] = default(default_factory=dict)

    @staticmethod
    def of(
        device: Device,
        dataset: Dataset,
        texts: Sequence[str],
        before: OtherData | None = None,
        further: Sequence[Expression] = (),
    ) -> OtherData:
        """The requests of some quantities to their data; data that are on the device from ``before`` stay there.

        further  quantities that are not given as texts
        """
        expressions = [*(Expression.of(dataset, text) for text in texts), *further]
        compounds = {each.text: made for each in expressions if (made := Compound.of(each)).others}
        own: dict[str, Expression] = {}
        for each in expressions:
            parts = list(compounds[each.text].own.values()) if each.text in compounds else [each]
            own |= {part.text: part for part in parts or [Expression("x", coordinate(0))]}
        asked: dict[str, dict[str, None]] = {}
        for name, text in (pair for each in compounds.values() for pair in each.others):
            asked.setdefault(name, {})[text] = None
        known = {} if before is None else before.volumes
        volumes = {}
        for name, wanted in asked.items():
            kept, data = known.get(name), dataset.others[name]
            is_there = kept is not None and kept.loaded.device is device and kept.dataset is data
            is_kept = is_there and kept is not None and kept.texts == tuple(wanted)
            volumes[name] = kept if is_kept and kept is not None else OtherVolume(device, data, tuple(wanted))
        first = texts[0] if texts[0] in compounds else None
        return OtherData(dataset, compounds, first, tuple(own.values()), volumes)

    def on(self, device: Device) -> OtherData:
        """The same on another device."""
        volumes = {name: OtherVolume(device, each.dataset, each.texts) for name, each in self.volumes.items()}
        return replace(self, volumes=volumes)

    @property
    def needs_references(self) -> bool:
        """Whether more of the dataset's own volume is asked at hits than its field."""
        return len(self.own) > 1

    def text_of(self, quantity: str | None) -> str | None:
        """The text of a quantity, None being the scene's field, where it names other data; None where it doesn't."""
        text = self.field if quantity is None else quantity
        return text if text in self.compounds else None

    def check(self, scene: Scene) -> None:
        """SceneError if a scene uses such quantities in unsupported ways."""
        surfaces = [clip.surface for clip in scene.clip]
        for item in scene.every_object:
            if isinstance(item, VolumeRendering):
                self._refuse(item.quantity or scene.field, "a volume")
                continue
            if isinstance(item, Isosurface):
                self._refuse(item.quantity or scene.field, "an isosurface")
            if isinstance(item, CutSurface):
                surfaces.append(item.surface)
            contours = item.style.contours
            if contours is not None:
                self._refuse(contours.quantity or item.style.quantity or scene.field, "contours")
            for text in item.style.lic.components if item.style.lic else ():
                self._refuse(text, "streaks")
        for surface in surfaces:
            if isinstance(surface, Implicit):
                self._refuse(surface.expression, "a surface or clip")

    def _refuse(self, text: str, what: str) -> None:
        if text in self.compounds:
            names = ", ".join(dict.fromkeys(name for name, _ in self.compounds[text].others))
            raise SceneError(
                f"{text!r} names data on another mesh ({names}), without bounds between points: "
                f"expected {_INSTEAD[what]}"
            )

    def shown(self, loaded: DeviceVolume, hits: HitBuffer, text: str, view: View, plane: Plane | None) -> HitBuffer:
        """The hit buffer with a quantity as its field: NaN where another dataset has nothing.

        A hit is ambiguous if its element in another dataset is ambiguous or was not found.

        plane  that contains all hits, None for other surfaces
        """
        compound, is_hit = self.compounds[text], hits.owner != NOBODY
        names = dict.fromkeys(name for name, _ in compound.others)
        found = {name: self.volumes[name].at(hits, view, plane) for name in names}

        def own(part: Expression) -> Floats:
            # the hits have the field of the dataset's volume already
            return hits.field if part.text == self.own[0].text else values_at_hits(loaded, hits, part.text)

        total = compound.value(own, lambda name, asked: self.volumes[name].values(asked, found[name]))
        status = hits.status
        for places in found.values():
            status = np.where(is_hit & (places.status > Status.CERTAIN), np.maximum(status, places.status), status)
        shown = hits.showing(np.where(is_hit, total, np.nan))
        shown.status = status
        shown.held = {name: held for name, held in shown.held.items() if name != "status"}
        return shown
