"""Norms of coordinates and fields, by the quadrature that Nektar++ itself uses (format notes 7)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_floats, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.exact_sums import parts_of_sum, rounded_sum
from elvis.core.base.ranks import ALONE, Ranks, Turns
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import Dataset, Expansion, ExpansionRule, Homogeneous
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.cubature import Cubature, field_cubature, rule_cubature
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.polynomials.expansion import mode_count
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.largest_radii import largest_radii
from elvis.core.shapes import Shape

AXES = ("x", "y", "z")

#: planes of a single wave, and where the plane of half of one lies
_OF_A_WAVE, _HALVES = 4, {Basis.FOURIER_HALF_MODE_RE: 0.0, Basis.FOURIER_HALF_MODE_IM: -0.5}

#: numbers in a table of values at quadrature points
_BATCH = 1 << 20


@dataclass(frozen=True)
class Norm:
    """Norms of one function.

    l2       root of the integral of its square
    linf     largest magnitude at the quadrature points
    maximum  largest value, with its sign, at the quadrature points
    l2_error, linf_error  their estimated deviation from the norms of the source that the data were converted from
    """

    l2: float
    linf: float
    maximum: float
    l2_error: float = 0.0
    linf_error: float = 0.0


def norms(dataset: Dataset, ranks: Ranks = ALONE) -> dict[str, Norm]:
    """Norms over the domain: of the coordinates first, then of the fields, in the order of the file.

    ranks  share the work with bit-identical results: with a part of a mesh (`elvis.core.portions`) each rank takes its
           elements; only the first rank has the result

    Fields are integrated by the rule of their own orders, coordinates by the rule of the first field, or for a mesh
    without fields by EXPANSIONS.  Integrals over surfaces and curves in space use their area and length.  Homogeneous
    directions add their coordinate; their planes weigh LZ/n each, but 1 on segments with one such direction, as in
    FieldConvert.  Raises ElvisError if the domain, or a field on it, holds no element.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> round(elvis.norms(ds)["u"].l2, 6)
    0.288675
    """
    # fields that are the map count only where there are no others: then coordinates are integrated by their rule
    names, axes = [one.name for one in dataset.solution or dataset.fields], _axes(dataset)
    space = dataset.mesh.space
    fields = {name: _Sum() for name in names}
    coordinates, turns = [_Sum() for _ in axes], _turns(dataset, ranks)
    for patch in patches(dataset, names):
        for expansion in dict.fromkeys(own for own in patch.fields if own is not None):
            _add_fields(list(fields.values()), patch, expansion, turns)
        for rule, members in _coordinate_rules(dataset, patch):
            _add_coordinates(coordinates, space, patch, rule, members, turns)
    errors = ConversionErrors.of(dataset.metadata)
    radii = dict.fromkeys(axes, errors.place.value) | {name: loss.value for name, loss in errors.fields.items()}
    found = _gathered(dict(zip(axes, coordinates, strict=True)) | fields, dataset, ranks, radii)
    return {name: norm for name, norm in found.items() if name not in dataset.map_names}


def quantity_norms(dataset: Dataset, expressions: Sequence[Expression], ranks: Ranks = ALONE) -> dict[str, Norm]:
    """Norms of expressions over the elements that have all of their fields.

    NaN if an expression has no value at some point.

    The rule is chosen by the field with the most modes in the expression, or by the map without fields.
    ranks  as in `norms`
    Raises ElvisError if no element of the domain has all fields of an expression.
    """
    sums = {each.text: _Sum() for each in expressions}
    for each in expressions:
        for values, measure in _quadrature(dataset, each, np.inf, _turns(dataset, ranks)):
            sums[each.text].add(values, measure)
    texts = [each.text for each in expressions]
    radii = dict(zip(texts, largest_radii(dataset, expressions).tolist(), strict=True))
    return _gathered(sums, dataset, ranks, radii)


def _turns(dataset: Dataset, ranks: Ranks) -> Turns:
    """The batches of elements that a rank takes: all if it has a part of them."""
    return Turns(ranks if dataset.mesh.excerpt is None else ALONE)


def _gathered(sums: dict[str, _Sum], dataset: Dataset, ranks: Ranks, radii: Mapping[str, float]) -> dict[str, Norm]:
    """The norms of functions by name, from the sums of all ranks; empty except at the first rank.

    radii  deviation of each function from the source
    """
    found = {name: total.found(radii.get(name, 0.0)) for name, total in sums.items()}
    every = ranks.gather(found, f"norms of {', '.join(sums)} on {dataset.mesh.count} elements")
    whole = {name: [own[name] for own in every] for name in sums} if every else {}
    empty = [name for name, parts in whole.items() if not any(own.count for own in parts)]
    if empty:
        raise ElvisError(f"expected elements of the domain under {', '.join(empty)}, found none")
    slope = ConversionErrors.of(dataset.metadata).place.slope
    stretch = (1 + slope) ** (dataset.mesh.dimension / 2) - 1
    return {name: _norm(parts, stretch) for name, parts in whole.items()}


def integration_points(
    dataset: Dataset, expression: Expression, most: float = np.inf
) -> Iterator[tuple[Floats, Floats]]:
    """Values and measures, both (elements, points), of an expression's quadrature, a batch of elements after the other.

    most  where there are more points than this, only each n-th element of every patch is taken
    """
    return _quadrature(dataset, expression, most, Turns(ALONE))


def _quadrature(dataset: Dataset, expression: Expression, most: float, turns: Turns) -> Iterator[tuple[Floats, Floats]]:
    """The quadrature for the batches that a rank takes in turn."""
    evaluator = Evaluator(dataset, [expression])
    rules = []
    for patch in evaluator.patches:
        expansions = [own for own in patch.fields if own is not None]
        if len(expansions) == len(patch.fields):
            expansion = max(expansions, key=mode_count, default=patch.geometry)
            rules.append((patch, _Rule(field_cubature(expansion), patch.shape, expansion.homogeneous)))
    every = max(1, int(np.ceil(sum(len(patch) * len(rule.points()) for patch, rule in rules) / most)))
    for patch, rule in rules:
        points = rule.points()
        members = np.arange(0, len(patch), every)
        for batch in turns.of(_batches(len(members), len(points))):
            rows = members[batch]
            places = np.tile(points, (len(rows), 1))
            values = evaluator.values(expression, patch, np.repeat(rows, len(points)), places)
            measure = _map_points(patch, rule, patch.geometry_coefficients[rows])[1]
            yield values.reshape(len(rows), len(points)), measure


@dataclass
class _Sum:
    """The accumulated sums of a function over some elements.

    squares  (n,) integrals of the square over these, in batches
    """

    count: int = 0
    squares: list[Floats] = field(default_factory=list)
    minimum: float = field(default=np.inf)
    maximum: float = field(default=-np.inf)
    measure: float = 0.0

    def add(self, values: Floats, measure: Floats) -> None:
        """Add elements: values at points (n, q), and the measure (n, q) of each."""
        self.count += values.size
        self.measure += float(measure.sum())
        self.squares.append((values * values * measure).sum(axis=1))
        self.minimum = float(np.minimum(self.minimum, values.min()))
        self.maximum = float(np.maximum(self.maximum, values.max()))

    def found(self, radius: float) -> _Found:
        """The data for other ranks about a function with an error of at most ``radius``."""
        squares = joined_floats(self.squares)
        return _Found(self.count, parts_of_sum(squares), self.minimum, self.maximum, self.measure, radius)


@dataclass(frozen=True)
class _Found:
    """Number of sampled values of a function, numbers with the exact sum of their squares, and their extrema.

    measure  of the elements
    radius   deviation of the function from the source
    """

    count: int
    squares: list[float]
    minimum: float
    maximum: float
    measure: float
    radius: float


def _norm(parts: Sequence[_Found], stretch: float) -> Norm:
    """The norms of what several know of different elements.

    stretch  share by which the root of the measure is wrong

    Squares are added up exactly and rounded once, so that the sum doesn't depend on who knows which.
    """
    l2 = float(np.sqrt(rounded_sum([number for own in parts for number in own.squares])))
    least, greatest = np.min([own.minimum for own in parts]), np.max([own.maximum for own in parts])
    radius = max(own.radius for own in parts)

    # | ||f|| - ||g|| | <= ||f - g|| <= radius times the root of the measure
    l2_error = radius * float(np.sqrt(sum(own.measure for own in parts)))
    l2_error = (1 + stretch) * l2_error + stretch * l2 if radius or stretch else 0.0
    return Norm(l2, float(np.maximum(abs(least), abs(greatest))), float(greatest), l2_error, radius)


def _planes(dataset: Dataset) -> Homogeneous | None:
    """The homogeneous directions of the first field that has any."""
    everything = (block.expansion.homogeneous for one in dataset.fields for block in one.blocks)
    return next((planes for planes in everything if planes is not None), None)


def _axes(dataset: Dataset) -> tuple[str, ...]:
    """Coordinates of the space, and one for each homogeneous direction."""
    planes = _planes(dataset)
    return AXES[: dataset.mesh.space + (len(planes.bases) if planes else 0)]


def _coordinate_rules(dataset: Dataset, patch: Patch) -> Iterator[tuple[_Rule, Bools]]:
    """Rules for the coordinates of a patch, each with the (n,) elements under it."""
    everything, planes = np.ones(len(patch), bool), _planes(dataset)
    first = next((expansion for expansion in patch.fields if expansion is not None), None)
    if first is not None:
        yield _Rule(field_cubature(first), patch.shape, planes), everything
        return
    for entry in dataset.expansions:
        members = everything & np.isin(patch.element_ids, _composite_ids(dataset, patch.shape, entry))
        if members.any():
            yield _Rule(rule_cubature(patch.shape, entry), patch.shape, planes), members
        everything &= ~members
    if everything.any():
        yield _Rule(field_cubature(patch.geometry), patch.shape, planes), everything


def _composite_ids(dataset: Dataset, shape: Shape, entry: ExpansionRule) -> Ints:
    """Elements of a shape that an entry of EXPANSIONS covers."""
    tags = {shape.tag, {1: "E", 2: "F"}.get(shape.dimension, shape.tag)}
    parts = [part for c in dataset.mesh.composites if c.id in entry.composites for part in c.parts]
    return joined_ints(ids for tag, ids in parts if tag in tags)


@dataclass(frozen=True, eq=False)
class _Rule:
    """Quadrature of a shape, repeated on the planes of homogeneous directions."""

    flat: Cubature
    shape: Shape
    planes: Homogeneous | None = None

    @property
    def zeta(self) -> Floats:
        """(k, directions) reference coordinates of the planes, y fastest; one plane of none without such directions."""
        if self.planes is None:
            return np.empty((1, 0))
        numbers = (self.planes.y_ids, self.planes.z_ids) if len(self.planes.bases) == 2 else (self.planes.z_ids,)
        axes = [_plane_points(basis, len(set(ids))) for basis, ids in zip(self.planes.bases, numbers, strict=True)]
        mesh = np.meshgrid(*axes[::-1], indexing="ij")
        return np.stack([part.reshape(-1) for part in mesh[::-1]], axis=1)

    @property
    def share(self) -> float:
        """Weight of each plane."""
        if self.planes is None or (self.shape is Shape.SEGMENT and len(self.planes.bases) == 1):
            return 1.0
        return float(np.prod(self.planes.lengths)) / len(self.zeta)

    def length(self, direction: int) -> float:
        """Length of a homogeneous direction."""
        return self.planes.lengths[direction] if self.planes else 0.0

    def points(self) -> Floats:
        """(n k, d) reference points of all planes, plane slowest."""
        flat, zeta = self.flat.points, self.zeta
        return np.hstack([np.tile(flat, (len(zeta), 1)), np.repeat(zeta, len(flat), axis=0)])


def _plane_points(basis: Basis, count: int) -> Floats:
    """(k,) places zeta of the planes: evenly spaced, four for a single wave, one for half of one.

    FieldConvert places them in the same way.  It does not handle the sine half of a wave; there the plane is where the
    sine is 1.
    """
    if basis in _HALVES:
        return np.array([_HALVES[basis]])
    planes = _OF_A_WAVE if basis is Basis.FOURIER_SINGLE_MODE else count
    return -1 + 2 * np.arange(planes) / planes


def _add_fields(sums: Sequence[_Sum], patch: Patch, expansion: Expansion, turns: Turns) -> None:
    """Take in the fields that have this expansion, on all elements of a patch."""
    rule = _Rule(field_cubature(expansion), expansion.shape, expansion.homogeneous)
    points = rule.points()
    for batch in turns.of(_batches(len(patch), len(points))):
        measure = _map_points(patch, rule, patch.geometry_coefficients[batch])[1]
        for total, own, coefficients in zip(sums, patch.fields, patch.coefficients, strict=True):
            if own == expansion and coefficients is not None:
                total.add(evaluate(expansion, coefficients[batch], points), measure)


def _add_coordinates(sums: Sequence[_Sum], space: int, patch: Patch, rule: _Rule, members: Bools, turns: Turns) -> None:
    """Take in the coordinates, ``space`` of them and the homogeneous ones, on the elements ``members`` (n,)."""
    coefficients, planes = patch.geometry_coefficients[members], rule.zeta
    for batch in turns.of(_batches(len(coefficients), len(rule.points()))):
        places, measure = _map_points(patch, rule, coefficients[batch])
        for axis, total in enumerate(sums[:space]):
            total.add(np.tile(places[:, axis], (1, len(planes))), measure)
        for axis, total in enumerate(sums[space:]):
            along = rule.length(axis) * (1 + planes[:, axis]) / 2
            total.add(np.broadcast_to(np.repeat(along, len(rule.flat.points)), measure.shape), measure)


def _map_points(patch: Patch, rule: _Rule, coefficients: Floats) -> tuple[Floats, Floats]:
    """World coordinates (e, 3, n) of the flat quadrature points, and measure (e, n k) of all."""
    places, jacobians = evaluate_with_gradients(patch.geometry, coefficients, rule.flat.points)
    return places, np.tile(rule.share * rule.flat.weights * stretch_factors(jacobians), (1, len(rule.zeta)))


def stretch_factors(jacobians: Floats) -> Floats:
    """(e, n) length, area or volume factor of maps with derivatives (e, 3, n, d)."""
    if jacobians.shape[-1] == 1:
        return np.asarray(np.linalg.norm(jacobians[..., 0], axis=1))
    (ax, bx), (ay, by), (az, bz) = ([jacobians[:, axis, :, i] for i in (0, 1)] for axis in range(3))
    normal = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    if jacobians.shape[-1] == 2:
        return np.asarray(np.sqrt(sum(part * part for part in normal)))
    return np.asarray(np.abs(sum(part * jacobians[:, axis, :, 2] for axis, part in enumerate(normal))))


def _batches(elements: int, points: int) -> Iterator[slice]:
    step = max(1, _BATCH // (12 * points))
    return (slice(start, start + step) for start in range(0, elements, step))
