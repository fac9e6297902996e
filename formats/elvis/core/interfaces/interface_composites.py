"""The composites that hold inner sides of elements whose sides don't match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Ints, distinct_bits, frozen_ints, joined_ints
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import NON_CONFORMING, Composite, Mesh
from elvis.core.distances.boundaries import joined_sides, outer_sides, owners_of_sides, sides_by_name
from elvis.core.interfaces.hanging import OPEN, fluxes, hanging
from elvis.core.interfaces.side_groups import side_set
from elvis.core.shapes import Shape

#: tags of composites of sides, by the dimension of the elements
_TAGS = {2: "E", 3: "F"}


@dataclass(frozen=True, eq=False)
class Interfaces:
    """A dataset whose mesh distinguishes non-conforming inner sides from outer ones.

    dataset   the data, with a composite `NON_CONFORMING` if there are such sides
    warnings  messages about undecided sides, and about elements that overlap
    """

    dataset: Dataset
    warnings: tuple[str, ...] = ()


def with_interfaces(dataset: Dataset, outline: str | None, precision: float, known: Sequence[Ints] = ()) -> Interfaces:
    """The dataset with a composite of the inner sides that no other element shares.

    outline    name of the last composite where it holds all sides that the source doesn't name; inner ones leave it
    precision  relative rounding of the source's numbers
    known      rows of sides that the source itself calls non-conforming
    """
    mesh = dataset.mesh
    if mesh.dimension < 2:
        return Interfaces(dataset)
    ids = _side_ids(mesh)
    owners = owners_of_sides(mesh, [own.members for own in mesh.elements.values()])
    overlap = _overlap(mesh, owners)
    sides = side_set(dataset, owners == 1)
    # the search takes most memory
    del owners
    named = _named(mesh, ids, outline)
    is_oriented = mesh.space == mesh.dimension
    found = hanging(sides, named[sides.entity], is_oriented, precision)
    inner = np.unique(np.concatenate([found.inner, *known]).astype(np.int64))
    undecided = np.setdiff1d(found.undecided, inner)
    warnings = (*overlap, _warning(mesh, len(undecided), found.gap)) if len(undecided) else overlap
    if not len(inner):
        return Interfaces(dataset, warnings)
    return Interfaces(replace(dataset, mesh=_with_inner(mesh, ids[inner], outline)), warnings)


def has_closed_outline(dataset: Dataset) -> bool:
    """Whether the outer sides of a dataset with non-conforming elements are closed, so that no gap remains.

    The integral of the normal over a closed surface is zero (divergence theorem).
    """
    mesh = dataset.mesh
    if NON_CONFORMING not in joined_sides(mesh):
        return False
    owners = owners_of_sides(mesh, [own.members for own in mesh.elements.values()])
    outer = side_set(dataset, outer_sides(mesh, owners))
    area, flux = fluxes(outer, np.arange(len(outer)))
    return bool(np.abs(flux[:, :3].sum(axis=0)).max() <= OPEN * area.sum())


def _side_ids(mesh: Mesh) -> Ints:
    """(n,) ids of all sides by their rows."""
    shapes = (Shape.SEGMENT,) if mesh.dimension == 2 else (Shape.TRIANGLE, Shape.QUADRILATERAL)
    ids = [mesh.of(shape).ids for shape in shapes if len(mesh.of(shape))]
    return ids[0] if len(ids) == 1 else np.concatenate([np.empty(0, np.int32), *ids])


def _named(mesh: Mesh, ids: Ints, outline: str | None) -> Bools:
    """(n,) whether a boundary that the source names holds a side."""
    kept = mesh.composites[:-1] if outline is not None else mesh.composites
    names = sides_by_name(replace(mesh, composites=tuple(kept)))
    held = joined_ints(names.values())
    return np.isin(ids, held)


def _with_inner(mesh: Mesh, inner: Ints, outline: str | None) -> Mesh:
    """The mesh with a composite of the sides that have the ids ``inner``, which its outline then lacks."""
    composites = list(mesh.composites)
    if outline is not None:
        parts = tuple((tag, frozen_ints(own[~np.isin(own, inner)])) for tag, own in composites[-1].parts)
        last = replace(composites.pop(), parts=parts)
        composites += [last] if any(len(own) for _, own in parts) else []
    number = 1 + max((composite.id for composite in mesh.composites), default=-1)
    composites.append(Composite(number, ((_TAGS[mesh.dimension], frozen_ints(inner)),), NON_CONFORMING))
    return replace(mesh, composites=tuple(composites))


def _overlap(mesh: Mesh, owners: Ints) -> tuple[str, ...]:
    """A message if elements overlap; none in a surface, whose parts may meet at one edge.

    owners  (n,) number of elements at each side, at most two in a volume or a plane
    """
    if mesh.space > mesh.dimension:
        return ()
    copies = sum(len(own) - len(distinct_bits(np.sort(own.members, axis=1))[0]) for own in mesh.elements.values())
    crowded = int((owners > 2).sum())
    kind = "edges" if mesh.dimension == 2 else "faces"
    found = [f"{copies} elements have the corners of another one"] if copies else []
    found += [f"{crowded} {kind} belong to more than two elements"] if crowded else []
    if not found:
        return ()
    return (f"{' and '.join(found)}: integrals count such elements several times, and their {kind} as inner ones",)


def _warning(mesh: Mesh, count: int, gap: float) -> str:
    """A message about sides that could not be classified as inner ones."""
    kind = "edge" if mesh.dimension == 2 else "face"
    many = f"{count} {kind}{'s' if count > 1 else ''}"
    # if elements are tangled, distances are not determined
    distance = f", in part or within {gap:.2g}" if gap else ""
    return (
        f"{many} may lie on {kind}s of other elements{distance}: they count as outer boundary, so integrals over it, "
        "distances and streamlines may be wrong there"
    )
