"""Norms of the difference of the fields that two solutions share, with stated errors.

On one mesh the difference is a polynomial in every element: squares are integrated exactly, and its largest magnitude
is found by branch and bound.  On two meshes, the second solution is located at every quadrature point on the first
one's elements, which are bisected at kinks on its borders, until the requested error is reached; the largest magnitude
is sought at points and on all pairs of elements that may meet, where it is bounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, overload

import numpy as np

from elvis.core.base.arrays import EPS, Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.base.rounded_up import rounded_up
from elvis.core.base.terminal import aligned
from elvis.core.bounds.extrema import Extremum
from elvis.core.data.dataset import Dataset
from elvis.core.differences.greatest import (
    greatest_at_points,
    greatest_near,
    greatest_of_fields,
    lattice_points,
)
from elvis.core.differences.overlaps import bound_of_difference
from elvis.core.differences.pairing import REFERENCE, Pair, common_fields, theirs
from elvis.core.files.columns import Columns
from elvis.core.integrals.groups import Sums
from elvis.core.integrals.reference_cells import whole_elements
from elvis.core.integrals.refinement import Summation
from elvis.core.mapping.patch import Patch, patches
from elvis.core.numbers.norms import integration_points
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.tree import Node, call, field, number, world_derivative

#: requested relative error of squares of norms, number of points of a first estimate, and maximum number of points at
#: which rules are compared
ERROR, _POINTS, _MOST = 1e-3, 20_000, 1 << 17
#: ratio of the bound to the largest difference found, above which a remark is made
_WIDE = 1.001
#: relative difference up to which no remark is made
_ROUNDED = 1e-11
#: rounding of a value, relative to its terms
_ROUNDING = 16 * EPS


@dataclass(frozen=True)
class Difference:
    """Norms of the difference of one field, over the part of the first dataset that the second covers.

    l1, l2     integral of the magnitude; root of the integral of the square
    h1         root of the integral of the square and of the squared gradient
    linf       largest magnitude found, attained at ``where``; the true maximum lies between it and ``bound``
    bound      proved upper bound of the magnitude everywhere, on borders from either side, by Bernstein coefficients,
               rounding included; NaN if unknown
    where      (x, y, z) of ``linf``
    element    id of the element of the first dataset there
    relative   ``l2`` divided by the norm of the second dataset's field
    covered    part of the first dataset's volume (area, length) that the second covers, 0 to 1
    l1_error, l2_error, h1_error, covered_error  error bounds of these
    """

    field: str
    l1: float
    l2: float
    h1: float
    linf: float
    bound: float
    where: tuple[float, float, float]
    element: int
    relative: float
    covered: float
    l1_error: float
    l2_error: float
    h1_error: float
    covered_error: float

    def facts(self) -> dict[str, Any]:
        """Plain data, by the names of the contract; None for a bound that is not known."""
        return {
            "L1": self.l1,
            "L2": self.l2,
            "H1": self.h1,
            "Linf": self.linf,
            "Linf_bound": self.bound if np.isfinite(self.bound) else None,
            "where": list(self.where),
            "element": self.element,
            "relative": self.relative,
            "covered": self.covered,
            "L1_error": self.l1_error,
            "L2_error": self.l2_error,
            "H1_error": self.h1_error,
            "covered_error": self.covered_error,
        }


class Differences(Sequence[Difference]):
    """The differences of fields of two datasets.

    is_same_mesh  whether they were taken by coefficients, exactly
    remarks       sentences on them
    elements      of the first dataset, and ``size``, the mean length of their edges: the root of their mean measure
    """

    def __init__(
        self, rows: Sequence[Difference], is_same_mesh: bool, remarks: Sequence[str], elements: int, size: float
    ) -> None:
        self._rows, self.is_same_mesh, self.remarks = tuple(rows), is_same_mesh, tuple(remarks)
        self.elements, self.size = elements, size

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, which: int) -> Difference: ...
    @overload
    def __getitem__(self, which: slice) -> Sequence[Difference]: ...
    def __getitem__(self, which: int | slice) -> Difference | Sequence[Difference]:
        return self._rows[which]

    def of(self, name: str) -> Difference:
        """The difference of a field; raises KeyError if it was not requested."""
        for row in self:
            if row.field == name:
                return row
        names = [row.field for row in self]
        raise KeyError(f"there is no difference of {name!r}{perhaps(name, names)}; there are {', '.join(names)}")

    def facts(self) -> dict[str, Any]:
        """Plain data by the names of the fields."""
        return {row.field: row.facts() for row in self}

    def columns(self) -> Columns:
        """A column of each fact, for files."""
        facts = [{"field": row.field, **row.facts()} for row in self]
        for row, own in zip(self, facts, strict=True):
            own["Linf_bound"] = row.bound
            own |= dict(zip("xyz", own.pop("where"), strict=True))
        return {name: np.array([own[name] for own in facts]) for name in facts[0]} if facts else {}

    def cells(self) -> list[tuple[str, ...]]:
        """The cells of a table, under `HEADERS`."""
        return [
            (
                row.field,
                *(f"{value:.6g}" for value in (row.l1, row.l2, row.h1, row.linf)),
                rounded_up(row.bound, 6) if np.isfinite(row.bound) else "-",
                " ".join(f"{x:.5g}" for x in row.where),
                "-" if np.isnan(row.relative) else f"{row.relative:.3g}",
                f"{row.covered:.6g}",
            )
            for row in self
        ]

    def __repr__(self) -> str:
        return "\n".join(aligned([HEADERS, *self.cells()], len(HEADERS) * [False]))


#: headers of the columns of a table
HEADERS = ("field", "L1", "L2", "H1", "Linf", "at most", "where", "relative", "covered")


def diff(
    first: Dataset, second: Dataset, fields: str | Sequence[str] | None = None, error: float = ERROR
) -> Differences:
    """Norms of the differences of fields that two datasets share, over the elements of the first.

    fields  names; None for all that both have
    error   requested relative error of squares of norms if the meshes differ
    Raises ElvisError if they share no field, if a named field is missing, or if they do not overlap.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.diff(ds, ds, "u")
    field  L1  L2  H1  Linf  at most ...
    """
    names = _chosen(first, second, fields)
    if not 0 < error < 1:
        raise ElvisError(f"expected an error between 0 and 1, found {error:g}")
    pair = Pair(first, second)
    found = [_whole_difference(name, list(pair.parts(name)), error) for name in names]
    rows = [row for row, _, _ in found]
    if not any(row.covered for row in rows):
        ours, others = (f"of {dataset.mesh.dimension}D data" for dataset in (first, second))
        raise ElvisError(
            f"expected overlapping datasets, found no overlap of the first, {ours}, with the second, {others}"
        )
    _, measure, held = found[0]
    elements = sum(map(len, held))
    dimension = max((patch.dimension for patch in held), default=1)
    size = (measure / max(elements, 1)) ** (1 / dimension)
    return Differences(rows, pair.is_same_mesh, [*_remarks(rows), *pair.remarks()], elements, size)


def _whole_difference(
    name: str, parts: Sequence[tuple[Dataset, bool]], error: float
) -> tuple[Difference, float, Sequence[Patch]]:
    """The difference of a field over all parts of the first dataset; their measure and elements."""
    found = [_Compared(dataset, name, is_common, error) for dataset, is_common in parts]
    sums = reduce(Sums.__add__, (own.sums for own in found))
    greatest = _greatest_of([own.greatest() for own in found])
    row = _difference(name, sums, greatest)
    return row, float(sums.measure[5]), [patch for own in found for patch in own.held]


def _chosen(first: Dataset, second: Dataset, fields: str | Sequence[str] | None) -> list[str]:
    known = common_fields(first, second)
    if not known:
        ours, others = (", ".join(one.name for one in dataset.solution) or "none" for dataset in (first, second))
        raise ElvisError(f"expected fields of the same names in both datasets, found {ours} and {others}")
    names = known if fields is None else [fields] if isinstance(fields, str) else list(fields)
    for name in names:
        if name not in known:
            both = f"expected a field that both datasets have ({', '.join(known)})"
            raise ElvisError(f"{both}, found {name!r}{perhaps(name, known)}")
    return names


def _remarks(rows: Sequence[Difference]) -> Iterator[str]:
    for row in rows:
        if row.covered < 1 - 1e-12:
            part = 1 - row.covered
            yield f"{row.field}: the second dataset does not cover {part:.3g} of the first, which is excluded"
        if np.isnan(row.bound):
            yield f"{row.field}: Linf is the maximum difference at points, without a proved bound"
        elif row.bound > _WIDE * row.linf and row.relative > _ROUNDED:
            known = f"between {row.linf:.6g} and {rounded_up(row.bound, 6)}"
            yield f"{row.field}: the maximum difference is {known}; no tighter bound is proved"


def _difference(name: str, sums: Sums, greatest: Extremum) -> Difference:
    """The norms of a field's difference from the integrals of `_Compared`."""
    size = np.sqrt(sums.value[3])
    l1, squares, slopes = sums.value[:3]
    noise = _ROUNDING * size
    return Difference(
        field=name,
        l1=float(l1),
        l2=float(np.sqrt(squares)),
        h1=float(np.sqrt(squares + slopes)),
        linf=greatest.value,
        bound=greatest.bound,
        where=greatest.position,
        element=greatest.element,
        relative=float(np.sqrt(squares) / size) if size > 0 else np.nan,
        covered=float(sums.measure[4] / sums.measure[5]),
        l1_error=float(sums.error[0] + noise * np.sqrt(sums.measure[4])),
        l2_error=float(_of_root(squares, sums.error[1]) + noise),
        h1_error=float(_of_root(squares + slopes, sums.error[1] + sums.error[2]) + noise),
        covered_error=float((sums.error[4] + sums.error[5]) / sums.measure[5]),
    )


