"""Exodus II: meshes of orders 1 and 2 with values at nodes and on elements, in one file or one a process."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from elvis.converters.exodus_files import SIDES, Variables, is_exodus, nodes_of, shape_of
from elvis.converters.inputs import STEP, step_number
from elvis.converters.unit import UNIT
from elvis.core.arrays import Bools, Floats, Ints, distinct_bits
from elvis.core.errors import FormatError
from elvis.core.moments import checked_step
from elvis.core.shapes import Shape
from elvis.plugins.conversion import DOUBLE, SINGLE, Boundary, Elements, PyramidSpace
from elvis.plugins.declared import Declared
from elvis.plugins.nodal import NodalBasis, NodalBlock, NodalConverter, NodalValues, space_size
from elvis.plugins.projection.vertices import clusters

#: the end of the name of a file: the number of a mesh in a sequence of meshes, then how many processes wrote the files
#: of a state, and which of them wrote this one
_MARKS = re.compile(r"(?P<stem>.*?)(?P<sequence>-s\d+)?(?:\.(?P<count>\d+)\.(?P<number>\d+))?")

#: nodes of several files that are as near as this, as a share of the largest coordinate, are one
_TOGETHER = 1e-10


class Exodus(NodalConverter):
    """A mesh and its variables at one time, in one file or in one a process."""

    format = "Exodus II (.e, .exo, .gen, .e.4.0, .e-s002)"
    keeps = (
        "elements of orders 1 and 2, serendipity ones too, blocks and side sets by name, nodal and element variables"
    )
    loses = "node sets, attributes, variables of sides and sets; elements of lower dimension"
    needs = ("scipy",)
    options = (STEP,)
    beside = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether this is one file of netCDF with blocks of elements, or several of one state."""
        is_known = bool(paths) and all(map(is_exodus, paths))
        return is_known and (len(paths) == 1 or len({cls.whole(path) for path in paths}) == 1)

    @classmethod
    def whole(cls, path: Path) -> Path:
        """The name without the numbers of processes; the first mesh of a sequence is named as the others are."""
        marks = _marks(path)
        if not is_exodus(path):
            return path
        return path.with_name(f"{marks['stem']}{marks['sequence'] or '-s001'}")

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """Those of the variables, which all files of a state have."""
        return _times(Variables(paths[0]))

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        number = step_number(step)
        self._functions: dict[tuple[Shape, int], _Functions] = {}
        self._pieces = [_Piece(Variables(path)) for path in sorted(paths, key=_process)]
        _number_nodes(self._pieces)
        self.precision = max(piece.precision for piece in self._pieces)
        self._read_blocks()
        self.boundaries = self._side_sets()
        self._read_variables(number)
        self.warnings = _missing_processes(paths)

    def _read_blocks(self) -> None:
        """Blocks of the highest dimension; those of lower dimension are counted."""
        first = 0
        for piece in self._pieces:
            first = self._read_piece(piece, first)
        read = [(piece, number, block) for piece in self._pieces for number, block in piece.blocks.items()]
        dimension = max((block.shape.dimension for *_, block in read), default=0)
        kept = [each for each in read if each[2].shape.dimension == dimension]
        self._owners = [(piece, number) for piece, number, _ in kept]
        self.blocks = [block for *_, block in kept]
        lower = sum(piece.lower for piece in self._pieces) + sum(len(block) for *_, block in read)
        lower -= sum(map(len, self.blocks))
        copies = sum(int((~piece.is_first).sum()) for piece in self._pieces)
        stated = [piece.file.size("num_elem") for piece in self._pieces]
        total = sum(stated) - copies if all(stated) else None
        self.declared = Declared(total, omitted={"elements of lower dimension": lower})

    def _read_piece(self, piece: _Piece, first: int) -> int:
        """The blocks of a file whose elements are numbered from ``first`` on; the number that follows the last."""
        label, start = _labels(piece.file, "eb", "block"), 0
        for number in piece.file_blocks():
            shape, nodes = piece.connectivity(number)
            piece.starts[number] = start
            rows = np.flatnonzero(piece.is_first[start : start + len(nodes)])
            piece.rows[number] = rows
            if shape is None:
                piece.lower += len(rows)
            else:
                ids = first + start + rows
                piece.blocks[number] = self._elements(piece, shape, label(number), nodes[rows], ids)
            start += len(nodes)
        return first + start

    def _elements(self, piece: _Piece, shape: Shape, name: str, nodes: Ints, ids: Ints) -> Elements:
        """Elements with nodes (n, k) of a file."""
        kind = (shape, nodes.shape[1])
        if kind not in self._functions:
            self._functions[kind] = _Functions(*kind)
        functions = self._functions[kind]
        return Elements(
            shape,
            len(nodes),
            functions.order,
            piece.numbers[nodes[:, UNIT[shape].corners]],
            ids=ids,
            region=name,
            pyramid=PyramidSpace.RATIONAL,
            key=NodalBlock(NodalValues(piece.places, functions, nodes)),
        )

    def _side_sets(self) -> list[Boundary]:
        """The side sets that have sides, whose numbers are declared."""
        found: dict[tuple[int, str], list[Ints]] = {}
        counts: dict[str, int] = {}
        for piece in self._pieces:
            label = _labels(piece.file, "ss", "sides")
            for number in range(1, piece.file.size("num_side_sets") + 1):
                if _is_empty(piece.file, f"elem_ss{number}", f"num_side_ss{number}"):
                    continue
                elements, sides = piece.sides(number)
                name = label(number)
                counts[name] = counts.get(name, 0) + len(elements)
                found.setdefault((number, name), []).extend(self._sides(piece, elements, sides))
        self.declared = replace(self.declared, sides=counts)
        return [Boundary(name, vertices=vertices) for (_, name), vertices in found.items()]

    def _sides(self, piece: _Piece, elements: Ints, sides: Ints) -> Iterator[Ints]:
        """Vertices of sides (n,) of elements (n,) of a file."""
        for (owner, number), block in zip(self._owners, self.blocks, strict=True):
            nodes = self.nodal(block).geometry.nodes
            if owner is not piece or nodes is None or not len(block):
                continue
            rows = elements - piece.starts[number]
            own = piece.rows[number]
            place = np.minimum(np.searchsorted(own, rows), len(own) - 1)
            here = own[place] == rows
            for side, corners in enumerate(SIDES[block.shape]):
                vertices = nodes[place[here & (sides == side)]][:, list(corners)]
                if len(vertices):
                    yield piece.numbers[vertices]

    def _read_variables(self, number: int) -> None:
        for piece in self._pieces:
            times = _times(piece.file)
            if not times:
                return
            time = times[checked_step(number, len(times), piece.file.path)]
            if self.time is not None and time != self.time:
                raise FormatError(f"expected the time {self.time}, found {time}", file=piece.file.path)
            self.time, piece.step = time, checked_step(number, len(times), piece.file.path)
        nodal, own = (self._names(f"name_{kind}_var") for kind in ("nod", "elem"))
        for name in nodal:
            values = [piece.nodal(name) for piece in self._pieces]
            by_piece = dict(zip(map(id, self._pieces), values, strict=True))
            pairs = zip(self._owners, self.blocks, strict=True)
            on_blocks = [(by_piece[id(owner)], self.nodal(block).geometry) for (owner, _), block in pairs]
            taken = [None if v is None else replace(each, values=v[:, None]) for v, each in on_blocks]
            self.add_field((name, "nodal"), [name], taken, is_continuous=True)
        for name in own:
            label = f"{name}_element" if name in nodal else name
            self.add_field((name, "element"), [label], [piece.own(name, at) for piece, at in self._owners])

    def _names(self, variable: str) -> list[str]:
        """The names that a variable of any file holds."""
        return list(dict.fromkeys(name for piece in self._pieces for name in piece.file.texts(variable)))


