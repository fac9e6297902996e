"""Quantities as fields: expressions of a dataset, projected on its own elements, with measured errors.

On an element whose map is affine a polynomial of fields, coordinates and derivatives is a polynomial of known degree;
on a curved one this holds without derivatives.  There the projection is exact.  Elsewhere each element gets the lowest
order whose error, at points that no fit has seen, is within a tolerance.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.rounded_up import rounded_up
from elvis.core.data.conversion_errors import REPORT
from elvis.core.data.dataset import MAP_FIELDS, Dataset, Field
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression_nets import degree_on
from elvis.core.quantities.tree import Node, fold, whole_exponent
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import Settings
from elvis.plugins.conversion.plugin import Elements, PyramidSpace, SourceField
from elvis.plugins.conversion.report import Measure, RecordedReport, Report
from elvis.plugins.conversion.reporting import measures_of_fields
from elvis.plugins.data.common_blocks import on_common_blocks
from elvis.plugins.fourier.planes import has_waves
from elvis.plugins.projection.adaptivity import ORDERS_BEYOND
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.projection.verification import Tally
from elvis.plugins.transfers.field_passes import DatasetSource, FieldPass, blocks_of

#: error, relative to the quantity's range, at which orders are no longer raised for non-polynomials
TOLERANCE = 1e-6

#: the error of an unchanged map
EXACT_MAP = Measure("coordinates", 1, 0.0, 0.0, 0.0, 0.0, 0.0, -1, is_exact=True)

#: highest order tried for non-polynomials
_HIGHEST_ORDER = 16
#: maximum number of modes of an element for them: a hexahedron of order 8
_MOST_MODES = 729
#: number of elements whose maps are processed together
_AT_ONCE = 1 << 12


@dataclass(frozen=True, eq=False)
class AddedQuantities:
    """A dataset with further fields, and how far each of these is from its quantity."""

    dataset: Dataset
    measures: tuple[Measure, ...]


def with_quantity(dataset: Dataset, quantity: str, order: int | None = None, tolerance: float = TOLERANCE) -> Dataset:
    """The dataset with a quantity as a further field, projected on each element.

    quantity   ``NAME=EXPRESSION``, or a predefined quantity, whose name the field gets
    order      polynomial degree of the field, 1 to 30; by default the degree that contains the quantity if it is a
               polynomial, else the lowest one on each element within ``tolerance``
    tolerance  largest error, at points not used by the fit, relative to the quantity's range

    Coefficients of other fields remain unchanged.  Errors beyond rounding are stored in the metadata, like conversion
    errors: every command takes them into account.

    Data with a Fourier direction keep its waves: quantities that are linear in the fields are exact along it, and of
    others a remark states the part beyond these waves; ``order`` is by default the order of the fields.

    Raises ElvisError for an invalid quantity, a name that a field already has, and values that are not finite.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.with_quantity(ds, "w=u^2")
    <Dataset 2D: 1 triangle; fields u, v, w of order 2>
    """
    return add_quantities(dataset, [quantity], order, tolerance).dataset


def add_quantities(
    dataset: Dataset, quantities: Sequence[str], order: int | None = None, tolerance: float = TOLERANCE
) -> AddedQuantities:
    """The dataset with several quantities, which are all made of its own fields (see `with_quantity`)."""
    named = parse_quantities(dataset, quantities)
    if has_waves(dataset):
        return _with_waves(dataset, named, order)
    source = QuantitySource(dataset, named)
    passes = [FieldPass(source, fields, settings) for fields, settings in _settings(source, order, tolerance) if fields]
    pairs = [pair for own in passes for pair in zip(own.projection.fields, own.projection.findings.fields, strict=True)]
    in_order = [pair for name in named for pair in pairs if pair[0].field.name == name]
    _check_finite(in_order)
    for fit, tally in in_order:
        tally.terms = source.terms_of(fit.field.name)
    fitted, tallies = [fit for fit, _ in in_order], [tally for _, tally in in_order]
    measures = tuple(measures_of_fields(fitted, tallies, source))
    fields = [Field(own.name, blocks_of(passes, own.name), own.is_continuous) for own in measures]
    whole = on_common_blocks(replace(dataset, fields=(*dataset.fields, *fields)))
    remarks = (
        *whole.remarks,
        *(_beyond(own, tolerance) for own in measures if order is None and _is_beyond(own, tolerance)),
    )
    return AddedQuantities(replace(whole, metadata=with_errors(whole, measures), remarks=remarks), measures)


def _with_waves(dataset: Dataset, named: Mapping[str, Expression], order: int | None) -> AddedQuantities:
    """The dataset with quantities in the waves of its Fourier direction."""
    from elvis.plugins.fourier.quantities import WAVE_ROUNDING, wave_fields

    found = wave_fields(dataset, named, order)
    measures = tuple(measure for _, measure, _ in found)
    remarks = [
        f"{own.name} has waves beyond those of the data: their part, up to {left:.2g}, is left out"
        for own, left in ((measure, left) for _, measure, left in found)
        if left > WAVE_ROUNDING * own.magnitude
    ]
    whole = replace(dataset, fields=(*dataset.fields, *(field for field, _, _ in found)))
    remarked = replace(whole, metadata=with_errors(whole, measures), remarks=(*whole.remarks, *remarks))
    return AddedQuantities(remarked, measures)


def _is_beyond(measure: Measure, tolerance: float) -> bool:
    """Whether a projection missed the tolerance, but for the margin with which errors are reported."""
    return not measure.is_exact and not measure.is_within(2 * tolerance)


def _beyond(measure: Measure, tolerance: float) -> str:
    return (
        f"{measure.name} is off by up to {rounded_up(measure.relative)} of its range, in element {measure.element}: "
        f"no order up to {measure.order} is within the tolerance {tolerance:g}"
    )


def parse_quantities(dataset: Dataset, texts: Sequence[str], on_sides: bool = False) -> dict[str, Expression]:
    """Expressions by the names of their fields; ElvisError for names in use, and quantities without values inside.

    on_sides  whether values are wanted on sides of elements, where quantities of walls also have values
    """
    names, found = Names.of(dataset), dict[str, Expression]()
    taken = {field.name for field in dataset.fields} | set(MAP_FIELDS)
    for text in texts:
        name, expression = _parsed(text, names)
        if name in taken or name in found:
            raise ElvisError(f"field {name!r} already exists; give the quantity another name, as in {name}2=…")
        sides = sorted(set(expression.attributes) & set(SIDES))
        if sides and not on_sides:
            raise ElvisError(f"{name}: expected a quantity with values inside elements, found one on faces only")
        found[name] = expression
    return found


def _parsed(text: str, names: Names) -> tuple[str, Expression]:
    """The name and the expression of ``NAME=EXPRESSION``, or of a single name."""
    name, sign, quantity = (part.strip() for part in text.partition("="))
    if not name.isidentifier() or (sign and not quantity):
        raise ElvisError(f"expected NAME=EXPRESSION, such as Cp=2*(p-1), or a predefined quantity, found {text!r}")
    return name, Expression.parse(quantity if sign else name, names)


class QuantitySource(DatasetSource):
    """Expressions of a dataset as the fields of a source that has the dataset's mesh.

    degrees  of each quantity on each block; None where it is not known to be a polynomial
    """

    format = "quantities of fields"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files."""
        return False

    def __init__(self, dataset: Dataset, named: Mapping[str, Expression]) -> None:
        self.dataset, self.named, self.mesh = dataset, dict(named), dataset.mesh
        self._evaluator = Evaluator(dataset, list(named.values()))
        self._parts = [part for patch in self._evaluator.patches for part in _split(patch)]
        self.blocks = [self._block(number) for number in range(len(self._parts))]
        self.degrees = {name: [self._degree(own, i) for i in range(len(self.blocks))] for name, own in named.items()}
        self.fields = [self._field(name) for name in named]
        self._last: tuple[Elements, Floats, Lattice] | None = None
        self.errors = {name: self._radius(own) for name, own in named.items()} if self._evaluator.errors else {}

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The map of the dataset."""
        return self._places(block, points).positions.reshape(len(block), len(points), 3)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The values of the expression."""
        values = next(iter(self._evaluator.values_at([self.named[field.name]], self._places(block, points))))
        return np.broadcast_to(values, len(block) * len(points)).reshape(len(block), len(points))

    def _places(self, block: Elements, points: Floats) -> Lattice:
        """The points in each element; results of the last call are cached, as quantities are sampled in turn."""
        if self._last is None or self._last[0] is not block or self._last[1] is not points:
            patch, rows, _ = self._parts[block.key]
            self._last = block, points, Lattice(patch, rows[block.rows], points)
        return self._last[2]

    def _block(self, number: int) -> Elements:
        patch, rows, _ = self._parts[number]
        fields = [expansion for expansion in patch.fields if expansion is not None]
        is_polynomial = bool(fields) and fields[0].bases[-1] is Basis.ORTHO_PYR_C
        pyramid = PyramidSpace.POLYNOMIAL if is_polynomial else PyramidSpace.NATIVE
        order, ids = max(patch.geometry.modes) - 1, patch.element_ids[rows]
        return Elements(patch.shape, len(rows), order, ids=ids, pyramid=pyramid, key=number)

    def _degree(self, expression: Expression, number: int) -> int | None:
        """The degree on a block; on pyramids, whose spaces contain no products, only of linear combinations."""
        patch, _, is_affine = self._parts[number]
        if patch.shape is Shape.PYRAMID:
            if expression.degree(lambda node: None if node.op == "attribute" or node.axes else 1) not in (0, 1):
                return None
            return self._leaf_degree(expression, patch)
        return degree_on(expression, self._evaluator, patch, is_affine)

    def _leaf_degree(self, expression: Expression, patch: Patch) -> int:
        """The highest degree of a field in an expression, and of the map where coordinates are in it."""
        own = [patch.fields[self._evaluator.names.index(name)] for name in expression.fields]
        if any(node.op == "coordinate" for node in expression.leaves):
            own.append(patch.geometry)
        return max((max(expansion.modes) - 1 for expansion in own if expansion is not None), default=1)

    def _field(self, name: str) -> SourceField:
        """A quantity on the blocks that have its fields, at its degree there or the one from which a search starts."""
        expression = self.named[name]
        orders = [self._order(expression, number, degree) for number, degree in enumerate(self.degrees[name])]
        return SourceField(name, orders, _is_continuous(expression, self.dataset), False, name)

    def _order(self, expression: Expression, number: int, degree: int | None) -> int | None:
        patch = self._parts[number][0]
        if any(patch.fields[self._evaluator.names.index(name)] is None for name in expression.fields):
            return None
        if degree is not None:
            return degree
        # the search ends some orders higher, or when elements have more modes than are affordable
        start = self._leaf_degree(expression, patch)
        last = min(start + ORDERS_BEYOND, _HIGHEST_ORDER)
        while last > start and mode_count(modified(patch.shape, (last + 1,) * patch.shape.dimension)) > _MOST_MODES:
            last -= 1
        return max(1, last - ORDERS_BEYOND)

    def terms_of(self, name: str) -> float:
        """A bound of the terms that add up to a polynomial, to which rounding is relative; 0 for other quantities.

        Derivatives of order k are sums of terms as large as a field's coefficients times the k-th power of the
        gradients of reference coordinates.
        """
        if None in self.degrees[name]:
            return 0.0
        return max(self._terms(self.named[name], patch, rows) for patch, rows, _ in self._parts)

    def _terms(self, expression: Expression, patch: Patch, rows: Ints) -> float:
        middle = Lattice(patch, rows, patch.shape.vertices.mean(axis=0, keepdims=True))
        steepest = float(np.nan_to_num(np.abs(middle.duals), posinf=0.0).max())

        def leaf(node: Node) -> float:
            if node.op == "number":
                return abs(node.value)
            if node.op == "coordinate":
                return float(np.abs(patch.geometry_coefficients[rows]).max())
            if node.op == "attribute":
                return 0.0
            own = patch.coefficients[self._evaluator.names.index(node.name)]
            return 0.0 if own is None else float(np.abs(own[rows]).max()) * steepest ** len(node.axes)

        return fold(expression.root, leaf, _term)

    def _radius(self, expression: Expression) -> tuple[float, float]:
        """Difference of an expression from its value before the conversion of the data, at vertices and middles."""
        worst = 0.0
        for patch, rows, _ in self._parts:
            points = np.concatenate([patch.shape.vertices, patch.shape.vertices.mean(axis=0, keepdims=True)])
            radii = self._evaluator.radius_at(expression, Lattice(patch, rows, points))
            worst = max(worst, float(np.max(radii, initial=0.0)))
        return worst, np.inf if worst else 0.0


