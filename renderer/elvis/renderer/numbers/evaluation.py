"""Points, norms and facts of data that a runtime plugin opens, evaluated by the plugin's own kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, every_pair, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks, is_idle
from elvis.core.base.rounded_up import rounded_up
from elvis.core.base.terminal import Progress
from elvis.core.files.columns import Columns
from elvis.core.integrals import Integrals
from elvis.core.integrals.integrands import integrands_of
from elvis.core.mapping.boxes import BoxTree
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.tangents import duals
from elvis.core.numbers.norms import AXES, Norm
from elvis.core.numbers.sampling import by_points
from elvis.core.polynomials.cubature import Cubature, field_cubature
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.streamlines import TracedLines, trace
from elvis.plugins.runtime.evaluation_service import check_volume
from elvis.plugins.runtime.host.flow import HostFlow
from elvis.plugins.runtime.opening import PluginData, call_plugin
from elvis.plugins.runtime.serving import names_of, volume_of
from elvis.plugins.runtime.volume import Part, Volume, corners_of_volume
from elvis.plugins.runtime.volume_checks import Samples, probes
from elvis.renderer.frame.renderer import Renderer
from elvis.renderer.numbers.plugin_integrals import PluginIntegration

#: modes of rules that are tried in turn, the change below which a norm has converged, and the most points of a rule
_MODES, _CONVERGED, _MOST = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96), 1e-11, 1 << 22
#: points that are sampled together
_BATCH = 1 << 15
#: points that ranges are sampled at, as a rule
_MANY = 1 << 18
_AMBIGUOUS, _INSIDE = 2, 1
#: steps of Newton's method, and how short the last one must be
_STEPS, _SHORT = 40, 1e-9


@dataclass
class Evaluation:
    """Data that a plugin has opened; ``report`` is called with what isn't as well known as it should be."""

    opened: PluginData
    report: Callable[[str], object]
    dataset: None = None  # none is native (see elvis.renderer.commands.sources)

    @property
    def names(self) -> Names:
        """Meaning of the names in expressions."""
        return names_of(self.opened)

    def expressions(self, texts: Sequence[str] | None) -> list[Expression]:
        """The quantities, or all fields; ElvisError for what names none, and for data without fields."""
        names = self.names
        if not names.fields:
            raise ElvisError(f"the plugin {self.opened.name} has opened a mesh but no field: also give the field file")
        return [Expression.parse(text, names) for text in (self.opened.fields if texts is None else texts)]

    @contextmanager
    def _load(self, expressions: Sequence[Expression]) -> Iterator[tuple[Volume, Renderer]]:
        """The volume that serves quantities, brought to a device, after a few checks."""
        volume = volume_of(self.opened, [each.text for each in expressions])
        with Renderer() as device:
            device.show(volume)
            check_volume(self.opened.name, volume, device)
            yield volume, device

    def probe(self, points: Floats, expressions: Sequence[Expression], every: bool, ranks: Ranks = ALONE) -> Columns:
        """Columns point, x, y, z, element, status, and one of each quantity; ``every``: a row for each element.

        ranks  share the points; all but the first have no rows in the end
        """
        names = [each.text for each in expressions]
        return by_points(lambda some: self._probe(some, expressions, every), points, names, ranks)

    def _probe(self, points: Floats, expressions: Sequence[Expression], every: bool) -> Columns:
        """Columns point, x, y, z, element, status, and one of each quantity; ``every``: a row for each element."""
        with self._load(expressions) as (volume, device):
            row, part, local, reference, status = _places(points, volume, device, every)
            values = {each.text: _values(each.text, part, local, reference, volume, device) for each in expressions}
        ids = np.array([-1, *chain.from_iterable(own.element_ids for own in volume.parts)])
        first = starts_of(volume.parts)
        element = ids[np.where(part < 0, 0, 1 + first[part] + local)]
        places = dict(zip("xyz", points[row].T, strict=True))
        return {"point": row, **places, "element": element, "status": status, **values}

    def norms(self, texts: Sequence[str] | None, ranks: Ranks = ALONE) -> dict[str, Norm]:
        """Norms of coordinates and fields, or of quantities, by one rank, by rules refined until they agree."""
        if is_idle(ranks):
            return {}
        expressions = self.expressions(texts)
        with self._load(expressions) as (volume, device):
            axes = AXES[: volume.dimension] if texts is None else ()
            return self._norms([*axes, *(each.text for each in expressions)], volume, device)

    def integrate(
        self,
        texts: Sequence[str],
        over: Sequence[str],
        error: float,
        coefficients: str | None = None,
        clip: str | None = None,
        progress: Progress | None = None,
        ranks: Ranks = ALONE,
        reached: Callable[[float], object] | None = None,
        best_effort: bool = False,
        jacobian: str = "absolute",
    ) -> Integrals:
        """Integrals over the domain, outer faces and boundaries, by rules that are refined until they agree."""
        if is_idle(ranks):
            return Integrals(())
        if coefficients is not None or clip is not None:
            option, name = "--clip" if coefficients is None else "--coefficients", self.opened.name
            raise ElvisError(f"{option}: expected elements with a known map, found data opened by the plugin {name}")
        if jacobian != "absolute":
            raise ElvisError(f"--jacobian: expected elements with a known map, found data opened by {self.opened.name}")
        wanted = integrands_of(self.names, texts)
        own = [each.expression for each in wanted]
        served = [each for each in own if each.root.op != "number" and not set(each.attributes) & set(SIDES)]
        served += [Expression.parse(name, self.names) for each in own for name in each.fields]
        served = served or [Expression.parse(self.opened.fields[0], self.names)]
        with self._load(served) as (volume, device):
            sample = partial(_samples_in, device=device)
            return PluginIntegration(volume, sample, _rule).over(wanted, over, error, progress)

    def trace(self, seeds: Sequence[str], velocity: Sequence[str] | None, **settings: Any) -> TracedLines:
        """Streamlines, by the plugin's host evaluation (see `elvis.core.streamlines.trace`)."""
        flow = HostFlow(self.opened)
        return call_plugin(self.opened.name, "following lines", lambda: trace(flow, seeds, velocity, **settings))

    def _norms(self, names: Sequence[str], volume: Volume, device: Renderer) -> dict[str, Norm]:
        before = np.full(len(names), np.nan)
        for modes in _MODES:
            rules = [_rule(part, modes) for part in volume.parts]
            total = sum(len(part) * len(rule.weights) for part, rule in zip(volume.parts, rules, strict=True))
            if total > _MOST and modes > _MODES[1]:
                break
            sums = [_sums(number, names, rule, volume, device) for number, rule in enumerate(rules)]
            now = np.sqrt(np.sum([own[0] for own in sums], axis=0))
            least, greatest = np.min([own[1] for own in sums], axis=0), np.max([own[2] for own in sums], axis=0)
            off = np.nanmax(np.abs(now - before) / np.maximum(now, 1e-300), initial=0.0)
            if np.isfinite(before).any() and off <= _CONVERGED:
                break
            before = now
        if off > _CONVERGED:
            self.report(f"plugin {self.opened.name}: norms are known to {rounded_up(off)} of their size only")
        ends = np.maximum(np.abs(least), np.abs(greatest))
        rows = zip(names, now, ends, greatest, strict=True)
        return {name: Norm(float(l2), float(linf), float(most)) for name, l2, linf, most in rows}

    def box(self) -> dict[str, list[float]]:
        """Ends of the boxes around the elements."""
        return _box(volume_of(self.opened, self.opened.fields[:1]))

    def facts(self, texts: Sequence[str]) -> dict[str, Any]:
        """All facts, by topic, as plain data."""
        names = [*self.opened.fields, *texts]
        with self._load(self.expressions(names)) as (volume, device):
            extents = [_extents(number, names, volume, device) for number in range(len(volume.parts))]
        lowest = np.stack([own for own, _ in extents]).min(axis=0)
        highest = np.stack([own for _, own in extents]).max(axis=0)
        fields = _ranges(names, volume, lowest[1:], highest[1:])
        return {
            "plugin": self.opened.name,
            "format": self.opened.source.format,
            "dimension": volume.dimension,
            "time": float(self.opened.source.time),
            "elements": {part.type: len(part) for part in volume.parts},
            "box": _box(volume),
            "jacobian": {"minimum": float(lowest[0]), "maximum": float(highest[0])},
            "fields": {name: fields[name] for name in self.opened.fields},
            "quantities": {name: fields[name] for name in texts},
        }


