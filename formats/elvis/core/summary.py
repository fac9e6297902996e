"""What is in a dataset: counts, orders, certified ranges, validity, as plain data that JSON can hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import MAP_KEY, Block, Dataset, Expansion, Field
from elvis.core.geometry import GeometryBlock, geometry
from elvis.core.mapping.tangents import determinants
from elvis.core.mesh import Composite, Mesh
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate_with_gradients
from elvis.core.polynomials.quadrature import gauss
from elvis.core.ranges import Range, field_range, finite_rows, value_range
from elvis.core.shapes import Shape

Facts = dict[str, Any]

_NUMBERS_AT_ONCE = 1 << 21


def summary(dataset: Dataset) -> Facts:
    """All facts about a dataset, by topic; the keys are those of ``elvis info --json``."""
    blocks = geometry(dataset)
    return {
        "dimension": dataset.mesh.dimension,
        "space": dataset.mesh.space,
        "time": dataset.time,
        "mesh": _mesh(dataset.mesh),
        "geometry": _geometry(dataset, blocks),
        "fields": [_field(field) for field in dataset.solution],
        "composites": [_composite(composite) for composite in dataset.mesh.composites],
        "domains": {str(id): list(composites) for id, composites in dataset.mesh.domains.items()},
        "metadata": dict(dataset.metadata),
        "bytes": _bytes(dataset),
    }


def _mesh(mesh: Mesh) -> Facts:
    """Counts of what the mesh is made of."""
    entities = {shape: len(mesh.of(shape)) for shape in Shape if len(mesh.of(shape))}
    return {
        "vertices": len(mesh.vertex_ids),
        "entities": {shape.label.lower(): count for shape, count in entities.items()},
        "elements": {shape.label.lower(): len(elements) for shape, elements in mesh.elements.items()},
        "elements_in_domain": len(mesh.domain_ids()),
        "curved_edges": len(mesh.edge_curves),
        "curved_faces": len(mesh.face_curves),
    }


def _geometry(dataset: Dataset, blocks: Sequence[GeometryBlock]) -> Facts:
    """Orders of the map, the box that holds all elements, and the sign of the Jacobian where it was sampled."""
    return {
        "given_by_fields": MAP_KEY in dataset.metadata,
        "expansions": [_expansion(block.expansion, len(block)) for block in blocks],
        "box": box(dataset, blocks),
        "jacobian": jacobian(blocks, dataset.mesh.space),
    }


def box(dataset: Dataset, blocks: Sequence[GeometryBlock]) -> Facts:
    """The ends of the coordinates; Fourier directions follow those of the space and run over their lengths."""
    ranges = [value_range((b.expansion, b.coefficients[:, axis]) for b in blocks) for axis in range(3)]
    lower, upper = ([_end(found, end) for found in ranges] for end in ("lower", "upper"))
    waves = [b.expansion.homogeneous for field in dataset.fields for b in field.blocks if b.expansion.homogeneous]
    if waves and ranges[0] is not None:
        for axis, length in enumerate(waves[0].lengths, dataset.mesh.space):
            lower[axis], upper[axis] = 0.0, length
    return {"lower": lower, "upper": upper}


def _end(found: Range | None, end: str) -> float | None:
    return None if found is None else getattr(found, end)


def jacobian(blocks: Sequence[GeometryBlock], space: int) -> Facts:
    """Extremes of the Jacobian determinant at quadrature points, and the elements where it is not positive there."""
    least, greatest, wrong = np.inf, -np.inf, []
    for block in blocks:
        for ids, found in _determinants(block, space):
            low = found.min(axis=1)
            least, greatest = min(least, float(low.min())), max(greatest, float(found.max()))
            wrong += ids[~(low > 0)].tolist()
    return {
        "sampled_at": "Gauss points, one more in each direction than the map has modes",
        "least": least if blocks else None,
        "greatest": greatest if blocks else None,
        "elements_not_positive": sorted(wrong),
    }


def _determinants(block: GeometryBlock, space: int) -> Iterator[tuple[Ints, Floats]]:
    """Ids (e,) and determinants (e, n) of some elements after another.

    Where the space has more dimensions than the elements, it is the factor of length or area, which is never negative.
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
    eta = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, expansion.shape.dimension)
    return uncollapse(expansion.shape, eta)


def _field(field: Field) -> Facts:
    """Size, orders and range of one field; elements with a coefficient that is not finite are counted apart."""
    found = field_range(field.blocks)
    return {
        "name": field.name,
        "elements": sum(len(block) for block in field.blocks),
        "expansions": [_expansion(block.expansion, len(block)) for block in _merge(field.blocks)],
        "continuous": field.continuous,
        "range": {name: _end(found, name) for name in ("lower", "upper", "least", "greatest")},
        "nan": sum(int(np.isnan(block.coefficients).sum()) for block in field.blocks),
        "infinite": sum(int(np.isinf(block.coefficients).sum()) for block in field.blocks),
        "elements_not_finite": sum(int((~finite_rows(block.coefficients)).sum()) for block in field.blocks),
    }


def _merge(blocks: Sequence[Block]) -> list[Block]:
    """The blocks in order, those of one expansion counted as one."""
    ids: dict[Expansion, list[Any]] = {}
    for block in blocks:
        ids.setdefault(block.expansion, []).append(block.element_ids)
    return [Block(expansion, np.concatenate(parts), np.empty((0, 0))) for expansion, parts in ids.items()]


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


def _composite(composite: Composite) -> Facts:
    parts = [{"tag": tag, "entities": len(ids)} for tag, ids in composite.parts]
    return {"id": composite.id, "name": composite.name, "label": composite.label, "parts": parts}


def _bytes(dataset: Dataset) -> int:
    """Memory that the arrays of the dataset take."""
    mesh = dataset.mesh
    arrays = [mesh.vertex_ids, mesh.vertices]
    arrays += [array for entities in mesh.entities.values() for array in (entities.ids, entities.members)]
    for curves in (mesh.edge_curves, mesh.face_curves):
        arrays += [curves.rows, curves.kinds, curves.offsets, curves.points]
    arrays += [ids for composite in mesh.composites for _, ids in composite.parts]
    blocks = [block for field in dataset.fields for block in field.blocks]
    return sum(array.nbytes for array in arrays) + sum(b.element_ids.nbytes + b.coefficients.nbytes for b in blocks)
