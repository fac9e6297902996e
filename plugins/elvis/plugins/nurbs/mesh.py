"""Files of NURBS meshes and grid functions as MFEM writes them (``MFEM NURBS mesh v1.0``, ``FiniteElementSpace``)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content, leading
from elvis.core.shapes import Shape
from elvis.plugins.nurbs.knots import HIGHEST, KnotVector
from elvis.plugins.nurbs.node_numbers import EDGES, numbered

MESH, FUNCTION = "MFEM NURBS mesh v1.0", "FiniteElementSpace"
_CUBE = 5
#: headings of the control points of patches, and parts of the largest by which equal ones may differ
_CONTROLS, _EQUAL = ("controlpoints", "controlpoints_homogeneous", "controlpoints_cartesian"), 1e-12
#: axis of an array (n_z, n_y, n_x) of elements, and which end of it, where each face of a hexahedron lies
_AXES = ((0, 0), (1, 0), (2, -1), (1, -1), (2, 0), (0, -1))


@dataclass(frozen=True, eq=False)
class GridFunction:
    """Values of a finite element space: collection (``H1_3D_P3``), and values (n, components)."""

    collection: str
    values: Floats


@dataclass(frozen=True, eq=False)
class PatchMesh:
    """Hexahedral patches.

    vertices    (n, 8) of each patch
    knots       knot vectors of each patch in its three directions
    edges       (m, 2) vertices, in the order of the file
    weights     (k,) of the control points
    points      (k, 3) control points
    collection  name of the space of the control points, as ``NURBS2``
    boundary    (b, 5) attribute and vertices of the patches' faces that bound the domain
    """

    vertices: Ints
    knots: list[tuple[KnotVector, KnotVector, KnotVector]]
    edges: Ints
    weights: Floats
    points: Floats
    collection: str
    boundary: Ints

    def controls(self) -> list[Ints]:
        """For each patch the numbers (n_x, n_y, n_z) of its control points."""
        return numbered(self.vertices, [[k.count for k in own] for own in self.knots], self.edges.tolist())[0]

    def sides(self) -> dict[str, list[tuple[Ints, int]]]:
        """For each attribute of the boundary numbers (n,) of elements, and which of their faces lie on it.

        Faces are numbered as in `elvis.core.shapes`.
        """
        found: dict[str, list[tuple[Ints, int]]] = {}
        for attribute, *corners in self.boundary.tolist():
            for patch, own in enumerate(self.vertices):
                for face, local in enumerate(Shape.HEXAHEDRON.faces):
                    if set(own[[*local]].tolist()) == set(corners):
                        found.setdefault(str(attribute), []).append(side_elements(self.knots, patch, face))
        return found

    def elements(self, corners: Floats | None = None) -> Ints:
        """(e, 8) vertices of the elements: the knot spans of all patches, x fastest, patch by patch."""
        counts = [[len(k.spans) + 1 for k in own] for own in self.knots]
        grids, _ = numbered(self.vertices, counts, self.edges.tolist())
        return np.concatenate([_cells(grid) for grid in grids])


def side_elements(knots: Sequence[Sequence[KnotVector]], patch: int, face: int) -> tuple[Ints, int]:
    """Numbers (n,) of the elements on one face of a patch, and that face."""
    counts = [[len(vector.spans) for vector in own] for own in knots]
    first = np.cumsum([0, *map(np.prod, counts)])
    numbers = np.arange(first[patch], first[patch + 1]).reshape(counts[patch][::-1])
    axis, end = _AXES[face]
    return np.take(numbers, end, axis=axis).reshape(-1), face


def _cells(grid: Ints) -> Ints:
    """(n, 8) corners of the cells of a grid of vertices, x fastest."""
    low, high = slice(None, -1), slice(1, None)
    around = [(low, low), (high, low), (high, high), (low, high)]
    corners = [grid[x, y, z] for z in (low, high) for x, y in around]
    return np.stack([corner.transpose(2, 1, 0).reshape(-1) for corner in corners], axis=1)


def first_line(path: Path) -> str:
    """The first line that holds something; nothing for what isn't text."""
    start = leading(path, 4096)
    lines = (line.strip() for line in start.decode("ascii", errors="replace").splitlines())
    return next((line for line in lines if line and not line.startswith("#")), "")


def fills_space(path: Path) -> bool:
    """Whether a mesh says that its patches are three-dimensional."""
    found = re.search(rb"(?m)^\s*dimension\s+(\d)", leading(path, 1 << 16))
    return found is not None and found[1] == b"3"


