"""Facts about the resolution of fields: a row for each field, its advice, and the worst elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.bounds.ranges import field_range
from elvis.core.data.dataset import Dataset
from elvis.core.mapping import pointwise
from elvis.core.mapping.geometry import share
from elvis.core.mapping.patch import patches
from elvis.core.quantities.derived import TRUNCATED, derived_name
from elvis.core.quantities.jumps import jumps
from elvis.core.quantities.tree import AXES
from elvis.core.resolution.element_resolution import ElementResolution, element_resolution
from elvis.core.resolution.gradient_errors import gradient_errors, work_of
from elvis.core.resolution.low_order_errors import with_neighbours
from elvis.core.resolution.truncation import difference

Facts = dict[str, Any]

#: elements that are listed
WORST = 10
#: estimated error, in parts of the norm of the field, below which a field counts as resolved
RESOLVED = 1e-4
#: work from which the error of the gradient is left out of a table (`gradient_errors.work_of`): a few seconds
_MOST_WORK = 1 << 22
#: share of the squared error that the worst elements hold, for which advice is given
_MAIN_SHARE = 0.9
#: decay rate from which a higher order pays more than smaller elements: amplitudes fall by e per order (Mavriplis 1990)
_FAST = 1.0
#: share of the squared error in one direction, or of a direction along one axis, from which it is named
_ONE_DIRECTION, _ONE_AXIS = 0.6, 0.8


@dataclass(frozen=True, eq=False)
class _Centres:
    """Elements by id, ascending, their centres (n, 3), and the derivatives of their maps there (n, 3, 3)."""

    ids: Ints
    places: Floats
    jacobians: Floats

    @staticmethod
    def of(dataset: Dataset) -> _Centres:
        """The elements of the domain."""
        ids, places, jacobians = [], [], []
        for patch in patches(dataset):
            centre = np.tile(patch.shape.centre, (len(patch), 1))
            world, own = pointwise.positions_and_jacobians(patch, np.arange(len(patch)), centre)
            ids.append(patch.element_ids)
            places.append(world)
            jacobians.append(np.pad(own, ((0, 0), (0, 0), (0, 3 - own.shape[2]))))
        every = np.concatenate(ids)
        order = np.argsort(every, kind="stable")
        return _Centres(every[order], np.concatenate(places)[order], np.concatenate(jacobians)[order])

    def rows(self, element_ids: Ints) -> Ints:
        """Rows (n,) of elements."""
        return np.searchsorted(self.ids, element_ids)


def resolution_facts(dataset: Dataset, names: Sequence[str]) -> Facts:
    """Facts on the resolution of fields, and the worst elements over all of them.

    ElvisError for fields without elements, or with Fourier directions.
    """
    # several measures take the same maps
    share(dataset.mesh)
    measures = {name: with_neighbours(dataset, name, element_resolution(dataset, name)) for name in names}
    centres = _Centres.of(dataset)
    return {
        "fields": [_field_facts(dataset, name, own, centres) for name, own in measures.items()],
        "worst": _worst(measures, centres),
    }


def _field_facts(dataset: Dataset, name: str, own: ElementResolution, centres: _Centres) -> Facts:
    """One field."""
    norm, error, removed = (_norm(values) for values in (own.norm, own.error, own.removed))
    largest = field_range(difference(dataset.field(name), dataset.field(derived_name(TRUNCATED, name))).blocks)
    is_known = np.isfinite(own.norm)
    return {
        "name": name,
        "elements": len(own),
        "orders": [int(own.orders.min()), int(own.orders.max())],
        "tail": {"median": _median(own.tail), "maximum": _greatest(own.tail)},
        "decay": {"median": _median(own.decay), "minimum": -_greatest(-own.decay)},
        "rates": [_median(own.rates[:, direction]) for direction in range(dataset.mesh.dimension)],
        "removed": {
            "L2": removed,
            "relative": _share(removed, norm),
            "bound": max(-largest.lower, largest.upper) if largest else np.nan,
            "attained": max(-largest.minimum, largest.maximum) if largest else np.nan,
        },
        "jump": _greatest(jumps(dataset, name)[1]),
        "error": {"L2": error, "relative": _share(error, norm)},
        "gradient_error": _gradient_error(dataset, name),
        "growing": own.element_ids[own.grows].tolist(),
        "not_finite": own.element_ids[~is_known].tolist(),
        "advice": _advice(own, _share(error, norm), centres),
    }


def _gradient_error(dataset: Dataset, name: str) -> Facts:
    """Estimated L2 norm of the error of the gradient, or the reason why it is missing."""
    mesh = dataset.mesh
    if mesh.dimension < mesh.space:
        return {"L2": None, "reason": "the elements are surfaces or curves in space"}
    if sum(map(len, dataset.field(name).blocks)) == 1:
        return {"L2": None, "reason": "a single element has no neighbours to recover it from"}
    if work_of(dataset, name) > _MOST_WORK:
        return {"L2": None, "reason": f"it takes long here; the quantity recovered_error({name}) has it"}
    return {"L2": _norm(gradient_errors(dataset, name)[1]), "reason": None}


def _norm(values: Floats) -> float:
    """Root of the sum of squares of the known norms on elements."""
    return float(np.sqrt(np.nansum(values**2)))


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0 else 0.0


def _median(values: Floats) -> float | None:
    """The median of the known values; None if all are unknown."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def _greatest(values: Floats) -> float:
    """The largest known value; NaN if all are unknown."""
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else np.nan