@dataclass(eq=False)
class _Piece:
    """A file: the whole of a state, or what one process wrote of it.

    places    (n, d) of the nodes
    numbers   (n,) of the nodes, over all files
    is_first  (m,) which of its elements no earlier file has
    blocks    of elements by number; ``rows`` of the file's block that they are, ``starts`` of these blocks
    lower     number of lines and points
    step      that is read
    """

    file: Variables
    places: Floats = field(init=False)
    precision: float = field(init=False)
    numbers: Ints = field(init=False)
    is_first: Bools = field(init=False)
    blocks: dict[int, Elements] = field(default_factory=dict)
    rows: dict[int, Ints] = field(default_factory=dict)
    starts: dict[int, int] = field(default_factory=dict)
    lower: int = 0
    step: int = 0

    def __post_init__(self) -> None:
        if "coord" in self.file:
            columns = list(self.file.floats("coord", dimension=2))
        else:
            columns = [self.file.floats(f"coord{axis}") for axis in "xyz" if f"coord{axis}" in self.file]
        if not 1 <= len(columns) <= 3 or len({len(column) for column in columns}) > 1:
            raise FormatError("expected coordinates of the nodes, found none", file=self.file.path)
        self.precision = SINGLE if columns[0].dtype.itemsize == 4 else DOUBLE
        self.places = np.stack(columns, axis=1).astype(np.float64)
        self.numbers = np.arange(len(self.places))
        self.is_first = np.ones(sum(len(self.file.ints(f"connect{i}", 2)) for i in self.file_blocks()), bool)

    def file_blocks(self) -> list[int]:
        """The numbers of the blocks that have elements."""
        numbers = range(1, self.file.size("num_el_blk") + 1)
        return [i for i in numbers if not _is_empty(self.file, f"connect{i}", f"num_el_in_blk{i}")]

    def ids(self, name: str) -> Ints | None:
        """Numbers of the nodes in the whole, in a variable of a name; None if the file has none for all."""
        found = self.file.ints(name) if name in self.file else None
        return found if found is not None and len(found) == len(self.places) else None

    def connectivity(self, number: int) -> tuple[Shape | None, Ints]:
        """The shape of a block's elements, None for lines and points, and their nodes (n, k)."""
        name = f"connect{number}"
        nodes, kind = self.file.ints(name, 2) - 1, self.file.element_type(name)
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(self.places):
            expected = f"nodes from 1 to {len(self.places)}"
            raise FormatError(f"expected {expected}, found others", file=self.file.path, place=name)
        return shape_of(kind, nodes.shape[1], self.file.path), nodes

    def sides(self, number: int) -> tuple[Ints, Ints]:
        """Elements (n,) and their sides (n,) in a set, without those of elements that an earlier file has."""
        elements, sides = self.file.ints(f"elem_ss{number}") - 1, self.file.ints(f"side_ss{number}") - 1
        if len(elements) != len(sides):
            expected = f"{len(elements)} sides"
            raise FormatError(f"expected {expected}, found {len(sides)}", file=self.file.path, place=f"ss{number}")
        is_known = (elements >= 0) & (elements < len(self.is_first))
        is_copy = is_known & ~self.is_first[np.where(is_known, elements, 0)]
        return elements[~is_copy], sides[~is_copy]

    def nodal(self, variable: str) -> Floats | None:
        """(n,) values of a variable at all nodes; None if the file doesn't have it."""
        names = self.file.texts("name_nod_var")
        if variable not in names:
            return None
        name = f"vals_nod_var{names.index(variable) + 1}"
        where = (name, self.step) if name in self.file else ("vals_nod_var", self.step, names.index(variable))
        found = np.asarray(self.file.floats(*where), np.float64)
        if found.shape != (len(self.places),):
            raise FormatError(f"expected {variable} at all nodes, found {found.shape}", file=self.file.path)
        return found

    def own(self, variable: str, number: int) -> NodalValues | None:
        """A variable on the elements of a block, None if it isn't there."""
        names = self.file.texts("name_elem_var")
        name = f"vals_elem_var{names.index(variable) + 1}eb{number}" if variable in names else ""
        if name not in self.file:
            return None
        found = np.asarray(self.file.floats(name, self.step), np.float64)
        count = len(self.file.ints(f"connect{number}", 2))
        if len(found) != count:
            expected = f"values on {count} elements"
            raise FormatError(f"expected {expected}, found {len(found)}", file=self.file.path, place=name)
        return NodalValues(found[self.rows[number], None, None], None)