def _places(points: Floats, volume: Volume, device: Renderer, every: bool) -> tuple[Ints, Ints, Ints, Floats, Ints]:
    """Locations of points: number of the point, part (-1 outside), element of the part, reference point and status."""
    found = device.probe(points)
    first = starts_of(volume.parts)
    held = found.element >= 0
    owner = np.where(held, found.owner.astype(np.int64), 0)
    part = np.where(held, np.searchsorted(first, owner, side="right") - 1, -1)
    status = np.where(found.status == _AMBIGUOUS, _INSIDE, found.status).astype(np.int64)
    answer = np.arange(len(points)), part, np.where(held, owner - first[part], -1), found.reference, status
    border = np.flatnonzero(found.status == _AMBIGUOUS)
    if not every or not len(border):
        return answer

    # borders are shared: each element that may hold such a point is asked
    rows = [np.delete(column, border, axis=0) for column in answer]
    parts = [tuple(rows)]
    for number, some in enumerate(volume.parts):
        near, local = BoxTree.build(np.asarray(some.boxes)).candidates(points[border])
        if len(near):
            reference, inside = _invert(number, local, points[border[near]], device)
            count = np.full(int(inside.sum()), 1)
            parts.append((border[near[inside]], number * count, local[inside], reference[inside], _INSIDE * count))
    joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    point, part, local, reference, status = (column[order] for column in joined)
    return point, part, local, reference, status