def read_mesh(path: Path) -> PatchMesh:
    """The patches of a file.  FormatError where it isn't a 3D mesh of hexahedral NURBS patches."""
    sections = Sections(path)
    if MESH not in sections.names:
        raise FormatError(f"expected the line {MESH!r}, found none", file=path)
    for dimension in sections.numbers("dimension", 1)[:, 0]:
        if dimension != 3:
            raise sections.error("dimension", f"expected 3, found {dimension:g}")
    vertices = sections.cubes("elements")
    edges = sections.counted_rows("edges", 3).astype(np.int64)
    boundary = sections.counted_rows("boundary", 6).astype(np.int64)[:, [0, 2, 3, 4, 5]]
    if "patches" in sections.names:
        knots, weights, points, collection = *_own_controls(sections, vertices, edges[:, 1:]), "NURBS"
    else:
        knots = _patch_knots(sections, vertices, edges, _vectors(sections))
        weights, function = sections.numbers("weights", 1)[:, 0], _function(sections)
        points, collection = function.values, function.collection

    # all must speak of the same control points
    count = numbered(vertices, [[vector.count for vector in own] for own in knots], edges[:, 1:].tolist())[1]
    for name, found in (("weights", weights.shape), (FUNCTION, points.shape)):
        wanted = (count,) if name == "weights" else (count, 3)
        if found != wanted:
            raise sections.error(name, f"expected an array {wanted}, found {found}")
    if not (weights > 0).all():
        raise sections.error("weights", f"expected positive weights, found {weights.min():g}")
    return PatchMesh(vertices, knots, edges[:, 1:], weights, points, collection, boundary)


