"""Exodus II: meshes of orders 1 and 2 with values at nodes and on elements, in one file or one a process."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from elvis.converters.exodus.files import SIDES, Variables, is_exodus, nodes_of
from elvis.converters.exodus.pieces import ExodusPiece, is_empty, number_nodes
from elvis.converters.exodus.shells import FACES_OF_SHELLS, plane_sides
from elvis.converters.shared.incomplete import CentredPyramid, NodalFunctions, bubble_space
from elvis.converters.shared.inputs import STEP, step_number
from elvis.converters.shared.unit import UNIT, side_numbers
from elvis.core.base.arrays import Floats, Ints, joined_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import (
    NodalBasis,
    NodalBlock,
    NodalConverter,
    NodalValues,
    ShapeFunctions,
    space_size,
)
from elvis.plugins.conversion.plugin import Boundary, Elements, PyramidSpace, Reads

#: End of a file's name: the number of a mesh in a sequence of meshes, then the number of processes that wrote the files
#: of a state, and the number of the one that wrote this file
_MARKS = re.compile(r"(?P<stem>.*?)(?P<sequence>-s\d+)?(?:\.(?P<count>\d+)\.(?P<number>\d+))?", re.DOTALL)

#: elements with nodes in the middle of triangles, and whether tetrahedra and prisms have one inside
_WITH_BUBBLES = {
    (Shape.TRIANGLE, 7): True,
    (Shape.TETRAHEDRON, 14): False,
    (Shape.TETRAHEDRON, 15): True,
    (Shape.PYRAMID, 18): True,
    (Shape.PRISM, 20): False,
    (Shape.PRISM, 21): True,
}
#: the pyramid with a node inside, whose functions are products of powers of collapsed coordinates
_CENTRED_PYRAMID = (Shape.PYRAMID, 19)
#: degree of the function that is 1 inside a tetrahedron and 0 on its faces
_INSIDE_TETRAHEDRON = 4


class Exodus(NodalConverter):
    """A mesh and its variables at one time, in one file or in one a process."""

    format = "Exodus II (.e, .exo, .gen, .e.4.0, .e-s002)"
    keeps = (
        "elements of orders 1 and 2, also serendipity elements and elements with bubbles, blocks and side sets by "
        "name, nodal and element variables"
    )
    loses = "node sets, attributes, variables of sides and sets; elements of lower dimension"
    reads = Reads(
        "all",
        "1, 2, serendipity, bubbles",
        "nodal, constant",
        "side sets by name",
        "times of one file, `-s002` files",
        "`.e.4.0` of each process",
        "by place",
        "no",
    )
    needs = ("scipy",)
    options = (STEP,)
    further_files = ()

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
        """The times of the variables, which all files of a state share."""
        return _times(Variables(paths[0]))

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        number = step_number(step)
        self._functions: dict[tuple[Shape, int], ShapeFunctions] = {}
        self._pieces = [ExodusPiece(Variables(path)) for path in sorted(paths, key=_process)]
        number_nodes(self._pieces)
        self.precision = max(piece.precision for piece in self._pieces)
        self._read_blocks()
        self.warnings = _missing_processes(paths)
        self.boundaries = self._side_sets()
        self._read_variables(number)

    def _read_blocks(self) -> None:
        """Blocks of the highest dimension; elements of lower dimension are counted."""
        first = 0
        for piece in self._pieces:
            first = self._read_piece(piece, first)
        read = [(piece, number, block) for piece in self._pieces for number, block in piece.blocks.items()]
        dimension = max((block.shape.dimension for *_, block in read), default=0)
        kept = [each for each in read if each[2].shape.dimension == dimension]
        self._owners = [(piece, number) for piece, number, _ in kept]
        self.blocks = _joined_by_place([block for *_, block in kept])
        lower = sum(piece.lower for piece in self._pieces) + sum(len(block) for *_, block in read)
        lower -= sum(map(len, self.blocks))
        copies = sum(int((~piece.is_first).sum()) for piece in self._pieces)
        stated = [piece.file.size("num_elem") for piece in self._pieces]
        total = sum(stated) - copies if all(stated) else None
        self.declared = Declared(total, omitted={"elements of lower dimension": lower})

    def _read_piece(self, piece: ExodusPiece, first: int) -> int:
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

    def _elements(self, piece: ExodusPiece, shape: Shape, name: str, nodes: Ints, ids: Ints) -> Elements:
        """Elements with nodes (n, k) of a file."""
        kind = (shape, nodes.shape[1])
        if kind not in self._functions:
            self._functions[kind] = _functions_of(*kind)
        functions = self._functions[kind]
        return Elements(
            shape,
            len(nodes),
            functions.order,
            piece.numbers[nodes[:, UNIT[shape].corners]],
            ids=ids,
            region=name,
            pyramid=PyramidSpace.TENSOR if kind == _CENTRED_PYRAMID else PyramidSpace.RATIONAL,
            key=NodalBlock(NodalValues(piece.places, functions, nodes)),
        )

    def _side_sets(self) -> list[Boundary]:
        """The side sets that have sides, whose numbers are declared."""
        found: dict[tuple[int, str], Boundary] = {}
        counts: dict[str, int] = {}
        for piece in self._pieces:
            label = _labels(piece.file, "ss", "sides")
            firsts, warnings = plane_sides(piece)
            self.warnings = [*self.warnings, *warnings]
            for number in piece.file.numbers("num_side_sets"):
                if is_empty(piece.file, f"elem_ss{number}", f"num_side_ss{number}"):
                    continue
                elements, sides = piece.sides(number)
                name = label(number)
                counts[name] = counts.get(name, 0) + len(elements)
                own = found.setdefault((number, name), Boundary(name))
                found[number, name] = Boundary(
                    name,
                    [*own.vertices, *self._faces_of_shells(piece, elements, sides)],
                    [*own.sides, *self._sides(piece, firsts, elements, sides)],
                )
        self.declared = replace(self.declared, sides=counts)
        return list(found.values())

    def _sides(
        self, piece: ExodusPiece, firsts: Mapping[int, int], elements: Ints, sides: Ints
    ) -> Iterator[tuple[int, Ints, Ints]]:
        """Blocks, elements and their local sides, for sides (n,) of elements (n,) of a file.

        firsts  for each block of plane elements, the first edge among their sides
        """
        for at, ((owner, number), block) in enumerate(zip(self._owners, self.blocks, strict=True)):
            if owner is not piece or not len(block):
                continue
            here, rows = piece.members(number, elements)
            first = firsts.get(number, 0)
            local = side_numbers(block.shape, SIDES[block.shape])
            is_side = (sides[here] >= first) & (sides[here] < first + len(local))
            if is_side.any():
                yield at, rows[is_side], local[sides[here][is_side] - first]

    def _faces_of_shells(self, piece: ExodusPiece, elements: Ints, sides: Ints) -> Iterator[Ints]:
        """Vertices of the faces of shells that are sides of a mesh of volumes."""
        if not any(block.shape.dimension == 3 for block in self.blocks):
            return
        for number, block in piece.blocks.items():
            if block.shape.dimension == 2 and block.vertices is not None:
                here, rows = piece.members(number, elements)
                vertices = block.vertices[rows[sides[here] < FACES_OF_SHELLS]]
                if len(vertices):
                    yield vertices

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


def _joined_by_place(blocks: Sequence[Elements]) -> list[Elements]:
    """The blocks, without numbers of vertices where every element has nodes of its own.

    Programs write discontinuous fields so; elements that lie together are neighbours nonetheless.
    """
    corners = [block.vertices.reshape(-1) for block in blocks if block.vertices is not None]
    every = joined_ints(corners)
    if sum(map(len, blocks)) < 2 or len(np.unique(every)) < len(every):
        return list(blocks)
    return [replace(block, vertices=None) for block in blocks]


def _marks(path: Path) -> re.Match[str]:
    """The marks in the name of a file; a name such as case.1.2 has none, since process 2 of 1 cannot exist."""
    marks = _MARKS.fullmatch(path.name)
    assert marks is not None  # all of the name may be the stem
    if marks["count"] is None or int(marks["number"]) < int(marks["count"]):
        return marks
    stem = re.fullmatch(r"(?P<stem>.*)(?P<sequence>-s\d+)?(?P<count>)(?P<number>)", path.name, re.DOTALL)
    assert stem is not None
    return stem


def _process(path: Path) -> int:
    """The number of the process that wrote a file."""
    return int(_marks(path)["number"] or 0)


def _missing_processes(paths: Sequence[Path]) -> list[str]:
    """A message if the names show that files of other processes exist."""
    count = max(int(_marks(path)["count"] or 1) for path in paths)
    if len(paths) == count:
        return []
    return [f"{len(paths)} of the {count} parts of a mesh by name: give all of them for the complete mesh"]


def _labels(file: Variables, what: str, noun: str) -> Callable[[int], str]:
    """Names of blocks or side sets by number: the names in the file, or else the noun with the id or the number."""
    names = file.texts(f"{what}_names")
    ids = file.ints(f"{what}_prop1").tolist() if f"{what}_prop1" in file else []

    def label(number: int) -> str:
        own = ids[number - 1] if number <= len(ids) else number
        name = names[number - 1] if number <= len(names) else ""
        return name or f"{noun} {own}"

    return label


def _functions_of(shape: Shape, count: int) -> ShapeFunctions:
    """The functions of a type of elements."""
    if (shape, count) == _CENTRED_PYRAMID:
        return CentredPyramid(nodes_of(shape, count)[:-1])
    if (shape, count) not in _WITH_BUBBLES:
        return _Functions(shape, count)
    is_whole = _WITH_BUBBLES[shape, count]
    order = _INSIDE_TETRAHEDRON if shape is Shape.TETRAHEDRON and is_whole else 3
    return NodalFunctions(order, lambda points: bubble_space(shape, is_whole, points), nodes_of(shape, count))


class _Functions(NodalBasis):
    """The functions of the nodes of a type of elements; for serendipity elements, of nodes that exist."""

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
        """Monomials of superlinear degree 2 at most; on prisms also the triangle's quadratic ones times linear ones."""
        found = [np.array(e) for e in product(range(3), repeat=self.shape.dimension)]
        if self.shape is not Shape.PRISM:
            return [e for e in found if e[e > 1].sum() <= 2]
        inside = [e for e in found if e[0] + e[2] <= 2]
        return [e for e in inside if e[1] <= 1 or e[0] + e[2] <= 1]


def _times(file: Variables) -> list[float]:
    """The times of the steps, none if there are no variables."""
    return [float(time) for time in file.floats("time_whole")] if "time_whole" in file else []