def _invert(number: int, elements: Ints, points: Floats, device: Renderer) -> tuple[Floats, Bools]:
    """Reference points (n, 3) of world points (n, 3) in elements (n,) of a part, and whether they lie inside.

    Uses Newton's method from the centre, with the kernels' maps.
    """
    reference = _samples_in(number, elements, np.zeros_like(points), device, None).center
    step = np.ones_like(points)
    for _ in range(_STEPS):
        found = _samples_in(number, elements, reference, device, None)
        step = np.einsum("nci,nc->ni", duals(found.jacobian), points - found.position)
        step = np.where(np.isfinite(step), step, 0.0)
        reference = reference + step / np.maximum(2 * np.abs(step).max(axis=1, keepdims=True), 1.0)
        if np.abs(step).max(initial=0.0) < _SHORT:
            break
    margin = _samples_in(number, elements, reference, device, None).margin
    return reference, (np.abs(step).max(axis=1) < _SHORT) & (margin >= -TOLERANCE)


def _values(text: str, part: Ints, local: Ints, reference: Floats, volume: Volume, device: Renderer) -> Floats:
    """(n,) a quantity where points were found, NaN elsewhere."""
    values = np.full(len(part), np.nan)
    for number in range(len(volume.parts)):
        here = np.flatnonzero(part == number)
        if len(here):
            values[here] = _samples_in(number, local[here], reference[here], device, _quantity_name(volume, text)).value
    return values


def _quantity_name(volume: Volume, text: str) -> str | None:
    """The name of a quantity of the parts; None for their own field."""
    return text if text in volume.parts[0].quantities else None


def _samples_in(number: int, elements: Ints, reference: Floats, device: Renderer, quantity: str | None) -> Samples:
    """Samples at reference points (n, 3) of elements (n,), the plugin's own coordinates."""
    center = device.sample_elements(number, elements[:1], np.zeros((1, 3))).center[0]
    parts = [slice(first, first + _BATCH) for first in range(0, len(elements), _BATCH)]
    batches = [device.sample_elements(number, elements[part], reference[part] - center, quantity) for part in parts]
    columns = {name: np.concatenate([getattr(batch, name) for batch in batches]) for name in vars(batches[0])}
    return Samples(**columns)


def _rule(part: Part, modes: int) -> Cubature:
    """A rule for functions of ``modes`` modes: points (n, 3) in the plugin's own coordinates, and weights."""
    if part.shape is None:
        raise ElvisError(f"{part.type}: expected a part with a shape to integrate over, found none")
    rule = field_cubature(modified(part.shape, (modes,) * part.shape.dimension))
    points = np.zeros((len(rule.points), 3))
    points[:, : part.shape.dimension] = (1 + rule.points) / 2 if part.unit else rule.points
    return Cubature(points, rule.weights / 2**part.shape.dimension if part.unit else rule.weights)