def _greatest_of(found: Sequence[Extremum]) -> Extremum:
    """The largest of several magnitudes, and the largest of their bounds."""
    known = [own for own in found if np.isfinite(own.value)] or list(found)
    best = max(known, key=lambda own: own.value)
    return replace(best, bound=float(np.max([own.bound for own in known])))


class _Compared:
    """One field of two solutions on a part of a dataset that holds both.

    held  the elements of the part
    sums  the integrals of `roots`
    """

    def __init__(self, both: Dataset, name: str, is_common: bool, error: float) -> None:
        self._both, self._name, self._is_common, self._error = both, name, is_common, error
        own, other = field(name), theirs(name, is_common)
        self._difference = call("-", own, other)
        axes = range(Names.of(both).dimension)
        slopes = [world_derivative(self._difference, axis) for axis in axes]
        roots = {
            "l1": call("abs", self._difference),
            "l2": _square(self._difference),
            "slope": _total([_square(slope) for slope in slopes]),
            "norm": _square(other),
            "covered": call("+", number(1.0), call("-", other, other)),
            "whole": number(1.0),
            "value": self._difference,
        }
        self._expressions = {key: Expression(key, root) for key, root in roots.items()}
        self._evaluator = Evaluator(both, list(self._expressions.values()))
        column = self._evaluator.names.index(name)
        self.held = [patch for patch in self._evaluator.patches if patch.fields[column] is not None]
        self.sums = self._summed(slopes)

    def greatest(self) -> Extremum:
        """The largest magnitude of the difference."""
        found = None
        if self._is_common:
            found = greatest_of_fields(self._both, *Expression("", self._difference).fields)
        if found is not None:
            return found
        at_points = greatest_at_points(self._evaluator, self.held, self._expressions["value"])
        if self._is_common or not np.isfinite(at_points.value):
            return at_points
        first, second = (
            [patch for patch in patches(one, [self._name]) if patch.fields[0] is not None]
            for one in (self._both, self._both.others[REFERENCE])
        )
        at_points = self._or_near(at_points, lattice_points(second))
        known = bound_of_difference(first, second, at_points)
        if known is None:
            return at_points
        best, doubtful = known
        return self._or_near(best, doubtful)

    def _or_near(self, best: Extremum, points: Floats) -> Extremum:
        """The largest difference so far, or a larger one near points (n, 3)."""
        if not len(points):
            return best
        found = greatest_near(self._evaluator, self.held, self._expressions["value"], points)
        if not found.value > best.value:
            return best
        return replace(found, bound=max(best.bound, found.value) if np.isfinite(best.bound) else best.bound)

    def _summed(self, slopes: Sequence[Node]) -> Sums:
        """The integrals of all expressions.

        Squares of differences are rounded relative to the difference, whose size is estimated at a few points.
        """
        own = [world_derivative(field(self._name), axis) for axis in range(len(slopes))]
        values = self._share(self._difference, field(self._name))
        gradients = self._share(*(_total([call("abs", slope) for slope in each]) for each in (slopes, own)))
        precision = [1.0, values, gradients, 1.0, 1.0, 1.0]
        expressions = list(self._expressions.values())[: len(precision)]
        summation = Summation(self._both, self._evaluator, expressions, self._error, precision, _MOST)
        return summation.over(list(whole_elements(tuple(self.held))))

    def _share(self, root: Node, of: Node) -> float:
        """Size of an expression relative to another, at some points: from rounding to 1."""
        value, size = (self._largest(node) for node in (root, of))
        return float(np.clip(value / size if size > 0 else 1.0, EPS, 1.0))

    def _largest(self, root: Node) -> float:
        """The largest finite magnitude of an expression at some points."""
        parts = integration_points(self._both, Expression("", root), _POINTS)
        finite = (np.abs(values[np.isfinite(values)]) for values, _ in parts)
        return max((float(values.max(initial=0.0)) for values in finite), default=0.0)


def _of_root(square: float, error: float) -> float:
    """Raise Error of a root if the square has an error."""
    return float(np.sqrt(square + error) - np.sqrt(max(square - error, 0.0)))


def _square(root: Node) -> Node:
    return call("^", root, number(2.0))


def _total(terms: Sequence[Node]) -> Node:
    return reduce(lambda total, term: call("+", total, term), terms)