def _worst(measures: Mapping[str, ElementResolution], centres: _Centres) -> list[Facts]:
    """The elements with the largest estimated error, relative to the norm of the field; each with its worst field."""
    names = list(measures)
    shares = np.concatenate([own.error / (_norm(own.norm) or 1.0) for own in measures.values()])
    fields = np.repeat(np.arange(len(names)), [len(own) for own in measures.values()])
    rows = np.concatenate([np.arange(len(own)) for own in measures.values()])
    found: dict[int, Facts] = {}
    for place in np.argsort(-np.nan_to_num(shares, nan=-1.0), kind="stable").tolist():
        name, row = names[fields[place]], rows[place]
        own = measures[name]
        element = int(own.element_ids[row])
        if element not in found:
            found[element] = {
                "element": element,
                "position": centres.places[centres.rows(own.element_ids[row : row + 1])[0]].tolist(),
                "field": name,
                "tail": float(own.tail[row]),
                "decay": float(own.decay[row]),
                "removed": float(own.removed[row]),
                "error": float(own.error[row]),
                "relative": float(shares[place]),
                "grows": bool(own.grows[row]),
            }
        if len(found) == WORST:
            break
    return list(found.values())


def _advice(own: ElementResolution, share: float, centres: _Centres) -> str:
    """One line: what to do about the resolution of a field."""
    growing = int(own.grows.sum())
    told = ""
    if growing:
        count = f"{growing} element{'s' if growing > 1 else ''}"
        told = f"energy grows at the highest mode in {count}, as aliasing leaves it: dealias, or refine there; "
    if share <= RESOLVED:
        return f"{told}resolved: the estimated error is {share:.1g} of the norm"
    main = _main(own)
    decay = _median(own.decay[main])
    where = f"in {int(main.sum())} of {len(own)} elements, which hold {_MAIN_SHARE:.0%} of the squared error"
    if decay is None:
        return f"{told}refine h or raise p {where}; orders below 2 have no decay rate to decide between them"
    what = "raise p" if decay >= _FAST else "refine h"
    return f"{told}{what}{_direction(own, main, centres)} {where} and have a median decay rate of {decay:.2g}"


def _main(own: ElementResolution) -> Bools:
    """(n,) the fewest elements that hold most of the squared error."""
    squares = np.nan_to_num(own.error**2)
    order = np.argsort(-squares, kind="stable")
    totals = np.cumsum(squares[order])
    count = int(np.searchsorted(totals, _MAIN_SHARE * totals[-1])) + 1
    found = np.zeros(len(own), bool)
    found[order[:count]] = True
    return found


def _direction(own: ElementResolution, main: Bools, centres: _Centres) -> str:
    """The direction that contributes most of the error, in words; empty if no direction dominates."""
    squares = own.errors[main] ** 2
    parts = squares.sum(axis=0)
    direction = int(parts.argmax())
    if (own.rates.shape[1] == 1) or parts[direction] < _ONE_DIRECTION * parts.sum():
        return ""
    if not np.isfinite(own.rates[main]).any() or np.count_nonzero(parts) < 2:
        return ""

    # the share of the direction along each axis, in the mean weighted by the error
    tangents = centres.jacobians[centres.rows(own.element_ids[main]), :, direction]
    lengths = (tangents**2).sum(axis=1, keepdims=True)
    along = (squares[:, direction, None] * tangents**2 / np.where(lengths > 0, lengths, 1.0)).sum(axis=0)
    axis = int(along.argmax())
    is_along = along[axis] >= _ONE_AXIS * along.sum()
    axis_name = f" (along {AXES[axis]})" if is_along else ""
    return f" in reference direction {direction + 1}{axis_name}"
