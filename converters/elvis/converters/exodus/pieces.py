"""The files of an Exodus mesh, one a process, and the numbers of their nodes over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from elvis.converters.exodus.files import Variables, shape_of
from elvis.core.base.arrays import Bools, Floats, Ints, distinct_bits
from elvis.core.base.errors import FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalValues
from elvis.plugins.conversion.plugin import DOUBLE, SINGLE, Elements
from elvis.plugins.projection.vertices import clusters

#: nodes of several files that are as near as this, as a share of the largest coordinate, are one
_TOGETHER = 1e-10


@dataclass(eq=False)
class ExodusPiece:
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
        numbers = self.file.numbers("num_el_blk")
        return [i for i in numbers if not is_empty(self.file, f"connect{i}", f"num_el_in_blk{i}")]

    def ids(self, name: str) -> Ints | None:
        """Numbers of the nodes in the whole, in a variable of a name; None if the file has none for all."""
        found = self.file.ints(name) if name in self.file else None
        return found if found is not None and len(found) == len(self.places) else None

    def connectivity(self, number: int) -> tuple[Shape | None, Ints]:
        """The shape of a block's elements, None for lines and points, and their nodes (n, k)."""
        name = f"connect{number}"
        nodes = self.file.ints(name, 2) - 1
        shape = shape_of(self.file.element_type(name), nodes.shape[1], self.file.path)
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(self.places):
            expected = f"nodes from 1 to {len(self.places)}"
            raise FormatError(f"expected {expected}, found others", file=self.file.path, place=name)
        return shape, nodes

    def sides(self, number: int) -> tuple[Ints, Ints]:
        """Elements (n,) and their sides (n,) in a set, without elements that are copies of an earlier file's."""
        elements, sides = self.file.ints(f"elem_ss{number}") - 1, self.file.ints(f"side_ss{number}") - 1
        if len(elements) != len(sides):
            expected = f"{len(elements)} sides"
            raise FormatError(f"expected {expected}, found {len(sides)}", file=self.file.path, place=f"ss{number}")
        is_known = (elements >= 0) & (elements < len(self.is_first))
        is_copy = np.zeros(len(elements), bool)
        is_copy[is_known] = ~self.is_first[elements[is_known]]
        return elements[~is_copy], sides[~is_copy]

    def members(self, number: int, elements: Ints) -> tuple[Ints, Ints]:
        """The elements among some (n,) of the file that are in a block, and their rows there."""
        own, wanted = self.rows[number], elements - self.starts[number]
        if not len(own):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        place = np.minimum(np.searchsorted(own, wanted), len(own) - 1)
        here = np.flatnonzero(own[place] == wanted)
        return here, place[here]

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


def number_nodes(pieces: Sequence[ExodusPiece]) -> None:
    """Number nodes over several files, by the numbers that these state or else by place; mark copies of elements."""
    if len(pieces) == 1:
        return
    for piece in pieces[1:]:
        expected, found = (own.places.shape[1] for own in (pieces[0], piece))
        if found != expected:
            raise FormatError(f"expected {expected} coordinates as in the first, found {found}", file=piece.file.path)
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


def _mark_copies(pieces: Sequence[ExodusPiece]) -> None:
    """Mark the elements whose nodes equal the nodes of an earlier one."""
    by_width: dict[int, list[tuple[ExodusPiece, int, Ints]]] = {}
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


def is_empty(file: Variables, name: str, dimension: str) -> bool:
    """Whether a block or a set has no entries; raises FormatError if it has some and the variable isn't there.

    netCDF knows no dimension of length 0, so the library writes neither the dimension nor the variable.
    """
    count = file.size(dimension)
    if count and name not in file:
        raise FormatError(f"expected {count} entries, found no variable", file=file.path, place=name)
    return name not in file
