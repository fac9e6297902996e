"""The runtime plugin for NURBS volumes: MFEM's NURBS meshes with grid functions on them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints, starts_of
from elvis.core.base.errors import FormatError
from elvis.core.polynomials.quadrature import gauss, gll
from elvis.core.shapes import Shape
from elvis.plugins.faces import Faces, Hexahedra, hexahedron_faces
from elvis.plugins.nurbs.bezier import along, evaluated, from_nodes, scaled_coefficients
from elvis.plugins.nurbs.inversion import Solver
from elvis.plugins.nurbs.knots import HIGHEST
from elvis.plugins.nurbs.mesh import (
    FUNCTION,
    MESH,
    GridFunction,
    PatchMesh,
    fills_space,
    first_line,
    read_function,
    read_mesh,
)
from elvis.plugins.nurbs.node_numbers import CORNERS, numbered
from elvis.plugins.nurbs.own import OwnMesh, is_own, read_own
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import Part, PartsVolume, basis_part, boxes_between

Mesh: TypeAlias = PatchMesh | OwnMesh
#: degrees of map and field, nets of both, and numbers of some elements
Group: TypeAlias = tuple[list[int], Floats, Floats, Ints]

_COLLECTION = re.compile(r"(H1|H1Pos|L2|L2_T1|L2_T2)_3D_P(\d+)")

#: nodes in [0, 1] of a family of elements, None if it has Bernstein coefficients
_NODES: dict[str, Callable[[int], Floats] | None] = {
    "H1": lambda p: (gll(p + 1)[0] + 1) / 2,
    "H1Pos": None,
    "L2": lambda p: (gauss(p + 1)[0] + 1) / 2,
    "L2_T1": lambda p: (gll(p + 1)[0] + 1) / 2,
    "L2_T2": None,
}


class Nurbs(VolumeSource):
    """A mesh and any number of grid functions; a function's name is the last word of its file's name before .gf.

    Elements are the knot spans in MFEM's order, with reference coordinates in [0, 1]^3.
    """

    format = "NURBS volumes: MFEM's meshes with .gf grid functions, or JSON"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """One 3D NURBS mesh of MFEM and grid functions; or one file of our own form (`elvis.plugins.nurbs.own`).

        The converter of MFEM reads lines, surfaces and meshes without functions.
        """
        if len(paths) == 1 and is_own(Path(paths[0])):
            return True
        kinds = {Path(path): first_line(Path(path)) for path in paths}
        meshes = [path for path, kind in kinds.items() if kind == MESH]
        functions = [path for path, kind in kinds.items() if kind == FUNCTION]
        if len(meshes) != 1 or not functions or len(kinds) != 1 + len(functions):
            return False
        return fills_space(meshes[0])

    def __init__(self, paths: Sequence[Path]) -> None:
        """Open the files."""
        files = [Path(path) for path in paths]
        self._functions: dict[str, tuple[Path, GridFunction, int]] = {}
        if is_own(files[0]):
            self.mesh: Mesh = read_own(files[0])
            self.time, self.fields = self.mesh.time, tuple(self.mesh.fields)
            return
        mesh = next((path for path in files if first_line(path) == MESH), files[0])
        self.mesh = read_mesh(mesh)
        for path in files:
            if path != mesh:
                self._add(path, read_function(path))
        self.fields = tuple(self._functions)

    def _add(self, path: Path, function: GridFunction) -> None:
        """A function's components become fields."""
        name = path.stem.split(".")[-1]
        count = function.values.shape[1]
        for number in range(count):
            own = name if count == 1 else f"{name}_{'xyz'[number] if count <= 3 else number}"
            if own in self._functions:
                raise FormatError(f"expected one field {own!r}, found another in {self._functions[own][0]}", file=path)
            self._functions[own] = path, function, number

    def volume(self, field: str) -> PartsVolume:
        """The elements with one field; elements of equal degrees form a part."""
        nets, is_rational = self._nets(field)
        groups = _groups(weighted(self.mesh), nets)
        parts = [_part(*group, is_rational) for group in groups]
        return PartsVolume(parts, Path(__file__).parent, faces=lambda: _faces(self.mesh, groups))

    def _nets(self, field: str) -> tuple[list[Floats], bool]:
        """For each patch the nets of a field, and whether they have weights."""
        if isinstance(self.mesh, OwnMesh):
            return _rational(self.mesh, self.mesh.fields[field]), True
        path, function, component = self._functions[field]
        values, collection = function.values[:, component], function.collection
        try:
            if collection.startswith("NURBS"):
                return _rational(self.mesh, values), True
            return _polynomial(self.mesh, collection, values), False
        except FormatError as error:
            raise error.within(file=path, place=FUNCTION) from error


def weighted(mesh: Mesh) -> list[Floats]:
    """For each patch the nets (elements, n_x, n_y, n_z, 4) of w x, w y, w z, w."""
    homogeneous = np.column_stack([mesh.points * mesh.weights[:, None], mesh.weights])
    return [_spans(mesh, patch, homogeneous[grid]) for patch, grid in enumerate(mesh.controls())]


def _rational(mesh: Mesh, values: Floats) -> list[Floats]:
    """For each patch the nets (elements, n_x, n_y, n_z) of w c."""
    if len(values) != len(mesh.weights):
        raise FormatError(f"expected {len(mesh.weights)} values, found {len(values)}")
    scaled = values * mesh.weights
    return [_spans(mesh, patch, scaled[grid]) for patch, grid in enumerate(mesh.controls())]


