"""Contents of a dataset: counts, orders, certified ranges, validity, as plain data that JSON can hold.

For a part of a dataset, additive facts are counted, and elements that may hold an end of a range are passed on.
Several ranks thus obtain the same summary as one process.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, grid_points, joined_ints
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.bounds.bounding import deciding_elements, quantity_range
from elvis.core.bounds.ranges import Range, deciding, field_ranges, finite_rows, value_range
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import MAP_KEY, Block, Dataset, Expansion, Field
from elvis.core.data.mesh import NON_CONFORMING, PERIODIC, Mesh
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.mapping.tangents import determinants
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate_with_gradients
from elvis.core.polynomials.quadrature import gauss
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities.expression import Expression
from elvis.core.shapes import Shape
from elvis.core.validity.folded import folded

Facts = dict[str, Any]

_NUMBERS_AT_ONCE = 1 << 19
_SHAPES = tuple(Shape)


def summary(whole: Dataset | Portion, quantities: Sequence[Expression] = (), ranks: Ranks = ALONE) -> Facts:
    """All facts about a dataset, by topic; the keys are the same as in ``elvis info --json``.

    whole       the dataset, or the part of one of several ranks; the parts are merged, and only the first rank has a
                result
    quantities  quantities whose ranges are included
    """
    dataset = whole if isinstance(whole, Dataset) else whole.dataset
    blocks = geometry(dataset)
    tallies = [_Tally.of(dataset, blocks)]
    if isinstance(whole, Portion):
        own = whole.of(_deciding(dataset, blocks, quantities)).alone
        every = ranks.gather((tallies[0], own), f"what is in {dataset.mesh.count} elements")
        if not every:
            return {}
        tallies = [tally for tally, _ in every]
        dataset = replace(unite([portion for _, portion in every]).dataset, surfaces=dataset.surfaces)
        blocks = geometry(dataset)
    mesh = dataset.mesh
    found = {
        "dimension": mesh.dimension,
        "space": mesh.space,
        "time": dataset.time,
        "mesh": _mesh(mesh, tallies),
        "geometry": {
            "given_by_fields": MAP_KEY in dataset.metadata,
            "expansions": _maps(tallies),
            "box": box(dataset, blocks),
            "jacobian": _jacobian([tally.signs for tally in tallies]),
        },
        "fields": _fields(dataset, tallies),
        "composites": _composites(mesh),
        "domains": {str(id): list(composites) for id, composites in mesh.domains.items()},
        "metadata": dict(dataset.metadata),
        "bytes": mesh.counts.bytes + sum(own.bytes for tally in tallies for own in tally.fields.values()),
    }
    if quantities:
        found["quantities"] = {each.text: _ends_of(quantity_range(dataset, each)) for each in quantities}
    return found


@dataclass(frozen=True)
class _Signs:
    """Signs of the Jacobian determinant.

    The fields are its extrema at sample points, and the ids of elements where it is not positive there or is proved
    not to be positive elsewhere.
    """

    minimum: float
    maximum: float
    wrong: list[int]

    @staticmethod
    def of(blocks: Sequence[GeometryBlock], space: int) -> _Signs:
        least, greatest, wrong = np.inf, -np.inf, list[int]()
        for block in blocks:
            for ids, found in _determinants(block, space):
                low = found.min(axis=1)
                # NaN is never an extreme, independent of the batches
                least = float(np.fmin.reduce(low, initial=least))
                greatest = float(np.fmax.reduce(found, axis=None, initial=greatest))
                wrong += ids[~(low > 0)].tolist()
        return _Signs(least, greatest, wrong)


@dataclass(frozen=True)
class _Coefficients:
    """Coefficients of a field.

    The fields are elements of each block, numbers of coefficients that are NaN or infinite, elements with such
    coefficients, and bytes.
    """

    elements: list[int]
    nan: int
    infinite: int
    not_finite: int
    bytes: int

    @staticmethod
    def of(field: Field) -> _Coefficients:
        every = [block.coefficients for block in field.blocks]
        return _Coefficients(
            list(map(len, field.blocks)),
            sum(int(np.isnan(own).sum()) for own in every),
            sum(int(np.isinf(own).sum()) for own in every),
            sum(int((~finite_rows(own)).sum()) for own in every),
            sum(block.element_ids.nbytes + block.coefficients.nbytes for block in field.blocks),
        )


@dataclass(frozen=True)
class _Tally:
    """Counts for some elements.

    in_domain  number of elements in the domain
    maps       for each block of the map, its position among the blocks of the whole, its expansion, and its number of
               elements
    """

    in_domain: int
    maps: Sequence[tuple[tuple[Any, ...], Expansion, int]]
    signs: _Signs
    fields: Mapping[str, _Coefficients]

    @staticmethod
    def of(dataset: Dataset, blocks: Sequence[GeometryBlock]) -> _Tally:
        given = [field.blocks for field in dataset.map_fields]
        mapped = joined_ints(block.element_ids for own in given for block in own)
        # see `elvis.core.mapping.geometry`: by shape and orders, then what fields give by the first element
        maps = [
            ((1, int(block.element_ids[0])), block.expansion, len(block))
            if np.isin(block.element_ids[0], mapped)
            else ((0, _SHAPES.index(block.expansion.shape), block.expansion.modes), block.expansion, len(block))
            for block in blocks
        ]
        signs = _Signs.of(blocks, dataset.mesh.space)
        signs = replace(signs, wrong=sorted({*signs.wrong, *folded(dataset).wrong.tolist()}))
        own = (field for field in dataset.fields if field.name not in dataset.borrowed)
        fields = {field.name: _Coefficients.of(field) for field in own}
        return _Tally(len(dataset.mesh.domain_ids()), maps, signs, fields)


def _deciding(dataset: Dataset, blocks: Sequence[GeometryBlock], quantities: Sequence[Expression]) -> Ints:
    """(n,) ids of elements that may hold an end of a range, and the first of each block of the map.

    The latter preserves the order of the blocks of the whole.
    """
    found = [block.element_ids[:1] for block in blocks]
    for axis in range(3):
        found.append(deciding([Block(b.expansion, b.element_ids, b.coefficients[:, axis]) for b in blocks]))
    found += [deciding(field.blocks) for field in dataset.solution]
    found += [deciding_elements(dataset, each) for each in quantities]
    return np.unique(np.concatenate(found))


def _mesh(mesh: Mesh, tallies: Sequence[_Tally]) -> Facts:
    """Counts of the entities of the mesh."""
    counts = mesh.counts
    entities = {shape: counts.entities[shape] for shape in Shape if counts.entities.get(shape)}
    (curved_edges, _), (curved_faces, _) = counts.curves
    joined = dict.fromkeys((NON_CONFORMING, PERIODIC), 0)
    for composite, sides in zip(mesh.composites, counts.composites, strict=True):
        if composite.name in joined:
            joined[composite.name] += sum(sides)
    return {
        "vertices": counts.vertices,
        "entities": {shape.label.lower(): count for shape, count in entities.items()},
        "elements": {shape.label.lower(): n for shape, n in entities.items() if shape.dimension == mesh.dimension},
        "elements_in_domain": sum(tally.in_domain for tally in tallies),
        "curved_edges": curved_edges,
        "curved_faces": curved_faces,
        "non_conforming_sides": joined[NON_CONFORMING],
        "periodic_sides": joined[PERIODIC],
    }


def _maps(tallies: Sequence[_Tally]) -> list[Facts]:
    """Orders of the map, and how many elements have each."""
    every = sorted((own for tally in tallies for own in tally.maps), key=lambda own: own[0])
    counts = dict.fromkeys(((place[0], expansion) for place, expansion, _ in every), 0)
    for place, expansion, count in every:
        counts[place[0], expansion] += count
    return [_expansion(expansion, count) for (_, expansion), count in counts.items()]


def box(dataset: Dataset, blocks: Sequence[GeometryBlock]) -> Facts:
    """The ends of the coordinates.

    Fourier directions follow the directions of the space and extend over their lengths.
    """
    ranges = [value_range((b.expansion, b.coefficients[:, axis]) for b in blocks) for axis in range(3)]
    lower, upper = ([_end(found, end) for found in ranges] for end in ("lower", "upper"))
    waves = [b.expansion.homogeneous for field in dataset.fields for b in field.blocks if b.expansion.homogeneous]
    if waves and ranges[0] is not None:
        for axis, length in enumerate(waves[0].lengths, dataset.mesh.space):
            lower[axis], upper[axis] = 0.0, length
    return {"lower": lower, "upper": upper}


def _end(found: Range | None, end: str) -> float | None:
    return None if found is None else getattr(found, end)


def _ends_of(found: Range | None) -> Facts | None:
    return None if found is None else asdict(found)


def jacobian(blocks: Sequence[GeometryBlock], space: int) -> Facts:
    """Extrema of the Jacobian determinant at quadrature points, and the elements where it is not positive there."""
    return _jacobian([_Signs.of(blocks, space)])


def _jacobian(every: Sequence[_Signs]) -> Facts:
    """Facts about signs, combined from several sets of elements."""
    least, greatest = min(own.minimum for own in every), max(own.maximum for own in every)
    has_any = least < np.inf or any(own.wrong for own in every)
    return {
        "sampled_at": "Gauss points, one more in each direction than the map has modes",
        "minimum": least if has_any else None,
        "maximum": greatest if has_any else None,
        "elements_not_positive": sorted(number for own in every for number in own.wrong),
    }


def _determinants(block: GeometryBlock, space: int) -> Iterator[tuple[Ints, Floats]]:
    """Ids (e,) and determinants (e, n) of some elements after another.

    If the space has more dimensions than the elements, the determinant is the factor of length or area, which is never
    negative.
    """
    points = gauss_points(block.expansion)
    dimension = block.expansion.shape.dimension
    step = max(1, _NUMBERS_AT_ONCE // (3 * len(points) * (dimension + 1)))
    for first in range(0, len(block), step):
        chunk = slice(first, first + step)
        jacobians = np.moveaxis(evaluate_with_gradients(block.expansion, block.coefficients[chunk], points)[1], 1, -2)
        if space == dimension < 3:
            found = np.linalg.det(jacobians[..., :space, :])
        else:
            found = determinants(jacobians.reshape(-1, 3, dimension)).reshape(-1, len(points))
        yield block.element_ids[chunk], found


def gauss_points(expansion: Expansion) -> Floats:
    """(n, d) Gauss points of the shape, one more in each direction of eta than the expansion has modes."""
    lines = [gauss(modes + 1)[0] for modes in expansion.modes]
    eta = grid_points(*lines)
    return uncollapse(expansion.shape, eta)


def _fields(dataset: Dataset, tallies: Sequence[_Tally]) -> list[Facts]:
    """`_field` of each field of the solution."""
    ranges = field_ranges([field.blocks for field in dataset.solution])
    errors = ConversionErrors.of(dataset.metadata)
    facts = []
    for field, found in zip(dataset.solution, ranges, strict=True):
        widened = found and found.widened(errors.of_field(field.name).value)
        facts.append(_field(field, widened, [own.fields[field.name] for own in tallies]))
    return facts


def _field(field: Field, found: Range | None, every: Sequence[_Coefficients]) -> Facts:
    """Size, orders and range of one field; elements with a coefficient that is not finite are counted apart.

    field  of elements that may hold an end of the range
    found  the range, which includes the error of its conversion
    every  of all elements
    """
    elements = [sum(own) for own in zip(*(own.elements for own in every), strict=True)]
    counts = dict.fromkeys((block.expansion for block in field.blocks), 0)
    for block, count in zip(field.blocks, elements, strict=True):
        counts[block.expansion] += count
    return {
        "name": field.name,
        "elements": sum(elements),
        "expansions": [_expansion(expansion, count) for expansion, count in counts.items()],
        "continuous": field.continuous,
        "range": {name: _end(found, name) for name in ("lower", "upper", "minimum", "maximum")},
        "nan": sum(own.nan for own in every),
        "infinite": sum(own.infinite for own in every),
        "elements_not_finite": sum(own.not_finite for own in every),
    }


def _expansion(expansion: Expansion, elements: int) -> Facts:
    facts: Facts = {
        "shape": expansion.shape.label.lower(),
        "bases": [basis.label for basis in expansion.bases],
        "modes": list(expansion.modes),
        "elements": elements,
    }
    if expansion.homogeneous is not None:
        facts["fourier"] = {
            "lengths": list(expansion.homogeneous.lengths),
            "planes": len(expansion.homogeneous.z_ids),
        }
    return facts


def _composites(mesh: Mesh) -> list[Facts]:
    """The composites; those that hold the same numbers of entities share a list, since a mesh may have very many."""
    known: dict[tuple[tuple[str, int], ...], list[Facts]] = {}
    found = []
    for composite, counts in zip(mesh.composites, mesh.counts.composites, strict=True):
        key = tuple((tag, count) for (tag, _), count in zip(composite.parts, counts, strict=True))
        parts = known.setdefault(key, [{"tag": tag, "entities": count} for tag, count in key])
        found.append({"id": composite.id, "name": composite.name, "label": composite.label, "parts": parts})
    return found
