"""Converted data at the source's own places: by element and reference point, and by search."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import positions, values
from elvis.core.numbers.sampling import Sampler
from elvis.plugins.conversion.converting import Conversion


def native_places(conversion: Conversion, block: int, rows: Ints, points: Floats) -> tuple[Ints, Floats]:
    """Ids (n,) and native reference points (n, d) of points in elements of the source.

    block   number of the source's block
    rows    (n,) rows in it
    points  (n, d) reference points, one in each of these elements, as the converter's `sample` takes them
    """
    ids, native = np.full(len(rows), -1), np.full((len(rows), np.shape(points)[1]), np.nan)
    for own in conversion.blocks:
        if own.number != block or not len(own):
            continue
        place = np.full(max(int(own.rows.max()), int(np.max(rows, initial=0))) + 1, -1)
        place[own.rows] = np.arange(len(own))
        here = np.flatnonzero(place[rows] >= 0)
        found = place[rows[here]]
        ids[here] = own.ids[found]
        for order in np.unique(own.order[found]).tolist():
            those = here[own.order[found] == order]
            native[those] = own.native_points(order, np.asarray(points, np.float64)[those])
    return ids, native


class Probe:
    """A dataset, ready to be evaluated at native reference points of elements given by id."""

    def __init__(self, dataset: Dataset, name: str | None = None) -> None:
        self.patches = patches(dataset, [] if name is None else [name])

    def values(self, ids: Ints, points: Floats) -> Floats:
        """(n,) values of the field at reference points (n, d) of elements ``ids`` (n,); NaN for unknown elements."""
        result = np.full(len(ids), np.nan)
        for patch in self.patches:
            here, rows = _rows(patch.element_ids, ids)
            if len(here) and patch.fields[0] is not None:
                result[here] = values(patch, 0, rows, points[here])
        return result

    def positions(self, ids: Ints, points: Floats) -> Floats:
        """(n, 3) world coordinates of reference points (n, d) of elements ``ids`` (n,); NaN for unknown elements."""
        result = np.full((len(ids), 3), np.nan)
        for patch in self.patches:
            here, rows = _rows(patch.element_ids, ids)
            if len(here):
                result[here] = positions(patch, rows, points[here])
        return result


def _rows(known: Ints, wanted: Ints) -> tuple[Ints, Ints]:
    """Which of the ``wanted`` ids are known, and where."""
    order = np.argsort(known)
    place = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    here = np.flatnonzero(known[place] == wanted)
    return here, place[here]


def values_at(
    conversion: Conversion, field: str, block: int, rows: Ints, points: Floats, dataset: Dataset | None = None
) -> Floats:
    """(n,) values of a converted field at the source's reference points: see `native_places`.

    dataset  what to evaluate, for example the converted data read back; the conversion's own by default
    """
    ids, native = native_places(conversion, block, rows, points)
    return Probe(dataset or conversion.dataset, field).values(ids, native)


def positions_at(
    conversion: Conversion, block: int, rows: Ints, points: Floats, dataset: Dataset | None = None
) -> Floats:
    """(n, 3) converted world coordinates of the source's reference points: see `native_places`."""
    ids, native = native_places(conversion, block, rows, points)
    return Probe(dataset or conversion.dataset).positions(ids, native)


def values_found(dataset: Dataset, field: str, points: Floats) -> Floats:
    """(n,) values of a field at world points (n, 3), by search; NaN where no element holds the point."""
    samples = Sampler(dataset, [field]).sample(np.asarray(points, np.float64))
    return samples.values[:, 0]
