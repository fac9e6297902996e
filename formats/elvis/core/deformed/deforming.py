"""Deformed geometry: replaces the map x by x + S d(x), for polynomial displacements d.

On an element with a map of degree p and a displacement of degree q, both in reference coordinates, x + S d(x) is a
polynomial map of degree max(p, q).  The dataset stores it as fields (``GeometryMap``), so all commands use it
as the map.  Fields keep their coefficients, and so stay with their material points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints, joined_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import MAP_FIELDS, MAP_KEY, Block, Dataset, Deformed, Expansion, Field
from elvis.core.deformed.deformation import GRADIENTS
from elvis.core.deformed.separated_sides import with_separated_sides
from elvis.core.mapping.geometry import GeometryBlock, geometry, is_shared, share
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.grouping import grouped
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.tree import AXES
from elvis.core.resolution.stored_precision import JUMPS, SINGLE, are_single
from elvis.core.shapes import Shape

#: names of the fields that hold the coordinates before the deformation
UNDEFORMED = tuple(f"undeformed_{axis}" for axis in AXES)
#: what is left of values beyond a space, as a share of the largest, that is rounding
ROUNDING = 1e-12
#: numbers in the values that are fitted at once
_NUMBERS = 1 << 22
#: bases of polynomials on pyramids, by the direction
_ORTHO_PYRAMID = (Basis.ORTHO_A, Basis.ORTHO_A, Basis.ORTHO_PYR_C)


def deformed(
    dataset: Dataset, displacement: Sequence[Field], scale: float = 1.0, gradients: str = GRADIENTS[0]
) -> Dataset:
    """The dataset on the geometry x + scale · d(x).

    Parameters
    ----------
    dataset : Dataset
        Its map may be curved, or given by fields.
    displacement : sequence of Field
        The components of d, one for each coordinate, on elements of the dataset.
    scale : float
        Factor of the displacement.
    gradients : str
        Where derivatives of quantities are taken: ``undeformed`` or ``deformed``.

    Returns
    -------
    Dataset
        The same fields with the same coefficients.  Elements on which a component has no values stay where they are.

    Raises
    ------
    ElvisError
        For another number of components than of coordinates, Fourier directions, values that are not finite, and
        pyramids on which no space holds the sum.
    """
    check_displacement(dataset, displacement)
    dataset = undeformed(dataset)
    before = geometry(dataset)
    names = _free(dataset, UNDEFORMED)[: dataset.mesh.space]
    blocks = [own.at(scale) for own in moving_maps(before, displacement)]
    map_names = _free(dataset, MAP_FIELDS)[: dataset.mesh.space]
    maps = [_field(name, axis, blocks) for axis, name in enumerate(map_names)]
    places = [_field(name, axis, before) for axis, name in enumerate(names)]
    kept = [field for field in dataset.fields if field.name not in dataset.map_names]
    found = replace(
        dataset,
        fields=(*kept, *maps, *places),
        metadata={**dataset.metadata, MAP_KEY: ",".join(map_names)},
        deformation=Deformed(tuple(own.name for own in displacement), scale, gradients, names),
    )
    may_jump = any(own.continuous is not True for own in displacement)
    return _separated(dataset, found, displacement) if may_jump else found


def _separated(before: Dataset, after: Dataset, displacement: Sequence[Field]) -> Dataset:
    """Deformed data whose elements no longer share the sides at which the displacement jumps."""
    known = after.deformation
    assert known is not None
    moves = [block.coefficients for own in displacement for block in own.blocks]
    largest = max((float(np.abs(own).max(initial=0.0)) for own in moves), default=0.0)
    stored = [block for own in before.solution for block in own.blocks]
    is_single = all(are_single(block.expansion, block.coefficients) for block in stored)
    rounding = JUMPS * SINGLE * abs(known.scale) * largest if is_single else 0.0
    mesh = with_separated_sides(before, after, rounding)
    if mesh is after.mesh:
        return after
    if is_shared(after.mesh):
        share(mesh)
    return replace(after, mesh=mesh, deformation=replace(known, joined=after.mesh))


def raised(dataset: Dataset, height: Field, scale: float = 1.0, gradients: str = GRADIENTS[0]) -> Dataset:
    """2D data on the surface z = scale · u(x, y); ``height`` is u.

    Raises ElvisError as `deformed`, and for data that are not in a plane.
    """
    dataset = undeformed(dataset)
    if (dataset.mesh.dimension, dataset.mesh.space) != (2, 2):
        kind = f"{dataset.mesh.dimension}D elements in a space of {dataset.mesh.space}"
        raise ElvisError(f"--height: expected 2D data in a plane, found {kind}")
    rest = [replace(own, coefficients=frozen_floats(np.zeros_like(own.coefficients))) for own in height.blocks]
    zero = replace(height, name="0", blocks=tuple(rest))
    # in a plane a third coordinate of vertices has no meaning: maps of two coordinates leave it out
    names = _free(dataset, MAP_FIELDS)[:2]
    maps = [_field(name, axis, geometry(dataset)) for axis, name in enumerate(names)]
    kept = [field for field in dataset.fields if field.name not in dataset.map_names]
    metadata = {**dataset.metadata, MAP_KEY: ",".join(names)}
    in_space = replace(dataset, mesh=replace(dataset.mesh, space=3), fields=(*kept, *maps), metadata=metadata)
    found = deformed(in_space, (zero, zero, height), scale, gradients)
    known = found.deformation
    assert known is not None
    # of the surface the places before are those in the plane
    fields = tuple(own for own in found.fields if own.name != known.coordinates[2])
    deformation = replace(known, displacement=(height.name,), coordinates=known.coordinates[:2], is_height=True)
    return replace(found, fields=fields, deformation=deformation)


def undeformed(dataset: Dataset) -> Dataset:
    """The dataset on the geometry that it had before it was deformed."""
    known = dataset.deformation
    if known is None:
        return dataset
    mesh = known.joined or dataset.mesh
    mesh = replace(mesh, space=2) if known.is_height else mesh
    names = dataset.map_names[: mesh.space]
    # the fields of the map change places with those of the coordinates before
    places = [replace(dataset.field(own), name=name) for own, name in zip(known.coordinates, names, strict=True)]
    kept = [field for field in dataset.fields if field.name not in (*dataset.map_names, *known.coordinates)]
    metadata = {**dataset.metadata, MAP_KEY: ",".join(names)}
    remarks = tuple(remark for remark in dataset.remarks if remark not in known.told)
    return replace(dataset, mesh=mesh, fields=(*kept, *places), metadata=metadata, remarks=remarks, deformation=None)


def check_displacement(dataset: Dataset, displacement: Sequence[Field]) -> None:
    """Raise ElvisError for a displacement that is not one of this dataset."""
    space = dataset.mesh.space
    if len(displacement) != space:
        coordinates = ", ".join(AXES[:space])
        found = f"{len(displacement)}: {', '.join(own.name for own in displacement)}"
        raise ElvisError(f"expected a displacement of {space} components, for {coordinates}, found {found}")
    for own in displacement:
        for block in own.blocks:
            if block.expansion.homogeneous:
                raise ElvisError(f"expected a displacement without Fourier directions, found {own.name}")
            if not np.isfinite(block.coefficients).all():
                raise ElvisError(f"expected a displacement with finite values, found others in {own.name}")


def _free(dataset: Dataset, names: Sequence[str]) -> tuple[str, ...]:
    """The names, or longer ones if fields already have them; names of map fields may be reused."""
    return free_names(names, {field.name for field in dataset.fields} - set(dataset.map_names))


def free_names(names: Sequence[str], taken: set[str]) -> tuple[str, ...]:
    """The names, or longer ones if some of them are taken."""
    while taken.intersection(names):
        names = [f"{name}_" for name in names]
    return tuple(names)


def _field(name: str, axis: int, blocks: Sequence[GeometryBlock]) -> Field:
    """A coordinate of maps as a field."""
    parts = [Block(own.expansion, own.element_ids, frozen_floats(own.coefficients[:, axis])) for own in blocks]
    return Field(name, tuple(parts), None)


@dataclass(frozen=True, eq=False)
class MovingMaps:
    """The maps x + S d of elements, for every factor S.

    places, moves  (n, 3, m) coefficients of x and of d, in one expansion
    """

    expansion: Expansion
    element_ids: Ints
    places: Floats
    moves: Floats

    def at(self, scale: float) -> GeometryBlock:
        """The maps for one factor."""
        return GeometryBlock(self.expansion, self.element_ids, frozen_floats(self.places + scale * self.moves))


def moving_maps(before: Sequence[GeometryBlock], displacement: Sequence[Field]) -> Iterator[MovingMaps]:
    """The maps of all elements and what moves them, zero on elements on which a component has no values.

    Raises ElvisError if a field has another shape than the mesh, or no space holds x and d.
    """
    sources = [own.blocks for own in displacement]
    ids = joined_ints(block.element_ids for block in before)
    if not len(ids):
        return
    for group in grouped(ids, [before, *sources]):
        (expansion, *spaces), (maps, *components) = group.expansions, group.coefficients
        assert expansion is not None
        assert maps is not None
        known = [(own, values) for own, values in zip(spaces, components, strict=True) if own is not None]
        if len(known) < len(spaces):
            places = frozen_floats(maps)
            yield MovingMaps(expansion, frozen_ints(group.element_ids), places, frozen_floats(np.zeros_like(places)))
            continue
        for own, (space, _) in zip(displacement, known, strict=True):
            if space.shape is not expansion.shape:
                raise ElvisError(f"expected {own.name} on a {expansion.shape.label.lower()}, as in the mesh")
        yield from _in_one_space(group.element_ids, expansion, maps, known)


def _in_one_space(
    ids: Ints, expansion: Expansion, maps: Floats, parts: Sequence[tuple[Expansion, Floats | None]]
) -> Iterator[MovingMaps]:
    """Maps and displacements of elements with the same expansions, some elements after another."""
    candidates = _candidates([expansion, *(own for own, _ in parts)])
    step = max(1, _NUMBERS // (3 * mode_count(candidates[-1])))
    for first in range(0, len(ids), step):
        rows = slice(first, first + step)
        of_maps = [(expansion, maps[rows, axis]) for axis in range(3)]
        of_moves = [(own, values[rows]) for own, values in parts if values is not None]
        for target in candidates:
            places, moves = _fitted(target, of_maps), _fitted(target, of_moves)
            if places is not None and moves is not None:
                yield MovingMaps(target, frozen_ints(ids[rows]), places, moves)
                break
        else:
            shape = expansion.shape.label.lower()
            raise ElvisError(f"expected a polynomial displacement, found other functions on a {shape}")


def _candidates(spaces: Sequence[Expansion]) -> list[Expansion]:
    """Expansions that may hold sums of functions of several, smaller ones first.

    The first one always works except on pyramids, because larger expansions contain smaller ones.  Pyramids have two
    families.  Modified functions with 2 n - 1 modes hold orthogonal ones, all polynomials of degree n - 1.
    """
    shape = spaces[0].shape
    # a space of one mode, such as that of a constant, is held by linear functions
    modes = np.maximum(np.max([own.modes for own in spaces], axis=0), 2)
    first = modified(shape, tuple(modes.tolist()))
    if shape is not Shape.PYRAMID:
        return [first]
    most = int(modes.max())
    return [
        modified(shape, (most,) * 3),
        Expansion(shape, _ORTHO_PYRAMID, (most,) * 3),
        modified(shape, (2 * most - 1,) * 3),
    ]


def _fitted(target: Expansion, parts: Sequence[tuple[Expansion, Floats]]) -> Floats | None:
    """(n, 3, m) coefficients in an expansion of up to three components; None if it doesn't hold all of them."""
    table, inverse, points = _projection(target)
    values_there = np.zeros((len(parts[0][1]), 3, len(points)))
    for axis, (own, coefficients) in enumerate(parts):
        values_there[:, axis] = evaluate(own, coefficients, points)
    found = values_there @ inverse
    # one step of refinement takes the rounding of the inverse away
    found += (values_there - found @ table) @ inverse
    left = np.abs(values_there - found @ table).max(initial=0.0)
    return frozen_floats(found) if left <= ROUNDING * np.abs(values_there).max(initial=0.0) else None


@bounded_cache
def _projection(expansion: Expansion) -> tuple[Floats, Floats, Floats]:
    """(m, k) values of modes at points, (k, m) coefficients by least squares from values there, and the points.

    The points (k, d) are Gauss points in collapsed coordinates.  They outnumber the modes, so functions outside the
    space leave a residual.  Modes are scaled to one size, as inner ones of high order are small.
    """
    shape = expansion.shape
    lines = np.meshgrid(*[gauss(max(expansion.modes) + 1)[0]] * shape.dimension, indexing="ij")
    points = frozen_floats(uncollapse(shape, np.stack([line.reshape(-1) for line in lines], axis=1)))
    table = values(expansion, points)
    sizes = np.linalg.norm(table, axis=0)
    inverse = np.linalg.pinv(table / sizes) / sizes[:, None]
    return frozen_floats(table.T), frozen_floats(inverse.T), points
