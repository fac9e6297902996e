"""Meshes of Gmsh files, read by its library into arrays, with the functions of its elements."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.gmsh_binary import check
from elvis.converters.gmsh_data import MAGIC, Contents
from elvis.converters.trial import attempt
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape
from elvis.plugins.conversion import PyramidSpace
from elvis.plugins.nodal import native_points, space_values, tensor_nodes

_SHAPES = {
    "Line": Shape.SEGMENT,
    "Triangle": Shape.TRIANGLE,
    "Quadrilateral": Shape.QUADRILATERAL,
    "Tetrahedron": Shape.TETRAHEDRON,
    "Hexahedron": Shape.HEXAHEDRON,
    "Prism": Shape.PRISM,
    "Pyramid": Shape.PYRAMID,
}

#: the library's vertex at each of ours
CORNERS = {Shape.PRISM: (0, 2, 5, 3, 1, 4)}

#: functions that differ by more from a polynomial aren't one
_ROUNDING, _HIGHEST = 1e-8, 15

#: how the library says that it couldn't read, and that it left something out
_ERROR, _WARNING = "Error: ", "Warning: "

#: of a damaged file the library leaves things behind that it complains of at the end, so that the trial just stops
_TRIAL = """
from pathlib import Path
import gmsh
from elvis.converters.gmsh_mesh import complaints, mesh_of
gmsh.initialize(["elvis"], readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.option.setNumber("General.AbortOnError", 0)
bound()
found = complaints(gmsh, sys.argv[1])
if not found:
    with suppress(Exception):
        mesh_of(gmsh, Path(sys.argv[1]), True)
say("".join(found[:1]))
os._exit(1 if found else 0)
"""


@dataclass(eq=False)
class Kind:
    """A type of elements: ``nodes`` (k, d) in the library's reference coordinates, ``corners`` ours among them."""

    name: str
    shape: Shape
    order: int
    nodes: Floats
    corners: Ints
    functions: Functions

    @property
    def frame(self) -> Floats:
        """(n_vertices, d) the library's reference coordinates of our vertices."""
        return self.nodes[self.corners]


@dataclass(eq=False)
class Group:
    """Elements of one type and one part of the mesh: ``tags`` (n,), ``nodes`` (n, k) numbers of rows of places."""

    kind: Kind
    region: str
    tags: Ints
    nodes: Ints


@dataclass(eq=False)
class Mesh:
    """What a file's mesh holds; ``sides`` are numbers of nodes at the corners of elements one dimension lower."""

    tags: Ints
    places: Floats
    groups: list[Group] = field(default_factory=list)
    sides: dict[str, list[Ints]] = field(default_factory=dict)
    others: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    notes: list[str] = field(default_factory=list)


class Functions:
    """Functions that are combinations of those of a complete space.

    order         of the least complete space that holds them
    coefficients  (modes, functions)
    """

    def __init__(self, shape: Shape, order: int, frame: Floats, coefficients: Floats) -> None:
        self.shape, self.order, self._frame, self._coefficients = shape, order, frame, coefficients
        self._last: tuple[Floats, Floats] | None = None

    @property
    def count(self) -> int:
        """Number of functions."""
        return int(self._coefficients.shape[1])

    def at(self, points: Floats) -> Floats:
        """(n, functions) values at points (n, d) of the library's reference element."""
        if self._last is None or self._last[0] is not points:
            own = native_points(self.shape, self._frame, points)
            table = space_values(self.shape, self.order, own, PyramidSpace.RATIONAL) @ self._coefficients
            self._last = (points, table)
        return self._last[1]

    @classmethod
    def fitted(
        cls, shape: Shape, frame: Floats, evaluate: Callable[[Floats], Floats], orders: range = range(_HIGHEST + 1)
    ) -> Functions | None:
        """Of functions given by their values at points (n, 3); None where they are in no space of these orders."""
        for order in orders:
            eta = tensor_nodes(_BOXES[shape.dimension], tuple(gauss(order + 2)[0].tolist()))
            own = uncollapse(shape, eta)
            points = np.zeros((len(own), 3))
            points[:, : shape.dimension] = _from_native(shape, frame, own)
            table, wanted = space_values(shape, order, own, PyramidSpace.RATIONAL), evaluate(points)
            coefficients = np.asarray(np.linalg.lstsq(table, wanted, rcond=None)[0], np.float64)
            if np.abs(table @ coefficients - wanted).max() <= _ROUNDING * np.abs(wanted).max():
                return cls(shape, order, frame, coefficients)
        return None


_BOXES = {1: Shape.SEGMENT, 2: Shape.QUADRILATERAL, 3: Shape.HEXAHEDRON}


def _from_native(shape: Shape, frame: Floats, points: Floats) -> Floats:
    from elvis.plugins.projection.frames import affine_between

    matrix, offset = affine_between(shape.vertices, frame)
    return points @ matrix.T + offset


def read_mesh(contents: Contents, with_entities: bool = False, suffix: str = ".msh") -> Mesh:
    """The mesh of a file; FormatError with the library's first complaint.

    with_entities  whether entities that are in no physical group are parts by their own names
    suffix         by which the library knows the format; a file of another name is linked
    """
    with TemporaryDirectory() as folder, session() as gmsh:
        path = contents.path
        if contents.is_plain and path.suffix != suffix:
            path = Path(folder) / f"mesh{suffix}"
            path.symlink_to(contents.path.resolve())
        elif not contents.is_plain:  # the library reads a copy without data and comments
            path = Path(folder) / "mesh.msh"
            with contents.path.open("rb") as whole, path.open("wb") as part:
                for start, end in contents.mesh:
                    whole.seek(start)
                    part.write(whole.read(end - start))
        _check(gmsh, path, contents.path)
        _try(path, contents.path)
        warnings = _load(gmsh, path, contents.path)
        mesh = mesh_of(gmsh, contents.path, with_entities)
        mesh.notes += dict.fromkeys(warnings)
        return mesh


@contextmanager
def session() -> Iterator[Any]:
    """The library, begun and ended here, or a model of its own in one that is at work."""
    import gmsh

    is_ours = not gmsh.isInitialized()
    if is_ours:
        gmsh.initialize(["elvis"], readConfigFiles=False, interruptible=False)
    options = ("General.Terminal", "General.AbortOnError")
    before = {name: gmsh.option.getNumber(name) for name in options}
    current = None if is_ours else gmsh.model.getCurrent()
    for name in options:  # errors are looked for in the log; cubic prisms cause some that mean nothing
        gmsh.option.setNumber(name, 0)
    try:
        yield gmsh
    finally:
        if is_ours:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            gmsh.model.setCurrent(current)
            for name, value in before.items():
                gmsh.option.setNumber(name, value)


def _check(gmsh: Any, path: Path, named: Path) -> None:
    """FormatError where a binary mesh isn't as long as it says."""

    def width(number: int) -> int:
        try:
            return int(gmsh.model.mesh.getElementProperties(number)[3])
        except Exception:
            raise FormatError(f"expected a known type of elements, found {number}", file=named) from None

    with path.open("rb") as file:
        if file.read(len(MAGIC)) == MAGIC:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
                check(named, raw, width)


def _try(path: Path, named: Path) -> None:
    """FormatError where the library dies of a file, or takes too long."""
    outcome = attempt(_TRIAL, [path])
    if outcome.status:
        reason = outcome.reason.replace(str(path), named.name)
        raise FormatError(f"expected a whole mesh, found: {reason}", file=named)


def _load(gmsh: Any, path: Path, named: Path) -> list[str]:
    """What the library warns of when it opens a file; FormatError with its first complaint."""
    lines = _log(gmsh, str(path))
    errors = [line.removeprefix(_ERROR) for line in lines if line.startswith(_ERROR)]
    if errors:
        reason = errors[0].replace(str(path), named.name)
        raise FormatError(f"expected a whole mesh, found: {reason}", file=named)
    warnings = (line.removeprefix(_WARNING) for line in lines if line.startswith(_WARNING))
    return [f"Gmsh: {warning.replace(str(path), named.name)}" for warning in warnings]


def complaints(gmsh: Any, path: str) -> list[str]:
    """What the library has to complain of when it opens a file."""
    return [line.removeprefix(_ERROR) for line in _log(gmsh, path) if line.startswith(_ERROR)]


def _log(gmsh: Any, path: str) -> list[str]:
    """The lines that the library logs when it opens a file."""
    gmsh.logger.start()
    with suppress(Exception):  # the log says what
        gmsh.open(path)
    try:
        lines = list(gmsh.logger.get())
    except UnicodeDecodeError:
        lines = [f"{_ERROR}names that are no text"]
    gmsh.logger.stop()
    return lines


def mesh_of(gmsh: Any, path: Path, with_entities: bool) -> Mesh:
    """Nodes, and elements by type and physical group."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    mesh = Mesh(np.asarray(tags, np.int64)[order], np.asarray(places, np.float64).reshape(-1, 3)[order])
    entities = gmsh.model.getEntities()
    dimension = max((d for d, tag in entities if len(gmsh.model.mesh.getElementTypes(d, tag))), default=0)
    if not dimension:
        raise FormatError("expected elements, found none", file=path)
    kinds: dict[int, Kind] = {}
    parts: dict[tuple[int, str], list[tuple[Ints, Ints]]] = {}
    others = []
    for d, entity in entities:
        types, numbers, nodes = gmsh.model.mesh.getElements(d, entity)
        names = _groups(gmsh, d, entity)
        if with_entities and not names:
            names = [name for name in [_name(gmsh.model.getEntityName, d, entity)] if name]
        for kind, own, flat in zip(types, numbers, nodes, strict=True):
            own, table = np.asarray(own, np.int64), np.asarray(flat, np.int64).reshape(len(own), -1)
            if d == dimension:
                if kind not in kinds:
                    kinds[kind] = _kind(gmsh, kind, path)
                parts.setdefault((kind, names[0] if names else ""), []).append((own, table))
                if len(names) > 1:
                    mesh.notes.append(f"elements of {names[0]!r} are of {', '.join(map(repr, names[1:]))} too")
                continue
            others.append(own)
            corners = gmsh.model.mesh.getElementProperties(kind)[5]
            for name in names if d == dimension - 1 else ():
                mesh.sides.setdefault(name, []).append(table[:, :corners])
    mesh.others = np.concatenate([mesh.others, *others])
    for (kind, region), pieces in parts.items():
        own = np.concatenate([piece for piece, _ in pieces])
        mesh.groups.append(Group(kinds[kind], region, own, _rows(mesh, np.concatenate([t for _, t in pieces]), path)))
    return mesh


def _groups(gmsh: Any, dimension: int, entity: int) -> list[str]:
    """Names of the physical groups of an entity."""
    numbers = gmsh.model.getPhysicalGroupsForEntity(dimension, entity)
    named = ((_name(gmsh.model.getPhysicalName, dimension, abs(n)), abs(n)) for n in numbers)
    return [name or f"physical{number}" for name, number in named]


def _name(ask: Callable[[int, int], str], dimension: int, number: int) -> str:
    """A name that the library keeps; none where it is no UTF-8, which the library doesn't tell."""
    try:
        return ask(dimension, number)
    except UnicodeDecodeError:
        return ""


def _rows(mesh: Mesh, nodes: Ints, path: Path) -> Ints:
    """Rows of the places of nodes given by tag."""
    rows = np.minimum(np.searchsorted(mesh.tags, nodes), len(mesh.tags) - 1)
    if not np.array_equal(mesh.tags[rows], nodes):
        missing = np.setdiff1d(nodes, mesh.tags)[0]
        raise FormatError(f"expected nodes that are defined, found {missing}", file=path, place="elements")
    return rows


def _kind(gmsh: Any, number: int, path: Path) -> Kind:
    """A type of elements with its functions, taken from the library at as many points as tell them."""
    name, dimension, order, count, local, corners = gmsh.model.mesh.getElementProperties(number)
    shape = _SHAPES.get(name.split()[0])
    nodes = np.asarray(local, np.float64).reshape(count, -1)[:, :dimension]
    if shape is None or len(shape.vertices) != corners:
        expected = ", ".join(key.lower() for key in _SHAPES)
        raise FormatError(f"expected elements of the kinds {expected}, found {name}", file=path)
    own = np.array(CORNERS.get(shape, range(corners)))

    def evaluate(points: Floats) -> Floats:
        table = gmsh.model.mesh.getBasisFunctions(number, points.reshape(-1), "Lagrange")[1]
        return np.asarray(table, np.float64).reshape(len(points), count)

    functions = Functions.fitted(shape, nodes[own], evaluate, range(order, max(_HIGHEST, order + 3)))
    if functions is None:
        raise FormatError(f"expected functions of some order in {name}, found others", file=path)
    return Kind(name, shape, order, nodes, own, functions)
