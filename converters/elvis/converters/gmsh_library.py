"""What Gmsh's library does with a file, in a process of its own: its mesh as numbers, texts and arrays."""

from __future__ import annotations

import mmap
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.gmsh_binary import check
from elvis.converters.gmsh_data import MAGIC
from elvis.converters.gmsh_mesh import HIGHEST, Functions
from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.shapes import Shape

_SHAPES = {
    "Line": Shape.SEGMENT,
    "Triangle": Shape.TRIANGLE,
    "Quadrilateral": Shape.QUADRILATERAL,
    "Tetrahedron": Shape.TETRAHEDRON,
    "Hexahedron": Shape.HEXAHEDRON,
    "Prism": Shape.PRISM,
    "Pyramid": Shape.PYRAMID,
}

#: how the library says that it couldn't read, and that it left something out
_ERROR, _WARNING = "Error: ", "Warning: "


class Library:
    """The library, which reads one file."""

    def __init__(self) -> None:
        import gmsh

        gmsh.initialize(["elvis"], readConfigFiles=False, interruptible=False)
        for option in ("General.Terminal", "General.AbortOnError"):  # errors are in the log; some mean nothing
            gmsh.option.setNumber(option, 0)
        self._gmsh: Any = gmsh

    def mesh(self, path: str, named: str, with_entities: bool) -> dict[str, Any]:
        """What makes an `elvis.converters.gmsh_mesh.Mesh`; FormatError, naming ``named``, with the first complaint.

        The kinds are dictionaries, the groups lists that begin with the number of their kind.
        """
        original = Path(named)
        self._check(Path(path), original)
        warnings = self._load(path, original)
        mesh = _Reading(self._gmsh, original).mesh(with_entities)
        mesh["notes"] += dict.fromkeys(warnings)
        return mesh

    def _check(self, path: Path, named: Path) -> None:
        """FormatError where a binary mesh isn't as long as it says."""

        def width(number: int) -> int:
            try:
                return int(self._gmsh.model.mesh.getElementProperties(number)[3])
            except Exception:
                raise FormatError(f"expected a known type of elements, found {number}", file=named) from None

        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
                    check(named, raw, width)

    def _load(self, path: str, named: Path) -> list[str]:
        """What the library warns of when it opens a file; FormatError with its first complaint."""
        lines = self._log(path)
        errors = [line.removeprefix(_ERROR) for line in lines if line.startswith(_ERROR)]
        if errors:
            reason = errors[0].replace(path, named.name)
            raise FormatError(f"expected a whole mesh, found: {reason}", file=named)
        warnings = (line.removeprefix(_WARNING) for line in lines if line.startswith(_WARNING))
        return [f"Gmsh: {warning.replace(path, named.name)}" for warning in warnings]

    def _log(self, path: str) -> list[str]:
        """The lines that the library logs when it opens a file."""
        self._gmsh.logger.start()
        with suppress(Exception):  # the log says what
            self._gmsh.open(path)
        try:
            lines = list(self._gmsh.logger.get())
        except UnicodeDecodeError:
            lines = [f"{_ERROR}names that are no text"]
        self._gmsh.logger.stop()
        return lines


