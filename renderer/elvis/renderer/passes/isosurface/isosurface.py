"""Isosurfaces in object order: elements are bisected until rays meet each sub-element once at most (stages: iso_*)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from dataclasses import field as default
from functools import partial
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, Records, starts_of
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
from elvis.core.mapping.boxes import Boxes
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.plugins.runtime.volume import Enclosure, Part, Quantity
from elvis.renderer.device.device import Kernel, stand_in
from elvis.renderer.device.leaf_types import enclosure_of
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.isosurface.enclosing import AXES, BOXES, powers, tails
from elvis.renderer.passes.isosurface.occlusion import Occlusion
from elvis.renderer.passes.isosurface.straight_levels import StraightLevels
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.raster.tiles import Sections, bin_sections, places_of
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.traversal import APART, Traversal, visible_sections
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError
from elvis.scene.record.conditioning import misplaced
from elvis.scene.record.frame import Status

#: what becomes of a sub-element, as in iso.slang
SPLIT, UNDEFINED = 0, 4
#: sub-elements that are bisected at once; beyond it nothing more is proved
MOST_SUB_ELEMENTS = 1 << 19
#: the same of quantities that are not polynomials, whose series may never do: for each element, and at least
_OF_AN_ELEMENT, _AT_LEAST = 128, 1 << 13
#: factor for enclosed quantities, whose points cost less
_OF_ENCLOSED = 4
#: sub-elements whose series are on the device together
_CHUNK = 1 << 16
#: rounds of halving, and sub-elements that a dispatch halves
_ROUNDS, _BATCH = 48, 1 << 14
#: numbers that are on the device together: of leaves of elements, and of points or series of sub-elements
_OF_LEAVES, _OF_POINTS = 1 << 24, 1 << 23
#: terms of the models of sub-elements that are on the device together
_OF_MODELS = 1 << 22
#: the error that models may have, in parts of the changes of map and field over a sub-element
_MODELS_OFF = 1e-6
#: the same if the field itself is a series that approximates a quantity
_ENCLOSED_MODELS_OFF = 1e-4
#: what of the hit buffer the device holds
_HELD = ("owner", "status", "reference", "depth", "normal", "uncertainty", "doubt")
#: nodes of a line up to which kernels have series in their threads' own memory (`Terms` in iso_series.slang)
_SHORT = 4
#: groups in which elements are drawn, nearest first, and elements of a group at least
_GROUPS, _LEAST_GROUP = 16, 16
#: drafts of a part: sub-elements in which rays take too many steps are drawn once more in parts, with closer bounds
_DRAFTS = 5


@dataclass(frozen=True, eq=False)
class Level:
    """A value of a quantity of one part, seen in a view: what all stages of a drawing are about.

    number    of the part
    quantity  one of the part's quantities; None is its own field
    buffers   what the stages read and write
    elements  some of the part's elements
    boxes     optional: boxes of these elements with series for the quantity
    occlusion  optional: by what is already drawn
    """

    view: View
    number: int
    quantity: str | None
    value: float
    buffers: dict[str, Buffer]
    elements: Ints = default(default_factory=lambda: np.zeros(0, np.int64))
    boxes: SeriesBoxes | None = None
    occlusion: Occlusion | None = None

    def hides(self, sections: Sections, near: Floats) -> Bools:
        """(n,) whether things with depths of at least ``near`` (n,) are hidden."""
        if self.occlusion is None:
            return np.zeros(len(near), bool)
        return self.occlusion.hides(sections.least[:, :2], sections.most[:, :2], near)


class IsosurfaceDrawer:
    """A loaded volume, ready for any level of any of its quantities from any view.

    counts  of the last picture: elements left out because their field has the level all over them (``flat``) or is not
            a number (``undefined``), and the sub-elements that were drawn
    """

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded, self.device = loaded, loaded.device
        self.traversal = Traversal(loaded)
        self.counts: dict[str, int] = {}
        self._constants_on_device: dict[tuple[int, str | None], dict[str, Buffer]] = {}
        self._straight = StraightLevels(loaded, self.traversal)

    def draw(self, view: View, quantity: str | None, value: float, beyond: Floats | None = None) -> HitBuffer:
        """The nearest point of the isosurface at each pixel, behind the depths ``beyond`` (n,) if they are given.

        Hits closer to one another than APART of the maximum coordinate are one.

        quantity  one of the parts' quantities; None is their own field

        Status: ambiguous if roots could not be separated down to a thousandth of a pixel, on borders of elements, and
        without a hit if a surface may have been missed.
        """
        if self.loaded.dimension != 3:
            raise SceneError("isosurfaces need 3D data: use contours for 2D data")
        self.counts = {"flat": 0, "undefined": 0, "sub_elements": 0}
        stands_in, unproved = False, np.zeros(view.count, bool)
        held = new_arrays(self.device, view.count, _HELD, clear=("owner", "status", "depth", "doubt"))
        image = arrays_to_write(self.device, held, view.count)
        before = self.device.buffer(np.zeros(view.count) if beyond is None else beyond)
        for number in range(len(self.loaded.parts)):
            own, level = self.loaded.leveled(number, quantity, value)
            stands_in |= own != quantity
            unproved = unproved | self._unproved(view, number, own, level)
            straight = self.traversal.is_straight(number, own)
            buffers = {**self.loaded.bindings(number, own), **image, "beyond": before}
            asked = Level(view, number, own, level, buffers)
            if straight:
                self._draw_straight(self._kernel("iso_line", number, own), asked)
                continue
            self.counts["flat"] += int(self.traversal.flat(number, own, level).sum())
            for group in self._nearest_first(asked, held):
                for some in self._ways(group):
                    self._draw_sub_elements(self._kernel("iso_draw", number, some.quantity), some)
        hits = _finish(HitBuffer.on_device(self.device, held), value)
        hits.status[unproved & (hits.status == Status.MISS)] = Status.AMBIGUOUS
        assert hits.doubt is not None
        hits.doubt[unproved] = 0.0
        if stands_in:
            self._check_poles(hits, quantity, value)
        return hits

    def _unproved(self, view: View, number: int, quantity: str | None, value: float) -> Bools:
        """Pixels (n,) that may see elements with the value without proof, as they are not polynomials."""
        if self._is_certified(number, quantity):
            return np.zeros(view.count, bool)
        low, high = self.loaded.bounds(number, quantity)
        corners = _corners_of(self.loaded.parts[number].boxes)
        sections = visible_sections(view, corners, (low <= value) & (high >= value))
        edges = np.zeros((view.height + 1, view.width + 1), np.int64)
        (x0, y0), (x1, y1) = (sections.least[:, :2] - view.first).T, (sections.most[:, :2] - view.first).T + 1
        for x, y, sign in ((x0, y0, 1), (x1, y0, -1), (x0, y1, -1), (x1, y1, 1)):
            np.add.at(edges, (y, x), sign)
        return np.asarray(edges.cumsum(axis=0).cumsum(axis=1)[:-1, :-1].reshape(-1) > 0)

    def _check_poles(self, hits: HitBuffer, quantity: str | None, value: float) -> None:
        """Hits are ambiguous where the quantity has not the value that its stand-in says: at its poles."""
        hit = hits.owner != NOBODY
        found = values_at_hits(self.loaded, hits, quantity)[hit]
        wrong = ~np.isfinite(found) | (np.abs(found - value) > 1e-6 * abs(value) if value else False)
        hits.status[np.flatnonzero(hit)[wrong]] = Status.AMBIGUOUS

    def _draw_straight(self, draw: Kernel, level: Level) -> None:
        """The straight tetrahedra of a part that may have the value."""
        view, number, quantity, value = level.view, level.number, level.quantity, level.value
        own = self._straight.of(number, quantity, value)
        self.counts["flat"] += own.flat
        self.counts["undefined"] += own.undefined
        sections = visible_sections(view, self.traversal.corners(number), own.wanted)
        self.counts["sub_elements"] += len(sections)
        if len(sections):
            tiles, order = bin_sections(sections.least, sections.most, draw.dtype("tiles"))
            lists = {
                "rays": self.traversal.rays(draw, view, number, len(tiles), value),
                "tiles": self.device.buffer(tiles),
                "order": self.device.buffer(sections.element[order]),
            }
            draw(len(tiles), {**level.buffers, **own.buffers, **lists}, groups=True, work=tiles["end"] - tiles["first"])

    def _nearest_first(self, level: Level, held: dict[str, Buffer]) -> Iterator[Level]:
        """A level in groups of elements that may have it, nearest first, without those hidden by earlier groups.

        held  the hit buffer
        """
        number, quantity = level.number, level.quantity
        chosen = self.traversal.holding(number, quantity, level.value)
        groups = min(_GROUPS, int(chosen.sum()) // _LEAST_GROUP)
        if groups < 2:
            yield replace(level, elements=np.flatnonzero(chosen))
            return
        if self.traversal.degree(number, quantity) > 0:
            # elements that are not numbers are counted wherever they are
            undefined = chosen & ~np.isfinite(np.stack(self.loaded.bounds(number, quantity))).all(axis=0)
            yield replace(level, elements=np.flatnonzero(undefined))
            chosen &= ~undefined
        corners = _corners_of(self.loaded.parts[number].boxes)
        sections = visible_sections(level.view, corners, chosen)
        near = level.view.depth_of(corners[sections.element]).min(axis=1)
        for rows in np.array_split(np.arange(len(sections)), groups):
            own = replace(level, occlusion=self._occlusion(level.view, held))
            is_open = ~own.hides(sections[rows], near[rows])
            yield replace(own, elements=np.sort(sections.element[rows[is_open]]).astype(np.int64))

    def _occlusion(self, view: View, held: dict[str, Buffer]) -> Occlusion:
        """Occlusion by the hits so far."""
        owner = self.device.read(held["owner"], np.uint32, view.count)
        depth = self.device.read(held["depth"], np.float64, view.count)
        return Occlusion.of(view, owner, depth)

    def _kernel(self, stage: str, number: int, quantity: str | None) -> Kernel:
        return self.device.kernel(stage, self.loaded.parts[number], quantity)

    def _ways(self, level: Level) -> Iterator[Level]:
        """The level of a quantity by series in boxes of elements, and of the elements without series directly."""
        if not len(level.elements):
            return
        found = self.loaded.in_boxes(level.number, level.quantity, level.value)
        if found is None:
            yield level
            return
        quantity, search = found
        boxes = search.of(level.elements)
        buffers = {**self.loaded.bindings(level.number, quantity), **level.buffers}
        yield replace(level, quantity=quantity, buffers=buffers, boxes=boxes)
        if len(boxes.unmodelled):
            yield replace(level, elements=boxes.unmodelled)

    def _whole(self, split: Kernel, level: Level) -> Records:
        """Some elements of a part that may have the value, or boxes of them, as sub-elements."""
        if level.boxes is not None:
            boxes = level.boxes
            sub_elements = np.zeros(len(boxes), split.dtype("sub_elements"))
            sub_elements["element"], sub_elements["centre"] = boxes.element, boxes.centre
            sub_elements["half"], sub_elements["error"] = boxes.half[:, None], boxes.error
            return sub_elements
        elements = level.elements
        sub_elements = np.zeros(len(elements), split.dtype("sub_elements"))
        sub_elements["element"], sub_elements["half"] = elements, 1.0
        sub_elements["error"] = self.traversal.rounding(level.number, level.quantity, level.value)[elements]
        return sub_elements

    def _sub_elements(self, level: Level, parents: Records, whole: bool) -> Records:
        """Elements, or parts of sub-elements, to draw, in order of depth."""
        of_polynomials = self.traversal.degree(level.number, level.quantity) > 0
        is_enclosed = self._is_enclosed(level.number, level.quantity)
        most_parents = min(self._points_at_once(level) // 8, _BATCH) if self._uses_grid(level) else _BATCH
        done = [parents[:0]]
        most = MOST_SUB_ELEMENTS
        if not of_polynomials:
            proportion = max(_OF_AN_ELEMENT * len(parents), _AT_LEAST)
            most = min(_OF_ENCLOSED * proportion if is_enclosed else proportion, most)
        for iteration in range(_ROUNDS):
            last = len(parents) > most or iteration == _ROUNDS - 1
            halved = iteration > 0 or not whole
            batches = np.array_split(parents, -(-len(parents) // most_parents)) if len(parents) else []
            found = [self._keep(level, batch, halved, last) for batch in batches]
            done += [sub_elements[sub_elements["outcome"] != SPLIT] for sub_elements in found]
            parents = _join([parents[:0], *(sub_elements[sub_elements["outcome"] == SPLIT] for sub_elements in found)])
            parents = _visible(level, parents)
            if not len(parents):
                break
        return self._sort_by_depth(_visible(level, _join(done)))

    def _keep(self, level: Level, parents: Records, halved: bool, last: bool) -> Records:
        """The remaining sub-elements, subdivided three times or unchanged; the ``last`` are not subdivided further."""
        number, quantity = level.number, level.quantity
        split = self._kernel("iso_split", number, quantity)
        most = (8 if halved else 1) * len(parents)
        groups = len(parents) if halved else -(-most // 8)
        has_series = self._has_series(number, quantity)
        lists = {
            **self._constants(number, quantity),
            **level.buffers,
            "level_view": self._level_view(split, level, count=len(parents), whole=not halved, last=last),
            "parents": self.device.buffer(parents),
            "sub_elements": self.device.empty(parents.dtype, most),
            "count": self.device.buffer(np.zeros(1, np.uint32)),
            "sifted": self.device.empty(parents.dtype, most),
            "enclosures": self.device.empty(split.dtype("enclosures"), most if has_series else 1),
            "sifted_count": self.device.buffer(np.zeros(1, np.uint32)),
        }
        self._kernel("iso_sift", number, quantity)(groups, lists, groups=True)
        sifted = int(self.device.read(lists["sifted_count"], np.uint32)[0])
        if has_series and not self._is_in_boxes(level):
            self.find_points(level, lists["sifted"], sifted)
        split(sifted, lists)
        count = int(self.device.read(lists["count"], np.uint32)[0])
        return self.device.read(lists["sub_elements"], parents.dtype)[:count].copy()

    def _sort_by_depth(self, sub_elements: Records) -> Records:
        self.counts["undefined"] += len(np.unique(sub_elements["element"][sub_elements["outcome"] == UNDEFINED]))
        sub_elements = sub_elements[sub_elements["outcome"] != UNDEFINED]
        self.counts["sub_elements"] += len(sub_elements)
        centre = sub_elements["centre"]
        return sub_elements[np.lexsort([*centre.T, sub_elements["element"], sub_elements["near"]])]

    def _draw_sub_elements(self, draw: Kernel, level: Level) -> None:
        """The other elements of a part, in sub-elements, some in parts where rays take too many steps."""
        certified = self._is_certified(level.number, level.quantity)
        for portion, elements in self.portions(level):
            level_view = partial(self._level_view, draw, portion, certified=certified)
            unfinished, where = elements, None
            for draft in range(_DRAFTS):
                portion = self._with_models(portion)
                sub_elements = self._sub_elements(portion, unfinished, whole=draft == 0)
                if not len(sub_elements):
                    break
                last = draft == _DRAFTS - 1 or len(sub_elements) > MOST_SUB_ELEMENTS
                drawn = partial(self._draft, draw, portion, where=where, level_view=partial(level_view, last=last))
                chunks = self._chunks(portion, sub_elements)
                before = starts_of(chunks)
                found = [drawn(some) for some in chunks]
                number = np.concatenate([own + first for (own, _), first in zip(found, before, strict=False)])
                rows, parent = np.unique(number, return_inverse=True)
                unfinished, where = sub_elements[rows], _pairs(parent, np.concatenate([places for _, places in found]))
                unfinished["parent"] = np.arange(len(rows))

    def _with_models(self, level: Level) -> Level:
        """A level with room for the models of its sub-elements."""
        room = _OF_MODELS if self._nodes_of_line(level) > _SHORT else 1
        is_enclosed = self._is_enclosed(level.number, level.quantity)
        models: dict[str, Any] = {
            "models": self.device.empty(np.float64, 4 * room),
            "model_room": np.array([room], np.uint32),
            "model_off": np.array([_ENCLOSED_MODELS_OFF if is_enclosed else _MODELS_OFF]),
            "model_count": self.device.buffer(np.zeros(1, np.uint32)),
        }
        boxes = {"box_models": self._constants(level.number, level.quantity)["box_models"]}
        return replace(level, buffers={**boxes, **level.buffers, **models})

    def portions(self, level: Level) -> Iterator[tuple[Level, Records]]:
        """Whole elements that are drawn together; where their quantity is enclosed, with the series of their leaves."""
        number, quantity = level.number, level.quantity
        kernel = self._kernel("iso_split", number, quantity)
        elements = self._whole(kernel, level)
        enclosure = self._enclosure(number, quantity)
        grid = self.device.empty(np.float64, _OF_POINTS if self._uses_grid(level) else 1)
        level = replace(level, buffers={**level.buffers, "grid": grid})
        if enclosure is None or enclosure.distances:
            yield level, elements
            return
        leaves = 3 + enclosure.fields
        size = leaves * (enclosure.degree + 1) ** 3
        if level.boxes is not None:
            yield from self._boxes_at_once(level, level.boxes, elements)
            return
        kernel = self._kernel("iso_leaves", number, quantity)
        for some in np.array_split(elements, -(-len(elements) * size // _OF_LEAVES)) if len(elements) else []:
            some["slot"] = np.arange(len(some))
            lists = {
                "leaf_series": self.device.empty(np.float64, size * len(some)),
                "grid_errors": self.device.empty(np.float64, 2 * leaves * len(some)),
            }
            own = {
                "elements": self.device.buffer(some["element"]),
                "level_view": self._level_view(kernel, level, count=len(some)),
            }
            portion = replace(level, buffers={**level.buffers, **lists})
            kernel(len(some), {**self._constants(number, quantity), **portion.buffers, **own})
            yield portion, some

    def _boxes_at_once(
        self, level: Level, boxes: SeriesBoxes, sub_elements: Records
    ) -> Iterator[tuple[Level, Records]]:
        """Boxes that are drawn together, with their series, nearest first, without those that are hidden."""
        sections, near = _sections_of(level.view, boxes)
        open_boxes = sections.element[~level.hides(sections, near)].astype(np.int64)
        errors = boxes.misfit, boxes.error, boxes.summed, boxes.places, boxes.condition
        places = boxes.map_centre[boxes.map_of], boxes.map_half[boxes.map_of]
        records = np.column_stack([boxes.centre, boxes.half, *errors, *places])
        numbers = boxes.series[:1].size
        count = -(-len(open_boxes) * numbers // _OF_LEAVES)
        for rows in np.array_split(open_boxes, count) if count else []:
            some = sub_elements[rows]
            some["slot"] = np.arange(len(rows))
            maps, map_of = np.unique(boxes.map_of[rows], return_inverse=True)
            lists = {
                "leaf_series": self.device.buffer(boxes.series[rows]),
                "map_series": self.device.buffer(boxes.maps[maps]),
                "box_models": self.device.buffer(np.column_stack([records[rows], map_of])),
            }
            yield replace(level, buffers={**level.buffers, **lists}), some

    def _nodes_of_line(self, level: Level) -> int:
        """Nodes per line of the longest series of a quantity, or of its leaves."""
        own = self.loaded.quantity(level.number, level.quantity)
        enclosure = self._enclosure(level.number, level.quantity)
        return max(own.degree or stand_in(own), 0 if enclosure is None else enclosure.degree) + 1

    def _uses_grid(self, level: Level) -> bool:
        """Whether kernels have the series of sub-elements in the grid, or only the series of leaves."""
        return self._nodes_of_line(level) > _SHORT or self._is_enclosed(level.number, level.quantity)

    def _points_at_once(self, level: Level) -> int:
        """Sub-elements whose points and series the device has room for."""
        return _OF_POINTS // (4 * self._nodes_of_line(level) ** 3)

    def find_points(self, level: Level, sub_elements: Buffer, count: int, offset: int = 0) -> None:
        """Map and quantity at the nodes of ``count`` sub-elements, from one on."""
        kernel = self._kernel("iso_points", level.number, level.quantity)
        lists = {
            **self._constants(level.number, level.quantity),
            **level.buffers,
            "level_view": self._level_view(kernel, level, offset=offset),
            "sub_elements": sub_elements,
        }
        kernel(count, lists, groups=True)

    def _chunks(self, level: Level, sub_elements: Records) -> list[Records]:
        """Sub-elements that are drawn together: as many as the device has room for the series of."""
        if self.traversal.degree(level.number, level.quantity) > 0:
            return [sub_elements]
        return np.array_split(sub_elements, -(-len(sub_elements) // _CHUNK))

    def _is_certified(self, number: int, quantity: str | None) -> bool:
        """Whether map and quantity are polynomials, or enclosed, so that proofs hold."""
        return self.traversal.degree(number, quantity) > 0 or self._is_enclosed(number, quantity)

    def _is_enclosed(self, number: int, quantity: str | None) -> bool:
        """Whether a quantity is enclosed but not a polynomial."""
        return self._enclosure(number, quantity) is not None

    def _has_series(self, number: int, quantity: str | None) -> bool:
        """Whether it is enclosed with series: quantities with distances have none."""
        enclosure = self._enclosure(number, quantity)
        return enclosure is not None and not enclosure.distances

    def _is_in_boxes(self, level: Level) -> bool:
        """Whether boxes of elements have series of a quantity."""
        enclosure = self._enclosure(level.number, level.quantity)
        return enclosure is not None and enclosure.in_boxes

    def _enclosure(self, number: int, quantity: str | None) -> Enclosure | None:
        """The composition of a quantity; None if it is a polynomial, or isn't enclosed."""
        return enclosure_of(self.loaded.quantity(number, quantity))

    def _constants(self, number: int, quantity: str | None) -> dict[str, Buffer]:
        """Inputs of the stages before drawing in addition to a part's own buffers, uploaded once."""
        if (number, quantity) not in self._constants_on_device:
            arrays = self._arrays(self.loaded.quantity(number, quantity))
            buffers = {name: self.device.buffer(array) for name, array in arrays.items()}
            self._constants_on_device[number, quantity] = buffers
        return self._constants_on_device[number, quantity]

    def _arrays(self, own: Part | Quantity) -> dict[str, Floats]:
        """Chebyshev points and what belongs to them, for a quantity and for the leaves of one that is enclosed."""
        degree = own.degree or stand_in(own)
        enclosure = enclosure_of(own)
        nodes, transform = series(degree)
        leaf_nodes, leaf_series = series(1 if enclosure is None else enclosure.degree)
        leaf_transform = powers(leaf_series)
        return {
            "nodes": nodes,
            "transform": transform,
            "leaf_nodes": leaf_nodes,
            "leaf_transform": leaf_transform,
            "leaf_sums": np.abs(leaf_transform).sum(axis=1),
            "leaf_errors": np.zeros(1) if enclosure is None else enclosure.errors(),
            "axes": np.array(AXES),
            "box_sizes": np.array(BOXES),
            "tails": tails(degree),
            "leaf_chebyshev": leaf_series,
            **dict.fromkeys(("leaf_series", "map_series", "grid_errors", "box_models"), np.zeros(1)),
        }

    def _fits(self, level: Level, sub_elements: Records) -> Buffer:
        """The series of a quantity that is not a polynomial over sub-elements."""
        number, quantity = level.number, level.quantity
        if not self._has_series(number, quantity):
            return self.device.empty(np.float64, 1)
        own, in_boxes = self.loaded.quantity(number, quantity), self._is_in_boxes(level)
        kernel, on_device = self._kernel("iso_fit", number, quantity), self.device.buffer(sub_elements)
        fits = self.device.empty(np.float64, (stand_in(own) + 1) ** 3 * len(sub_elements))
        lists = {**self._constants(number, quantity), **level.buffers, "fits": fits, "sub_elements": on_device}
        most = len(sub_elements) if in_boxes else self._points_at_once(level)
        for first in range(0, len(sub_elements), most):
            count = min(most, len(sub_elements) - first)
            if not in_boxes:
                self.find_points(level, on_device, count, first)
            kernel(count, {**lists, "level_view": self._level_view(kernel, level, count=count, offset=first)})
        return fits

    def _draft(
        self,
        draw: Kernel,
        level: Level,
        sub_elements: Records,
        where: Ints | None,
        level_view: Callable[..., Buffer],
    ) -> tuple[Ints, Ints]:
        """Draw sub-elements; returns sub-elements (m,) and tiles (m,) in which rays took too many steps.

        where  as of `_pairs`, tiles in which parts of sub-elements are to be drawn; None for everywhere
        """
        least, most = (np.full((len(sub_elements), 4), bound, np.int32) for bound in (-(1 << 20), 1 << 20))
        least[:, :2] = np.maximum(sub_elements["bounds"][:, :2], level.view.first)
        most[:, :2] = np.minimum(sub_elements["bounds"][:, 2:], level.view.last)
        tiles, order = bin_sections(least, most, draw.dtype("tiles"))
        place = np.repeat(places_of(tiles["x"], tiles["y"]), tiles["end"] - tiles["first"])
        if where is not None:
            chosen = np.isin(_pairs(sub_elements["parent"][order], place), where)
            tiles, order, place = _chosen(tiles, chosen), order[chosen], place[chosen]
        lists = {
            "level_view": level_view(count=len(tiles)),
            "tiles": self.device.buffer(tiles),
            "order": self.device.buffer(order),
            "sub_elements": self.device.buffer(sub_elements),
            "fits": self._fits(level, sub_elements),
            "unfinished": self.device.buffer(np.zeros(len(order), np.uint32)),
        }
        draw(len(tiles), {**level.buffers, **lists}, groups=True, work=tiles["end"] - tiles["first"])
        listed = np.flatnonzero(self.device.read(lists["unfinished"], np.uint32)[: len(order)])
        return order[listed].astype(np.int64), place[listed]

    def _level_view(self, kernel: Kernel, level: Level, **other: int) -> Buffer:
        """The LevelView record of the stages (iso.slang)."""
        view = level.view
        errors = {"apart": APART * self.loaded.extent, "misplaced": misplaced(view, self.loaded.extent)}
        place = {"across": 1 / np.linalg.norm(view.column), "first": self.loaded.first[level.number]}
        record = record_of(kernel, "level_view", view, level=level.value, **place, **errors, **other)
        return self.device.buffer(record)


