"""Several meshes of Gmsh as one: partitions in files of their own, or one mesh that several files hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.converters.gmsh_mesh import Group, Mesh
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError

#: nodes of one number that are as near as this, as a share of the largest coordinate, lie at one place
_NEAR = 1e-10


def joined(meshes: Sequence[Mesh], paths: Sequence[Path]) -> Mesh:
    """One mesh of all elements, each once; FormatError if nodes or elements of one number differ."""
    if len(meshes) == 1:
        return meshes[0]
    tags, places = _nodes(meshes, paths)
    groups = [group for mesh in meshes for group in _renumbered(mesh, tags)]
    copies, groups = _each_once(groups, paths)
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
        raise FormatError(
            f"expected parts of one mesh, whose nodes lie at one place each, found {found}", file=paths[1]
        )
    return tags, where[first]


def _renumbered(mesh: Mesh, tags: Ints) -> list[Group]:
    """The groups of a mesh with nodes among all."""
    rows = np.searchsorted(tags, mesh.tags)
    return [replace(group, nodes=rows[group.nodes]) for group in mesh.groups]


def _each_once(groups: Sequence[Group], paths: Sequence[Path]) -> tuple[int, list[Group]]:
    """How many elements come again, and the groups without these, one for each kind and its regions."""
    by_kind: dict[tuple[str, ...], list[Group]] = {}
    for group in groups:
        by_kind.setdefault((group.kind.name, *group.regions), []).append(group)
    copies, result = 0, []
    for own in by_kind.values():
        tags, nodes = np.concatenate([each.tags for each in own]), np.concatenate([each.nodes for each in own])
        distinct, first, which = np.unique(tags, return_index=True, return_inverse=True)
        if not np.array_equal(nodes[first][which.reshape(-1)], nodes):
            raise FormatError("expected parts of one mesh, found other elements of equal numbers", file=paths[1])
        copies += len(tags) - len(distinct)
        kept = np.sort(first)
        result.append(replace(own[0], tags=tags[kept], nodes=nodes[kept]))
    return copies, result