def _own_controls(
    sections: Sections, vertices: Ints, edges: Ints
) -> tuple[list[tuple[KnotVector, KnotVector, KnotVector]], Floats, Floats]:
    """Knot vectors, weights (k,) and control points (k, 3) of a mesh whose patches bring their own.

    Control points come with x fastest, cartesian ones as x, y, z, w, others as w x, w y, w z, w; patches
    that meet have equal ones.
    """
    vectors = [_vector(sections, line) for line in sections.rows("knotvectors") if len(line) > 1]
    if len(vectors) != 3 * len(vertices):
        raise sections.error("knotvectors", f"expected three of {len(vertices)} patches, found {len(vectors)}")
    knots = [(vectors[3 * k], vectors[3 * k + 1], vectors[3 * k + 2]) for k in range(len(vertices))]
    names = [name for name in _CONTROLS if name in sections.names]
    if len(names) != 1:
        raise sections.error("patches", f"expected one of {', '.join(_CONTROLS)}, found {', '.join(names) or 'none'}")
    table = sections.numbers(names[0], 4)
    grids, count = numbered(vertices, [[vector.count for vector in own] for own in knots], edges.tolist())
    numbers = np.concatenate([grid.transpose().reshape(-1) for grid in grids])
    if len(table) != len(numbers):
        raise sections.error(names[0], f"expected {len(numbers)} control points, found {len(table)}")
    controls = np.empty((count, 4))
    controls[numbers] = table
    off = np.abs(controls[numbers] - table).max(axis=1, initial=0.0)
    if (off > _EQUAL * np.abs(table).max(initial=1.0)).any():
        where = int(off.argmax())
        raise sections.error(
            names[0], f"expected equal control points on shared sides of patches, found {table[where]}"
        )
    weights = controls[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        points = controls[:, :3] if names[0].endswith("cartesian") else controls[:, :3] / weights[:, None]
    return knots, weights, points


def read_function(path: Path) -> GridFunction:
    """The collection and values (n, components) of a grid function."""
    return _function(Sections(path))


def _function(sections: Sections) -> GridFunction:
    """Values in either ordering: 0 component by component, 1 node by node."""
    words = sections.words
    values = sections.numbers("Ordering", 1)[:, 0]
    try:
        components, ordering = int(words["VDim"]), int(words["Ordering"])
        shape = (-1, components) if ordering else (components, -1)
        table = values.reshape(shape) if ordering else values.reshape(shape).T
        return GridFunction(words["FiniteElementCollection"], table)
    except (KeyError, ValueError) as error:
        wanted = "FiniteElementCollection, VDim, Ordering and the matching number of values"
        raise sections.error(FUNCTION, f"expected {wanted}, found others ({error})") from error


def _vectors(sections: Sections) -> list[KnotVector]:
    """The knot vectors: each line has the degree, the number of control points, and the knots."""
    return [_vector(sections, line) for line in sections.rows("knotvectors")[1:]]


def _vector(sections: Sections, line: list[float]) -> KnotVector:
    degree, count, knots = int(line[0]), int(line[1]), np.array(line[2:])
    if not 1 <= degree <= HIGHEST:
        raise sections.error("knotvectors", f"expected a degree from 1 to {HIGHEST}, found {degree}")
    if len(knots) != degree + count + 1 or count <= degree or (np.diff(knots) < 0).any():
        raise sections.error("knotvectors", f"expected {degree + count + 1} ascending knots, found {line[2:]}")
    return KnotVector(degree, knots)


def _patch_knots(
    sections: Sections, vertices: Ints, edges: Ints, vectors: list[KnotVector]
) -> list[tuple[KnotVector, KnotVector, KnotVector]]:
    """The knot vectors of each patch along its first three edges, turned where the file's edge runs the other way."""
    found: dict[tuple[int, int], KnotVector] = {}
    for vector, a, b in edges.tolist():
        if not 0 <= vector < len(vectors):
            raise sections.error("edges", f"expected a knot vector from 0 to {len(vectors) - 1}, found {vector}")
        found[a, b], found[b, a] = vectors[vector], vectors[vector].reversed()
    result = []
    for own in vertices.tolist():
        for a, b in EDGES:
            if (own[a], own[b]) not in found:
                raise sections.error("edges", f"expected an edge from vertex {own[a]} to {own[b]}, found none")
        x, y, z = (found[own[a], own[b]] for a, b in ((0, 1), (0, 3), (0, 4)))
        result.append((x, y, z))
    return result


class Sections:
    """A text file of headings and numbers, without comments; unexpected contents raise FormatError.

    words  text after a heading with a colon, such as ``VDim: 3``
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.words: dict[str, str] = {}
        self._lines: dict[str, list[str]] = {}
        lines = (line.strip() for line in content(path).decode("ascii", "replace").splitlines())
        current: list[str] = []
        for line in lines:
            if numbers := re.fullmatch(r"([a-z]+)\s+([-+.\deE\s]+)", line):
                # a heading with its numbers on the same line, as in "dimension 2"
                current = self._lines.setdefault(numbers[1], [])
                current.append(numbers[2])
            elif line and line[0].isalpha():
                name, _, word = line.partition(":")
                current = self._lines.setdefault(name, [])
                self.words[name] = word.strip()
            elif line and not line.startswith("#"):
                current.append(line)

    @property
    def names(self) -> list[str]:
        """The headings, in the order of the file."""
        return list(self._lines)

    def error(self, name: str, message: str) -> FormatError:
        """A FormatError at a heading."""
        return FormatError(message, file=self._path, place=name)

    def rows(self, name: str) -> list[list[float]]:
        """The numbers below a heading, line by line."""
        if name not in self._lines:
            raise self.error(name, "expected this heading, found none")
        try:
            return [[float(word) for word in line.split()] for line in self._lines[name]]
        except ValueError as error:
            raise self.error(name, f"expected numbers, found others ({error})") from error

    def numbers(self, name: str, width: int) -> Floats:
        """(n, width) numbers below a heading."""
        values = [value for row in self.rows(name) for value in row]
        if not values or len(values) % width:
            raise self.error(name, f"expected rows of {width} numbers, found {len(values)}")
        return np.array(values).reshape(-1, width)

    def counted_rows(self, name: str, width: int) -> Floats:
        """(n, width) numbers below a heading and their count."""
        rows = self.rows(name)
        if not rows or len(rows[0]) != 1 or len(rows) != rows[0][0] + 1 or any(len(row) != width for row in rows[1:]):
            raise self.error(name, f"expected a count and as many rows of {width} numbers, found {len(rows)} rows")
        return np.array(rows[1:]).reshape(-1, width)

    def cubes(self, name: str) -> Ints:
        """(n, 8) vertices; a row has attribute, kind and vertices."""
        rows = self.counted_rows(name, 10).astype(np.int64)
        if not len(rows) or (rows[:, 1] != _CUBE).any() or (rows[:, 2:] < 0).any():
            raise self.error(name, f"expected patches of kind {_CUBE} (hexahedra), found others")
        return rows[:, 2:]