def _marks(path: Path) -> re.Match[str]:
    """The marks in the name of a file; a name such as case.1.2 has none, as there is no process 2 of 1."""
    marks = _MARKS.fullmatch(path.name)
    assert marks is not None  # all of the name may be the stem
    if marks["count"] is None or int(marks["number"]) < int(marks["count"]):
        return marks
    stem = re.fullmatch(r"(?P<stem>.*)(?P<sequence>-s\d+)?(?P<count>)(?P<number>)", path.name)
    assert stem is not None
    return stem


def _process(path: Path) -> int:
    """The number of the process that wrote a file."""
    return int(_marks(path)["number"] or 0)


def _missing_processes(paths: Sequence[Path]) -> list[str]:
    """A sentence if the names tell that there are files of other processes."""
    count = max(int(_marks(path)["count"] or 1) for path in paths)
    if len(paths) == count:
        return []
    return [f"{len(paths)} of the {count} parts of a mesh by name: give all of them to see the whole"]


def _number_nodes(pieces: Sequence[_Piece]) -> None:
    """Number nodes over several files, by the numbers that these state or else by place; mark copies of elements."""
    if len(pieces) == 1:
        return
    stated = [piece.ids("node_num_map") for piece in pieces]
    numbers = [own for own in stated if own is not None]
    if len(numbers) < len(pieces) or not _are_shared(numbers, [piece.places for piece in pieces]):
        places = np.concatenate([np.pad(own.places, ((0, 0), (0, 3 - own.places.shape[1]))) for own in pieces])
        which = clusters(places, _TOGETHER * float(np.abs(places).max(initial=0)))
        numbers = np.split(which, np.cumsum([len(piece.places) for piece in pieces])[:-1])
    for piece, own in zip(pieces, numbers, strict=True):
        piece.numbers = own
    _mark_copies(pieces)


