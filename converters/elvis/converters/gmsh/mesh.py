"""Meshes of Gmsh files as arrays, with the functions of its elements; its library reads them in another process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.gmsh.data import Contents
from elvis.converters.shared.apart import Apart, LibraryError
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import TENSOR, Shape
from elvis.plugins.conversion.nodal import ShapeFunctions, affine_image, native_points, space_values, tensor_nodes
from elvis.plugins.conversion.plugin import PyramidSpace

#: functions that differ by more from a polynomial aren't one
_ROUNDING, HIGHEST = 1e-8, 15

#: by which the library knows the format
_SUFFIX = ".msh"

#: reads in another process
_WORKER = "elvis.converters.gmsh.library:Library"


@dataclass(eq=False)
class Kind:
    """A type of elements: ``nodes`` (k, d) in the library's reference coordinates, ``corners`` ours among them."""

    name: str
    shape: Shape
    nodes: Floats
    corners: Ints
    functions: Functions

    @property
    def frame(self) -> Floats:
        """(n_vertices, d) the library's reference coordinates of our vertices."""
        return self.nodes[self.corners]

    @classmethod
    def from_message(cls, plain: Mapping[str, Any]) -> Kind:
        """A kind from another process's message: all fields by name, the functions by their data."""
        shape, nodes, corners = Shape[plain["shape"]], plain["nodes"], plain["corners"]
        functions = Functions(shape, plain["degree"], nodes[corners], plain["coefficients"])
        return cls(plain["name"], shape, nodes, corners, functions)


@dataclass(eq=False)
class Group:
    """Elements of one type in the same parts of the mesh, by name.

    tags   (n,)
    nodes  (n, k) numbers of rows of places
    """

    kind: Kind
    regions: list[str]
    tags: Ints
    nodes: Ints


@dataclass(eq=False)
class Mesh:
    """The content of a file's mesh; ``sides`` holds numbers of nodes at the corners of elements one dimension lower.

    declared  number of distinct elements of the highest dimension that the file lists; None if unknown
    partitions, partition_count   partitions of the elements, and number of partitions of the mesh
    """

    tags: Ints
    places: Floats
    groups: list[Group] = field(default_factory=list)
    sides: dict[str, list[Ints]] = field(default_factory=dict)
    others: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    notes: list[str] = field(default_factory=list)
    declared: int | None = None
    partitions: list[int] = field(default_factory=list)
    partition_count: int = 0

    @property
    def omission(self) -> str:
        """A message if only some of the partitions have elements."""
        if not 0 < len(self.partitions) < self.partition_count:
            return ""
        return (
            f"these are partitions {', '.join(map(str, self.partitions))} of {self.partition_count}, without the others"
        )


class Functions(ShapeFunctions):
    """Functions that are combinations of functions of a complete space.

    frame         (n_vertices, d) the library's reference coordinates of our vertices
    coefficients  (modes, functions)
    """

    def __init__(self, shape: Shape, order: int, frame: Floats, coefficients: Floats) -> None:
        self.shape, self.order, self._frame, self.coefficients = shape, order, frame, coefficients

    @property
    def count(self) -> int:
        """Number of functions."""
        return int(self.coefficients.shape[1])

    def tabulate(self, points: Floats) -> Floats:
        """(n, functions) values at points (n, d) of the library's reference element."""
        own = native_points(self.shape, self._frame, points)
        return np.asarray(space_values(self.shape, self.order, own, PyramidSpace.RATIONAL) @ self.coefficients)

    @classmethod
    def fit(
        cls, shape: Shape, frame: Floats, evaluate: Callable[[Floats], Floats], orders: range = range(HIGHEST + 1)
    ) -> Functions | None:
        """Fit functions given by their values at points (n, 3); None if they are in no space of these orders."""
        for order in orders:
            eta = tensor_nodes(TENSOR[shape.dimension - 1], tuple(gauss(order + 2)[0].tolist()))
            own = uncollapse(shape, eta)
            points = np.zeros((len(own), 3))
            points[:, : shape.dimension] = affine_image(own, shape.vertices, frame)
            with np.errstate(over="ignore", invalid="ignore"):
                table, wanted = space_values(shape, order, own, PyramidSpace.RATIONAL), evaluate(points)
            if not np.isfinite(wanted).all():  # least squares might not terminate for these
                return None
            coefficients = np.asarray(np.linalg.lstsq(table, wanted, rcond=None)[0], np.float64)
            if np.abs(table @ coefficients - wanted).max() <= _ROUNDING * np.abs(wanted).max():
                return cls(shape, order, frame, coefficients)
        return None

    @classmethod
    def linear(cls, kind: Kind) -> Functions:
        """One function for each vertex of a type of elements, in the library's order."""
        nodes = native_points(kind.shape, kind.frame, kind.nodes[: len(kind.corners)])
        table = space_values(kind.shape, 1, nodes, PyramidSpace.RATIONAL)
        return cls(kind.shape, 1, kind.frame, np.asarray(np.linalg.inv(table), np.float64))


def read_meshes(files: Sequence[Contents]) -> list[Mesh]:
    """The meshes of files; raises FormatError with the library's first complaint."""
    # the library forgets each file before the next, so a small file among large ones allows no more than the largest
    size = max(each.path.stat().st_size for each in files)
    with Apart(_WORKER, size) as library:
        return [_read_mesh(each, library) for each in files]


def _read_mesh(contents: Contents, library: Apart) -> Mesh:
    """The mesh of a file.

    A file with another suffix is linked, because the library knows formats by these.
    """
    with TemporaryDirectory() as folder:
        path = contents.path
        if contents.is_plain and path.suffix != _SUFFIX:
            path = Path(folder) / f"mesh{_SUFFIX}"
            path.symlink_to(contents.path.resolve())
        elif not contents.is_plain:  # the library reads a copy without data and comments
            path = Path(folder) / "mesh.msh"
            with contents.path.open("rb") as whole, path.open("wb") as part:
                for start, end in contents.mesh:
                    whole.seek(start)
                    part.write(whole.read(end - start))
        size = path.stat().st_size
        try:
            found = library.ask("mesh", str(path), str(contents.path), size=size)
        except LibraryError as failure:
            raise FormatError(f"expected a complete mesh, found: {failure.reason}", file=contents.path) from failure
    kinds, groups = [Kind.from_message(plain) for plain in found.pop("kinds")], found.pop("groups")
    return Mesh(groups=[Group(kinds[kind], *own) for kind, *own in groups], **found)