def _term(node: Node, parts: list[float]) -> float:
    """The magnitude of an operation in a polynomial, from the magnitudes of its operands."""
    if node.op in ("+", "-"):
        return sum(parts)
    if node.op == "*":
        return parts[0] * parts[1]
    if node.op == "/":
        return parts[0] / (parts[1] or 1.0)
    exponent = whole_exponent(node)
    return max(parts) if exponent is None else parts[0] ** exponent


def _split(patch: Patch) -> list[tuple[Patch, Ints, bool]]:
    """A patch, rows of it, and whether the maps of these are affine."""
    every = np.arange(len(patch))
    parts = [every[first : first + _AT_ONCE] for first in range(0, len(patch), _AT_ONCE)]
    affine: Bools = np.concatenate([Piece(patch, own, patch.shape).is_affine for own in parts])
    return [(patch, every[own], is_affine) for own, is_affine in ((affine, True), (~affine, False)) if own.any()]


def _is_continuous(expression: Expression, dataset: Dataset) -> bool:
    """Whether a quantity is continuous between elements: it depends only on coordinates and continuous fields."""
    if expression.attributes or expression.order:
        return False
    return all(dataset.field(name).continuous for name in expression.fields)


def _settings(source: QuantitySource, order: int | None, tolerance: float) -> list[tuple[list[SourceField], Settings]]:
    """Fields, each on some blocks, and how they are projected there: exactly, or within the tolerance."""
    if order is not None:
        return [(list(source.fields), Settings(order=order))]
    exact, others = list[SourceField](), list[SourceField]()
    for field in source.fields:
        is_known = [degree is not None for degree in source.degrees[field.name]]
        for fields, wanted in ((exact, True), (others, False)):
            orders = [field.order_on(i) if own is wanted else None for i, own in enumerate(is_known)]
            if any(each is not None for each in orders):
                fields.append(replace(field, order=orders, is_polynomial=wanted))
    return [(exact, Settings()), (others, Settings(tolerance=tolerance, order=None))]