def _are_shared(numbers: Sequence[Ints], places: Sequence[Floats]) -> bool:
    """Whether several files have nodes of one number, and those lie at one place."""
    stacked, where = np.concatenate(numbers), np.concatenate(places)
    _, first, which = np.unique(stacked, return_index=True, return_inverse=True)
    off = np.abs(where - where[first][which.reshape(-1)]).max(initial=0)
    return len(first) < len(stacked) and bool(off <= _TOGETHER * np.abs(where).max(initial=0))


def _mark_copies(pieces: Sequence[_Piece]) -> None:
    """Mark the elements whose nodes are those of an earlier one."""
    by_width: dict[int, list[tuple[_Piece, int, Ints]]] = {}
    for piece in pieces:
        start = 0
        for number in piece.file_blocks():
            nodes = piece.connectivity(number)[1]
            by_width.setdefault(nodes.shape[1], []).append((piece, start, np.sort(piece.numbers[nodes], axis=1)))
            start += len(nodes)
    for tables in by_width.values():
        is_first = np.zeros(sum(len(nodes) for *_, nodes in tables), bool)
        is_first[distinct_bits(np.concatenate([nodes for *_, nodes in tables]))[0]] = True
        ends = np.cumsum([len(nodes) for *_, nodes in tables])[:-1]
        for (piece, start, nodes), own in zip(tables, np.split(is_first, ends), strict=True):
            piece.is_first[start : start + len(nodes)] = own


def _is_empty(file: Variables, name: str, dimension: str) -> bool:
    """Whether a block or a set has no entries; FormatError if it has some and the variable isn't there.

    netCDF knows no dimension of length 0, so the library writes neither the dimension nor the variable.
    """
    count = file.size(dimension)
    if count and name not in file:
        raise FormatError(f"expected {count} entries, found no variable", file=file.path, place=name)
    return name not in file


def _labels(file: Variables, what: str, noun: str) -> Callable[[int], str]:
    """Names of blocks or side sets by number: those of the file, else the noun with the id or the number."""
    names = file.texts(f"{what}_names")
    ids = file.ints(f"{what}_prop1").tolist() if f"{what}_prop1" in file else []

    def label(number: int) -> str:
        own = ids[number - 1] if number <= len(ids) else number
        name = names[number - 1] if number <= len(names) else ""
        return name or f"{noun} {own}"

    return label


class _Functions(NodalBasis):
    """The functions of the nodes of a type of elements; of serendipity ones where nodes are missing."""

    def __init__(self, shape: Shape, count: int) -> None:
        order = 1 if count == len(shape.vertices) else 2
        self._is_complete = count == space_size(shape, order, PyramidSpace.RATIONAL)
        super().__init__(shape, order, nodes_of(shape, count), PyramidSpace.RATIONAL)

    def space(self, points: Floats) -> Floats:
        """(n, count) values of a basis."""
        if self._is_complete:
            return super().space(points)
        if self.shape is Shape.PYRAMID:
            # Bedrosian, Shape functions and integration formulas for three-dimensional finite element analysis, 1992:
            # all functions but the biquadratic one of the base, which comes last
            return super().space(points)[:, :-1]
        return np.stack([np.prod(points**exponents, axis=1) for exponents in self._exponents()], axis=1)

    def _exponents(self) -> list[Ints]:
        """Monomials of superlinear degree 2 at most; on prisms the triangle's quadratic ones times linear ones too."""
        found = [np.array(e) for e in product(range(3), repeat=self.shape.dimension)]
        if self.shape is not Shape.PRISM:
            return [e for e in found if e[e > 1].sum() <= 2]
        inside = [e for e in found if e[0] + e[2] <= 2]
        return [e for e in inside if e[1] <= 1 or e[0] + e[2] <= 1]


def _times(file: Variables) -> list[float]:
    """The times of the steps, none where there are no variables."""
    return [float(time) for time in file.floats("time_whole")] if "time_whole" in file else []