@dataclass(eq=False)
class _Reading:
    """The mesh that the library has read from a file: its types of elements by number, notes, names of sides."""

    gmsh: Any
    path: Path
    kinds: dict[int, dict[str, Any]] = field(default_factory=dict)
    parts: dict[tuple[int, str], list[tuple[Ints, Ints]]] = field(default_factory=dict)
    others: list[Ints] = field(default_factory=list)
    sides: dict[str, list[Ints]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def mesh(self, with_entities: bool) -> dict[str, Any]:
        """Nodes, and elements by type and physical group, as `Library.mesh` returns them."""
        tags, places, _ = self.gmsh.model.mesh.getNodes()
        order = np.argsort(tags)
        tags, places = np.asarray(tags, np.int64)[order], np.asarray(places, np.float64).reshape(-1, 3)[order]
        entities = self.gmsh.model.getEntities()
        found = [d for d, tag in entities if len(self.gmsh.model.mesh.getElementTypes(d, tag))]
        dimension = max(found, default=0)
        if not dimension:
            raise FormatError("expected elements, found none", file=self.path)
        for d, entity in entities:
            names = self._groups(d, entity)
            if with_entities and not names:
                names = [name for name in [_name(self.gmsh.model.getEntityName, d, entity)] if name]
            self._take(d, entity, names, dimension)
        numbers, groups = list(self.kinds), []
        for (kind, region), pieces in self.parts.items():
            own = np.concatenate([piece for piece, _ in pieces])
            rows = self._rows(tags, np.concatenate([table for _, table in pieces]))
            groups.append([numbers.index(kind), region, own, rows])
        return {
            "tags": tags,
            "places": places,
            "kinds": list(self.kinds.values()),
            "groups": groups,
            "sides": self.sides,
            "others": np.concatenate([np.zeros(0, np.int64), *self.others]),
            "notes": self.notes,
        }

    def _take(self, d: int, entity: int, names: list[str], dimension: int) -> None:
        """The elements of an entity of dimension ``d`` in a mesh of some dimension, with the names of its groups."""
        types, numbers, nodes = self.gmsh.model.mesh.getElements(d, entity)
        for kind, tags, flat in zip(map(int, types), numbers, nodes, strict=True):
            own, table = np.asarray(tags, np.int64), np.asarray(flat, np.int64).reshape(len(tags), -1)
            if d == dimension:
                if kind not in self.kinds:
                    self.kinds[kind] = self._kind(kind)
                self.parts.setdefault((kind, names[0] if names else ""), []).append((own, table))
                if len(names) > 1:
                    self.notes.append(f"elements of {names[0]!r} are of {', '.join(map(repr, names[1:]))} too")
                continue
            self.others.append(own)
            corners = self.gmsh.model.mesh.getElementProperties(kind)[5]
            for name in names if d == dimension - 1 else ():
                self.sides.setdefault(name, []).append(table[:, :corners])

    def _groups(self, dimension: int, entity: int) -> list[str]:
        """Names of the physical groups of an entity."""
        numbers = self.gmsh.model.getPhysicalGroupsForEntity(dimension, entity)
        named = ((_name(self.gmsh.model.getPhysicalName, dimension, abs(n)), abs(n)) for n in numbers)
        return [name or f"physical{number}" for name, number in named]

    def _rows(self, tags: Ints, nodes: Ints) -> Ints:
        """Rows of the places of nodes given by tag; ``tags`` are those of all, sorted."""
        rows = np.minimum(np.searchsorted(tags, nodes), len(tags) - 1)
        if not np.array_equal(tags[rows], nodes):
            missing = np.setdiff1d(nodes, tags)[0]
            raise FormatError(f"expected nodes that are defined, found {missing}", file=self.path, place="elements")
        return rows

    def _kind(self, number: int) -> dict[str, Any]:
        """A type of elements with its functions, taken from the library at as many points as tell them."""
        name, dimension, order, count, local, corners = self.gmsh.model.mesh.getElementProperties(number)
        shape = _SHAPES.get(name.split()[0])
        nodes = np.asarray(local, np.float64).reshape(count, -1)[:, :dimension]
        if shape is None or len(shape.vertices) != corners:
            expected = ", ".join(key.lower() for key in _SHAPES)
            raise FormatError(f"expected elements of the kinds {expected}, found {name}", file=self.path)
        own = np.array(UNIT[shape].corners, np.int64)

        def evaluate(points: Floats) -> Floats:
            table = self.gmsh.model.mesh.getBasisFunctions(number, points.reshape(-1), "Lagrange")[1]
            return np.asarray(table, np.float64).reshape(len(points), count)

        functions = Functions.fit(shape, nodes[own], evaluate, range(order, max(HIGHEST, order + 3)))
        if functions is None:
            raise FormatError(f"expected functions of some order in {name}, found others", file=self.path)
        return {
            "name": name,
            "shape": shape.name,
            "nodes": nodes,
            "corners": own,
            "degree": functions.order,
            "coefficients": functions.coefficients,
        }


def _name(ask: Callable[[int, int], str], dimension: int, number: int) -> str:
    """A name that the library keeps; none where it is no UTF-8, which the library doesn't tell."""
    try:
        return ask(dimension, number)
    except UnicodeDecodeError:
        return ""
