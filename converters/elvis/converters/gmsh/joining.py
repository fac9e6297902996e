"""Several meshes of Gmsh as one: partitions in files of their own, or one mesh that several files hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.converters.gmsh.mesh import Group, Mesh
from elvis.core.base.arrays import Floats, Ints, distinct_bits
from elvis.core.base.errors import FormatError

#: nodes of one number that are as near as this, as a share of the largest coordinate, lie at one place
_NEAR = 1e-10


def joined(meshes: Sequence[Mesh], paths: Sequence[Path], has_element_data: bool) -> Mesh:
    """One mesh of all elements, each once.

    has_element_data  whether values refer to elements by number
    Raises FormatError if nodes of one number differ, or elements of one number that values refer to.
    """
    if len(meshes) == 1:
        return meshes[0]
    tags, places = _nodes(meshes, paths)
    groups = [group for mesh in meshes for group in _renumbered(mesh, tags)]
    copies, groups, is_ambiguous = _each_once(groups)
    if is_ambiguous and has_element_data:
        raise FormatError("expected parts of one mesh, found other elements of equal numbers", file=paths[1])
    if is_ambiguous:  # files of version 2 may renumber the elements of each partition
        groups = _numbered_anew(groups)
    stated = [mesh.declared for mesh in meshes]
    counts = [count for count in stated if count is not None]
    sides: dict[str, list[Ints]] = {}
    for mesh in meshes:
        for name, own in mesh.sides.items():
            sides.setdefault(name, []).extend(own)
    return Mesh(
        tags,
        places,
        groups,
        sides,
        np.unique(np.concatenate([mesh.others for mesh in meshes])),
        list(dict.fromkeys(note for mesh in meshes for note in mesh.notes)),
        sum(counts) - copies if len(counts) == len(meshes) else None,
        sorted({number for mesh in meshes for number in mesh.partitions}),
        max(mesh.partition_count for mesh in meshes),
    )


def _nodes(meshes: Sequence[Mesh], paths: Sequence[Path]) -> tuple[Ints, Floats]:
    """Numbers (n,), ascending, and places (n, 3) of the nodes of all meshes."""
    every, where = (np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in ("tags", "places"))
    tags, first, which = np.unique(every, return_index=True, return_inverse=True)
    off = np.abs(where - where[first][which.reshape(-1)]).max(axis=1, initial=0)
    if off.max(initial=0) > _NEAR * np.abs(where).max(initial=0):
        found = f"node {every[off.argmax()]} at others"
        raise FormatError(f"expected parts of one mesh with one position for each node, found {found}", file=paths[1])
    return tags, where[first]


def _renumbered(mesh: Mesh, tags: Ints) -> list[Group]:
    """The groups of a mesh with nodes among all."""
    rows = np.searchsorted(tags, mesh.tags)
    return [replace(group, nodes=rows[group.nodes]) for group in mesh.groups]


def _each_once(groups: Sequence[Group]) -> tuple[int, list[Group], bool]:
    """The groups without repeated elements, identified by their nodes; one group for each kind and its regions.

    Returns the number of repeated elements, the groups, and whether the relation of elements to numbers is ambiguous.
    """
    by_kind: dict[tuple[str, ...], list[Group]] = {}
    for group in groups:
        by_kind.setdefault((group.kind.name, *group.regions), []).append(group)
    copies, result, is_ambiguous = 0, [], False
    for own in by_kind.values():
        tags, nodes = np.concatenate([each.tags for each in own]), np.concatenate([each.nodes for each in own])
        first, which = distinct_bits(np.sort(nodes, axis=1))
        is_ambiguous |= bool((tags[first][which] != tags).any())
        copies += len(tags) - len(first)
        kept = np.sort(first)
        result.append(replace(own[0], tags=tags[kept], nodes=nodes[kept]))
    every = np.concatenate([group.tags for group in result])
    return copies, result, is_ambiguous or len(np.unique(every)) < len(every)


def _numbered_anew(groups: Sequence[Group]) -> list[Group]:
    """The groups with elements numbered from 1."""
    ends = np.cumsum([len(group.tags) for group in groups])
    return [
        replace(group, tags=end - len(group.tags) + 1 + np.arange(len(group.tags)))
        for group, end in zip(groups, ends, strict=True)
    ]