def _check_finite(pairs: Sequence[tuple[FieldFit, Tally]]) -> None:
    """ElvisError for a quantity that has no finite value somewhere."""
    for fit, tally in pairs:
        ids = np.unique(joined_ints(tally.broken))
        if len(ids):
            few = ", ".join(map(str, ids[:4].tolist())) + (", …" if len(ids) > 4 else "")
            raise ElvisError(f"{fit.field.name}: expected finite values, found others in {len(ids)} elements: {few}")


def with_errors(dataset: Dataset, measures: Sequence[Measure]) -> Mapping[str, str]:
    """The metadata, with errors of projections added to its conversion errors."""
    if REPORT not in dataset.metadata and all(own.is_exact for own in measures):
        return dataset.metadata
    facts = recorded_facts(dataset.metadata)
    facts["fields"] = {**facts["fields"], **{own.name: own.facts() for own in measures}}
    return {**dataset.metadata, REPORT: json.dumps(facts, allow_nan=False)}


def recorded_facts(metadata: Mapping[str, str]) -> dict[str, Any]:
    """The facts of a recorded conversion, or, if there is none, of data that are their own source."""
    recorded = RecordedReport.of(metadata)
    if recorded is None:
        return {"converter": QuantitySource.format, "files": [], "geometry": EXACT_MAP.facts(), "fields": {}}
    return {"fields": {}, **recorded.facts}


def unchanged_map(dataset: Dataset) -> Measure:
    """The error of the map of a dataset's own elements, with its order."""
    order = max((max(patch.geometry.modes) - 1 for patch in patches(dataset, ())), default=1)
    return replace(EXACT_MAP, order=order)


def report_of_quantities(dataset: Dataset, measures: Sequence[Measure], files: Sequence[Path]) -> Report:
    """The report of quantities that became fields of a dataset with an unchanged mesh."""
    counts = {shape.label.lower(): len(entities) for shape, entities in dataset.mesh.elements.items()}
    names = tuple(file.name for file in files)
    return Report(QuantitySource.format, names, counts, unchanged_map(dataset), (0.0, -1), False, tuple(measures), {})
