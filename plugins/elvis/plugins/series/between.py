"""Interpolation between the steps of a series: of coefficients in time, never of pictures.

The solution is linear in its coefficients, and the mesh is fixed: so the polynomial in time through the coefficients of
some steps is, at every point, the one through their values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.data.moments import BETWEEN
from elvis.core.polynomials.interpolation import lagrange_values

#: how many steps each way from steps to the time between them looks at
STEPS_OF = dict(zip(BETWEEN, (2, 4, 1), strict=True))
#: the polynomial in time through a number of steps
_POLYNOMIALS = {2: "linear", 3: "quadratic", 4: "cubic"}
#: relative distance, as a share of all times, within which a time equals a step's time
NEAR = 1e-12


def polynomial_name(between: str, count: int) -> str:
    """Name of the interpolation in a series of ``count`` steps: a cubic needs four."""
    return _POLYNOMIALS.get(min(STEPS_OF[between], count), between)


def window(times: Floats, time: float, count: int) -> list[int]:
    """The ``count`` steps, or all where these are fewer, of ascending ``times`` (n,) around a time.

    There are as many on either side, but at the ends of the series.
    """
    count = min(count, len(times))
    if count == 1:
        return [int(np.abs(times - time).argmin())]
    after = int(np.searchsorted(times, time, side="right"))
    first = min(max(after - count // 2, 0), len(times) - count)
    return list(range(first, first + count))


def weights(times: Floats, time: float) -> Floats:
    """(n,) values at a time of the Lagrange polynomials of ``times`` (n,)."""
    return np.asarray(lagrange_values(times, np.array([time]))[0])


def combined(
    steps: Sequence[Dataset], factors: Floats, all_agree: Callable[[bool], bool] = bool
) -> tuple[Dataset, tuple[str, ...]]:
    """The sum of datasets on one mesh times factors (n,), and the names of skipped fields.

    Fields are compatible if all steps have them on the same elements in the same bases.
    all_agree  whether a condition holds on all ranks, if the datasets belong to one of several
    """
    first, found, lacking = steps[0], list[Field](), list[str]()
    maps = first.map_names
    for field in first.fields:
        own = [step.field(field.name) for step in steps if field.name in step]
        if field.name in maps:
            found.append(field)
        elif len(own) == len(steps) and (total := sum_of(own, factors, all_agree)) is not None:
            found.append(total)
        else:
            lacking.append(field.name)
    names = {field.name for field in first.fields}
    lacking += sorted({field.name for step in steps for field in step.fields} - names)
    return replace(first, fields=tuple(found), rates=None), tuple(lacking)


def is_alike(one: Field, other: Field) -> bool:
    """Whether two fields have the same bases on the same elements, in one order."""
    blocks = zip(one.blocks, other.blocks, strict=False)
    return len(one.blocks) == len(other.blocks) and all(
        a.expansion == b.expansion and np.array_equal(a.element_ids, b.element_ids) for a, b in blocks
    )


def sum_of(own: Sequence[Field], factors: Floats, all_agree: Callable[[bool], bool] = bool) -> Field | None:
    """The sum of a field's steps times factors; None where these are not alike.

    all_agree  as of `combined`
    """
    if not all_agree(all(is_alike(own[0], other) for other in own[1:])):
        return None
    blocks = []
    for parts in zip(*(field.blocks for field in own), strict=True):
        total = np.zeros(parts[0].coefficients.shape)
        for part, factor in zip(parts, factors, strict=True):
            total += factor * part.coefficients
        blocks.append(Block(parts[0].expansion, parts[0].element_ids, frozen_floats(total)))
    states = {field.continuous for field in own}
    return Field(own[0].name, tuple(blocks), states.pop() if len(states) == 1 else None)


def is_finite(dataset: Dataset) -> bool:
    """Whether all coefficients are numbers, and finite."""
    return all(np.isfinite(block.coefficients).all() for field in dataset.fields for block in field.blocks)


def is_one_mesh(one: Dataset, other: Dataset) -> bool:
    """Whether two datasets have the same mesh, and the same map where fields give it."""
    if one.map_names != other.map_names or not is_same(one.mesh, other.mesh):
        return False
    return all(name in one and name in other and is_same(one.field(name), other.field(name)) for name in one.map_names)


def on_mesh_of(known: Dataset, dataset: Dataset) -> Dataset:
    """A dataset on the very mesh and map of a known one where it has the same, so that what follows is made once."""
    if not is_one_mesh(known, dataset):
        return dataset
    maps = {name: known.field(name) for name in known.map_names}
    fields = tuple(maps.get(field.name, field) for field in dataset.fields)
    return replace(dataset, mesh=known.mesh, fields=fields)


def is_same(one: Any, other: Any) -> bool:
    """Whether two trees of dataclasses, collections and arrays hold the same."""
    if one is other:
        return True
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(one, other)
    if type(one) is not type(other):
        return False
    if is_dataclass(one):
        return all(is_same(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(is_same(one[key], other[key]) for key in one)
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(map(is_same, one, other))
    return bool(one == other)