def _spans(mesh: Mesh, patch: int, controls: Floats) -> Floats:
    """Nets of the spans of one patch, x fastest, from control values (n_x, n_y, n_z, …)."""
    x, y, z = (vector.pieces() for vector in mesh.knots[patch])
    return np.array([along((a, b, c), controls) for c, b, a in product(z, y, x)])


def _polynomial(mesh: PatchMesh, collection: str, values: Floats) -> list[Floats]:
    """For each patch the nets (elements, p + 1, p + 1, p + 1) of an H1 or L2 function."""
    found = _COLLECTION.fullmatch(collection)
    if not found or not int(found[2]) <= HIGHEST:
        known = f"H1, H1Pos, L2, L2_T1 or L2_T2 in 3D up to P{HIGHEST}, or {mesh.collection}"
        raise FormatError(f"expected a function of {known}, found {collection}")
    family, order, elements = found[1], int(found[2]), mesh.elements()
    if family.startswith("H1"):
        grids, total = numbered(elements, [(order + 1,) * 3] * len(elements))
        numbers = np.array(grids)
    else:
        total = len(elements) * (order + 1) ** 3
        numbers = np.arange(total).reshape(len(elements), *(order + 1,) * 3).transpose(0, 3, 2, 1)
    if len(values) != total:
        raise FormatError(f"expected {total} values of {collection}, found {len(values)}")
    nets = values[numbers]
    if (nodes := _NODES[family]) is not None:
        nets = np.array([along((from_nodes(nodes(order)),) * 3, net) for net in nets])
    return np.split(nets, np.cumsum(_counts(mesh))[:-1])


def _counts(mesh: PatchMesh) -> list[int]:
    """Elements of each patch."""
    return [int(np.prod([len(vector.spans) for vector in own])) for own in mesh.knots]


def _groups(maps: list[Floats], fields: list[Floats]) -> list[Group]:
    """Elements of all patches with equal degrees: these, nets of maps and fields, and numbers."""
    first = starts_of(maps)
    alike: dict[tuple[int, ...], list[int]] = {}
    for patch, (geometry, field) in enumerate(zip(maps, fields, strict=True)):
        alike.setdefault((*geometry.shape[1:4], *field.shape[1:4]), []).append(patch)
    groups = []
    for shape, patches in alike.items():
        ids = np.concatenate([np.arange(first[patch], first[patch + 1]) for patch in patches])
        geometry, field = (np.concatenate([nets[patch] for patch in patches]) for nets in (maps, fields))
        groups.append(([size - 1 for size in shape], geometry, field, ids))
    return groups


def _faces(mesh: Mesh, groups: list[Group]) -> Faces:
    """The faces of all elements; faces with the same vertices are one.  Boundaries are named by their attributes."""
    corners = np.empty((sum(len(ids) for *_, ids in groups), 8, 3))
    for _, nets, _, ids in groups:
        x, y, z = (CORNERS * (np.array(nets.shape[1:4]) - 1)).T
        corners[ids] = nets[:, x, y, z, :3] / nets[:, x, y, z, 3:]
    vertices = mesh.elements(corners)
    parts = [Hexahedra(vertices[ids], max(degrees[:3]), _images(nets), unit=True) for degrees, nets, _, ids in groups]
    blocks = hexahedron_faces(parts)
    entity = np.empty((len(vertices), 6), np.int64)
    for block, (*_, ids) in zip(blocks, groups, strict=True):
        entity[ids[block.element], block.local] = block.entity
    named = {
        name: np.concatenate([entity[elements, face] for elements, face in sides])
        for name, sides in mesh.sides().items()
    }
    return Faces(blocks, [ids for *_, ids in groups], named)


def _images(nets: Floats) -> Callable[[Ints, Floats], Floats]:
    """The rational maps of elements with these nets."""

    def images(elements: Ints, points: Floats) -> Floats:
        each = [evaluated(nets[elements], np.tile(point, (len(elements), 1))) for point in points]
        return np.stack(each, axis=1)

    return images


def _part(degrees: list[int], geometry: Floats, field: Floats, ids: Ints, is_rational: bool) -> Part:
    """Elements in the hull of their control points, since all weights are positive."""

    def evaluate(elements: Ints, points: Floats) -> tuple[Floats, Floats]:
        homogeneous, values = evaluated(geometry[elements], points), evaluated(field[elements], points)
        weights = homogeneous[:, 3]
        return homogeneous[:, :3] / weights[:, None], values / weights if is_rational else values

    points = (geometry[..., :3] / geometry[..., 3:]).reshape(len(geometry), -1, 3)
    solver = Solver(geometry, lambda elements, points: evaluate(elements, points)[1])
    return basis_part(
        "rational",
        f"Rational<{', '.join(map(str, degrees))}, {int(is_rational)}>",
        boxes_between(points.min(axis=1), points.max(axis=1)),
        {"controls": scaled_coefficients(geometry), "coefficients": scaled_coefficients(field)},
        ids,
        evaluate,
        solve=solver,
        bends=solver.bends,
        shape=Shape.HEXAHEDRON,
        unit=True,
        bounds=lambda: _bounds(field / geometry[..., 3] if is_rational else field),
    )


def _bounds(nets: Floats) -> tuple[Floats, Floats]:
    """(n,) minimum and maximum control value of each element, a little apart for rounding: weights are positive."""
    low, high = nets.min(axis=(1, 2, 3)), nets.max(axis=(1, 2, 3))
    rounding = 1e-13 * np.maximum(np.abs(low), np.abs(high))
    return low - rounding, high + rounding
