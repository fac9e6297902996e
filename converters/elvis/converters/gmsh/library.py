"""Worker for Gmsh's library in a separate process: its mesh as numbers, texts and arrays."""

from __future__ import annotations

import mmap
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from elvis.converters.gmsh.binary import check
from elvis.converters.gmsh.census import census
from elvis.converters.gmsh.data import MAGIC, MAGIC_1
from elvis.converters.gmsh.mesh import HIGHEST, Functions
from elvis.converters.shared.unit import UNIT
from elvis.core.base.arrays import Bools, Floats, Ints, distinct_bits, joined_ints
from elvis.core.base.errors import FormatError
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

#: prefixes of the library's messages about failures and about parts that it left out
_ERROR, _WARNING = "Error: ", "Warning: "


class Library:
    """The library, which reads one file after another."""

    def __init__(self) -> None:
        import gmsh

        gmsh.initialize(["elvis"], readConfigFiles=False, interruptible=False)
        for option in ("General.Terminal", "General.AbortOnError"):  # errors are in the log; some mean nothing
            gmsh.option.setNumber(option, 0)
        self._gmsh: Any = gmsh

    def mesh(self, path: str, named: str) -> dict[str, Any]:
        """The data of an `elvis.converters.gmsh.mesh.Mesh`.

        Raises FormatError, naming ``named``, with the first complaint.

        The kinds are dictionaries, the groups lists that begin with the number of their kind.
        """
        original = Path(named)
        counts = self._check(Path(path), original)
        warnings = self._load(path, original)
        mesh = _Reading(self._gmsh, original, counts).mesh()
        mesh["notes"] += dict.fromkeys(warnings)
        return mesh

    def _check(self, path: Path, named: Path) -> Counter[int] | None:
        """Number of elements of each type, None if they can't be counted.

        Raises FormatError if a binary mesh isn't as long as it says.
        """

        def width(number: int) -> int:
            try:
                return int(self._gmsh.model.mesh.getElementProperties(number)[3])
            except Exception as error:  # the library has no other type
                raise FormatError(f"expected a known type of elements, found {number}", file=named) from error

        with path.open("rb") as file:
            if file.read(len(MAGIC_1)) != MAGIC_1 and not file.seek(0) and file.read(len(MAGIC)) != MAGIC:
                return None
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
                counts = check(named, raw, width)
                return census(raw, width) if counts is None else counts

    def _load(self, path: str, named: Path) -> list[str]:
        """The library's warnings when it opens a file; raises FormatError with its first complaint."""
        lines = self._log(path)
        errors = [line.removeprefix(_ERROR) for line in lines if line.startswith(_ERROR)]
        if errors:
            reason = errors[0].replace(path, named.name)
            raise FormatError(f"expected a complete mesh, found: {reason}", file=named)
        warnings = (line.removeprefix(_WARNING) for line in lines if line.startswith(_WARNING))
        return [f"Gmsh: {warning.replace(path, named.name)}" for warning in warnings]

    def _log(self, path: str) -> list[str]:
        """The lines that the library logs when it opens a file; the last one is the reason why it failed, if it did."""
        self._gmsh.clear()
        self._gmsh.logger.start()
        failures = list[str]()
        try:
            self._gmsh.open(path)
        except Exception as error:  # noqa: BLE001 - the library has no other type
            # the log says why, but for a lack of memory
            failures.append(f"{_ERROR}{str(error) or 'more than the library has memory for'}")
        try:
            lines = list(self._gmsh.logger.get())
        except UnicodeDecodeError:
            lines = [f"{_ERROR}names that are not text"]
        self._gmsh.logger.stop()
        return [*lines, *failures]


#: elements of one type in an entity: its dimension and tag, the type, their tags (n,) and nodes (n, k)
_Batch: TypeAlias = tuple[int, int, int, Ints, Ints]