def _sums(
    number: int, names: Sequence[str], rule: Cubature, volume: Volume, device: Renderer
) -> tuple[Floats, Floats, Floats]:
    """Integrals of squares, minimum and maximum values of coordinates and quantities over a part, (k,) each."""
    part = volume.parts[number]
    elements = np.repeat(np.arange(len(part)), len(rule.weights))
    points = np.tile(rule.points, (len(part), 1))
    place = _samples_in(number, elements, points, device, None)
    measure = np.tile(rule.weights, len(part)) * np.abs(np.linalg.det(place.jacobian))
    columns = []
    for name in names:
        if name in AXES and _quantity_name(volume, name) is None:
            columns.append(place.position[:, AXES.index(name)])
        else:
            columns.append(_samples_in(number, elements, points, device, _quantity_name(volume, name)).value)
    table = np.stack(columns)
    return (table**2) @ measure, table.min(axis=1), table.max(axis=1)


def _sampled(number: int, texts: Sequence[str], volume: Volume, device: Renderer) -> Iterator[list[Samples]]:
    """Samples of each quantity at many points of a part's elements, a batch of points at a time."""
    part = volume.parts[number]
    if part.shape is None:
        elements, offsets = probes(part, volume.dimension)
        points = offsets + device.sample_elements(number, elements[:1], offsets[:1]).center
        yield _inside(number, elements, points, texts, volume, device)
        return
    modes = min(16, max(4, int(np.cbrt(_MANY / len(part)))))
    lattice = _rule(part, modes).points
    for rows in chunks(len(part), max(1, _BATCH // len(lattice))):
        some = np.arange(rows.start, rows.stop)
        elements, points = every_pair(some, lattice)
        yield _inside(number, elements, points, texts, volume, device)


def _inside(
    number: int, elements: Ints, points: Floats, texts: Sequence[str], volume: Volume, device: Renderer
) -> list[Samples]:
    """Samples of each quantity at points (n, 3) of elements (n,), without points outside of their elements."""
    found = [_samples_in(number, elements, points, device, _quantity_name(volume, text)) for text in texts]
    inside = found[0].margin >= -1e-9
    return [Samples(**{name: column[inside] for name, column in vars(one).items()}) for one in found]


def _extents(number: int, texts: Sequence[str], volume: Volume, device: Renderer) -> tuple[Floats, Floats]:
    """(1 + k,) minima and maxima at the samples of a part: of the determinant, and of the finite values of quantities.

    Infinite without samples, the minimum positive and the maximum negative.
    """
    lowest, highest = np.full(1 + len(texts), np.inf), np.full(1 + len(texts), -np.inf)
    for batch in _sampled(number, texts, volume, device):
        columns = [np.linalg.det(batch[0].jacobian), *(own.value[np.isfinite(own.value)] for own in batch)]
        lowest = np.minimum(lowest, [column.min(initial=np.inf) for column in columns])
        highest = np.maximum(highest, [column.max(initial=-np.inf) for column in columns])
    return lowest, highest


def _ranges(texts: Sequence[str], volume: Volume, lowest: Floats, highest: Floats) -> dict[str, Any]:
    """Certified bounds of each quantity, where all parts give them, and the extrema (k,) of samples."""
    found: dict[str, Any] = {}
    for text, least, most in zip(texts, lowest.tolist(), highest.tolist(), strict=True):
        every = [part.quantities.get(text, part).bounds for part in volume.parts]
        bounds = [give() for give in every if give is not None]
        found[text] = dict.fromkeys(("lower", "upper", "minimum", "maximum"))
        if least <= most:
            found[text].update(minimum=least, maximum=most)
        if len(bounds) == len(every):
            low, high = np.nanmin([own[0].min() for own in bounds]), np.nanmax([own[1].max() for own in bounds])
            found[text].update(lower=float(low), upper=float(high))
    return found


def _box(volume: Volume) -> dict[str, list[float]]:
    """The ends of the elements' boxes."""
    lower, upper = corners_of_volume(volume).tolist()
    return {"lower": lower, "upper": upper}