def _corners_of(boxes: Boxes | Floats) -> Floats:
    """(n, 8, 3) the corners of boxes (n, 6)."""
    exact = boxes.astype(np.float64)
    return np.stack([exact[:, [3 * (k >> axis & 1) + axis for axis in range(3)]] for k in range(8)], axis=1)


def _sections_of(view: View, boxes: SeriesBoxes) -> tuple[Sections, Floats]:
    """Where boxes may be visible, nearest first, and their smallest depths."""
    corners = _corners_of(boxes.world)
    sections = visible_sections(view, corners, np.ones(len(boxes), bool))
    return sections, view.depth_of(corners[sections.element]).min(axis=1)


def _visible(level: Level, sub_elements: Records) -> Records:
    """The sub-elements, among the given ones, that earlier hits do not hide."""
    if level.occlusion is None:
        return sub_elements
    bounds, is_counted = sub_elements["bounds"], sub_elements["outcome"] == UNDEFINED
    hidden = level.occlusion.hides(bounds[:, :2], bounds[:, 2:], sub_elements["near"])
    return np.asarray(sub_elements[~hidden | is_counted])


def _pairs(parent: Records, place: Ints) -> Ints:
    """(n,) numbers of pairs of sub-elements (n,) and places (n,) of tiles."""
    return np.asarray(parent.astype(np.int64) << 40 | place)


def _chosen(tiles: Records, chosen: Bools) -> Records:
    """Tile records that have only the chosen ones (m,) of all that they list."""
    ends = np.append(0, np.cumsum(chosen))
    tiles["first"], tiles["end"] = ends[tiles["first"]], ends[tiles["end"]]
    return tiles[tiles["first"] < tiles["end"]]


def _join(sub_elements: list[Records]) -> Records:
    """Sub-elements of all lists, in the layout of the kernels, which may have gaps."""
    return np.concatenate(sub_elements, dtype=sub_elements[0].dtype)


def _finish(hits: HitBuffer, value: float) -> HitBuffer:
    """The kernels' results for a value; also ambiguous if something before the hit may have been missed."""
    assert hits.doubt is not None
    hits.doubt = np.where(hits.doubt > 0, hits.doubt, np.inf)
    hits.status[(hits.doubt <= hits.depth) & np.isfinite(hits.doubt)] = Status.AMBIGUOUS
    return hits.showing(np.where(hits.owner == NOBODY, np.nan, value))