@dataclass(eq=False)
class _Reading:
    """The mesh that the library has read from a file: its types of elements by number, notes, names of sides.

    counts  number of elements of each type in the file, None if it isn't known
    """

    gmsh: Any
    path: Path
    counts: Counter[int] | None
    kinds: dict[int, dict[str, Any]] = field(default_factory=dict)
    parts: dict[tuple[int, tuple[str, ...]], list[tuple[Ints, Ints]]] = field(default_factory=dict)
    others: list[Ints] = field(default_factory=list)
    sides: dict[str, list[Ints]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    ghosts: list[Ints] = field(default_factory=list)
    copies: int = 0

    def mesh(self) -> dict[str, Any]:
        """Nodes, and elements by type and physical group, as `Library.mesh` returns them."""
        tags, places, _ = self.gmsh.model.mesh.getNodes()
        order = np.argsort(tags)
        tags, places = np.asarray(tags, np.int64)[order], np.asarray(places, np.float64).reshape(-1, 3)[order]
        batches = list(self._batches())
        dimension = max((batch[0] for batch in batches), default=0)
        if not dimension:
            raise FormatError("expected elements, found none", file=self.path)
        for d, entity, kind, own, table in batches:
            names = self._groups(d, entity)
            if d == dimension:
                self._take(kind, names, own, table)
            else:
                self._take_lower(kind, names if d == dimension - 1 else [], own, table)
        groups = self._distinct_groups(tags)
        return {
            "tags": tags,
            "places": places,
            "kinds": list(self.kinds.values()),
            "groups": groups,
            "sides": self.sides,
            "others": joined_ints(self.others),
            "notes": self.notes,
            "declared": self._declared(dimension),
            "partitions": self._partitions(dimension),
            "partition_count": int(self.gmsh.model.getNumberOfPartitions()),
        }

    def _declared(self, dimension: int) -> int | None:
        """Number of elements of a dimension that the file lists, each once; None if it isn't known.

        Elements of lower dimension are no measure: the library adds those between partitions.
        """
        if self.counts is None:
            return None
        properties = self.gmsh.model.mesh.getElementProperties
        listed = sum(count for kind, count in self.counts.items() if properties(kind)[1] == dimension)
        return listed - self.copies - self._foreign_ghosts()

    def _batches(self) -> Iterator[_Batch]:
        """All elements but copies that partitions hold of others' elements."""
        if self._has_mixed_families():
            yield from self._one_by_one()
            return
        for d, entity in self.gmsh.model.getEntities():
            types, numbers, nodes = self.gmsh.model.mesh.getElements(d, entity)
            if self.gmsh.model.getType(d, entity).startswith("Ghost"):
                self.ghosts += [np.asarray(tags, np.int64) for tags in numbers]
                continue
            for kind, tags, flat in zip(map(int, types), numbers, nodes, strict=True):
                own = np.asarray(tags, np.int64)
                yield d, entity, kind, own, np.asarray(flat, np.int64).reshape(len(own), -1)

    def _has_mixed_families(self) -> bool:
        """Whether there are several types of a family, such as triangles of two orders."""
        names = [self.gmsh.model.mesh.getElementProperties(kind)[0].split()[0] for kind in self.counts or ()]
        return len(set(names)) < len(names)

    def _one_by_one(self) -> Iterator[_Batch]:
        """Elements, found by their tags one by one: for mixed families, the library overruns its arrays."""
        found: defaultdict[tuple[int, int, int], list[tuple[int, Ints]]] = defaultdict(list)
        for tag in range(1, int(self.gmsh.model.mesh.getMaxElementTag()) + 1):
            with suppress(Exception):  # this tag has no element
                kind, nodes, d, entity = self.gmsh.model.mesh.getElement(tag)
                found[d, entity, int(kind)].append((tag, np.asarray(nodes, np.int64)))
        for (d, entity, kind), elements in found.items():
            own, table = zip(*elements, strict=True)
            yield d, entity, kind, np.array(own, np.int64), np.stack(table)

    def _take(self, kind: int, names: list[str], own: Ints, table: Ints) -> None:
        """Elements of the highest dimension, with the names of their groups."""
        if kind not in self.kinds:
            self.kinds[kind] = self._kind(kind)
        self.parts.setdefault((kind, tuple(names)), []).append((own, table))

    def _take_lower(self, kind: int, names: list[str], own: Ints, table: Ints) -> None:
        """Elements of lower dimension, with the names of the boundaries that they belong to."""
        self.others.append(own)
        corners = self.gmsh.model.mesh.getElementProperties(kind)[5]
        for name in names:
            self.sides.setdefault(name, []).append(table[:, :corners])

    def _distinct_groups(self, tags: Ints) -> list[list[Any]]:
        """Number of the kind, regions, tags and nodes of the elements in the same regions; each element counts once.

        Versions 1 and 2 repeat an element, with another number, for each physical group that contains it.
        """
        groups: list[list[Any]] = []
        for number, kind in enumerate(self.kinds):
            regions = [names for own, names in self.parts if own == kind]
            pieces = [list(zip(*self.parts[kind, names], strict=True)) for names in regions]
            own = np.concatenate([numbers for each, _ in pieces for numbers in each])
            rows = self._rows(tags, np.concatenate([nodes for _, each in pieces for nodes in each]))
            part = np.repeat(np.arange(len(pieces)), [sum(map(len, each)) for each, _ in pieces])
            first, which = distinct_bits(np.sort(rows, axis=1))
            self._count_copies(np.delete(own, first))
            is_in = np.zeros((len(first), len(regions)), bool)
            is_in[which, part] = True
            for names, chosen in _alike(is_in, regions):
                kept = np.sort(first[chosen])
                groups.append([number, names, own[kept], rows[kept]])
        return groups

    def _foreign_ghosts(self) -> int:
        """Number of ghosts that are elements of no partition in the file, which lists them for that reason."""
        own = [numbers for pieces in self.parts.values() for numbers, _ in pieces]
        ghosts = np.unique(joined_ints(self.ghosts))
        return int((~np.isin(ghosts, np.concatenate(own))).sum())

    def _count_copies(self, copies: Ints) -> None:
        """Note elements that are listed again."""
        if len(copies):
            self.copies += len(copies)
            self.others.append(copies)
            self.notes.append(f"{len(copies)} elements that are listed again, as for further groups, count once")

    def _partitions(self, dimension: int) -> list[int]:
        """The partitions that elements are of; none in a mesh that has no partitions."""
        found: set[int] = set()
        for d, entity in self.gmsh.model.getEntities(dimension):
            is_own = not self.gmsh.model.getType(d, entity).startswith("Ghost")
            if is_own and len(self.gmsh.model.mesh.getElementTypes(d, entity)):
                found |= set(map(int, self.gmsh.model.getPartitions(d, entity)))
        return sorted(found)

    def _groups(self, dimension: int, entity: int) -> list[str]:
        """Names of the physical groups of an entity."""
        numbers = self.gmsh.model.getPhysicalGroupsForEntity(dimension, entity)
        named = ((_name(self.gmsh.model.getPhysicalName, dimension, abs(n)), abs(n)) for n in numbers)
        return [name or f"physical{number}" for name, number in named]

    def _rows(self, tags: Ints, nodes: Ints) -> Ints:
        """Rows of the positions of nodes given by tag; ``tags`` holds all tags, sorted."""
        rows = np.minimum(np.searchsorted(tags, nodes), len(tags) - 1)
        if not np.array_equal(tags[rows], nodes):
            missing = np.setdiff1d(nodes, tags)[0]
            raise FormatError(f"expected nodes that are defined, found {missing}", file=self.path, place="elements")
        return rows

    def _kind(self, number: int) -> dict[str, Any]:
        """A type of elements with its functions, sampled from the library at enough points to determine them."""
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


def _alike(is_in: Bools, regions: Sequence[tuple[str, ...]]) -> Iterator[tuple[list[str], Ints]]:
    """Names of the regions, and the elements in exactly these, of elements that are (n, regions) in some of them."""
    patterns, which = np.unique(~is_in, axis=0, return_inverse=True)  # the first regions come first
    for number, pattern in enumerate(patterns):
        names = [name for own, is_out in zip(regions, pattern, strict=True) if not is_out for name in own]
        yield list(dict.fromkeys(names)), np.flatnonzero(which.reshape(-1) == number)


def _name(ask: Callable[[int, int], str], dimension: int, number: int) -> str:
    """A name stored by the library; empty if it is not UTF-8, which the library doesn't check."""
    try:
        return ask(dimension, number)
    except UnicodeDecodeError:
        return ""
