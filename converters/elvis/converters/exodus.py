"""Exodus II: meshes of orders 1 and 2 with values at nodes and on elements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from elvis.converters.exodus_files import SIDES, Variables, is_exodus, nodes_of, shape_of
from elvis.converters.inputs import STEP, single, step_number
from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.moments import checked_step
from elvis.core.shapes import Shape
from elvis.plugins.conversion import DOUBLE, SINGLE, Boundary, Elements, PyramidSpace
from elvis.plugins.declared import Declared
from elvis.plugins.nodal import NodalBasis, NodalBlock, NodalConverter, NodalValues, space_size


class Exodus(NodalConverter):
    """A mesh and its variables at one time."""

    format = "Exodus II (.e, .exo, .gen)"
    keeps = (
        "elements of orders 1 and 2, serendipity ones too, blocks and side sets by name, nodal and element variables"
    )
    loses = "node sets, attributes, variables of sides and sets; elements of lower dimension"
    needs = ("scipy",)
    options = (STEP,)
    beside = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether this is one file of netCDF with blocks of elements."""
        return len(paths) == 1 and is_exodus(paths[0])

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """Those of its variables."""
        return _times(Variables(single(paths)))

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        number = step_number(step)
        self._file = Variables(single(paths))
        self._places = self._coordinates()
        self._functions: dict[tuple[Shape, int], _Functions] = {}
        self._numbers: list[int] = []
        self._read_blocks()
        self.boundaries = self._side_sets()
        self._read_variables(number)

    def _coordinates(self) -> Floats:
        if "coord" in self._file:
            columns = list(self._file.floats("coord", dimension=2))
        else:
            columns = [self._file.floats(f"coord{axis}") for axis in "xyz" if f"coord{axis}" in self._file]
        if not 1 <= len(columns) <= 3 or len({len(column) for column in columns}) > 1:
            raise FormatError("expected coordinates of the nodes, found none", file=self._file.path)
        self.precision = SINGLE if columns[0].dtype.itemsize == 4 else DOUBLE
        return np.stack(columns, axis=1).astype(np.float64)

    def _read_blocks(self) -> None:
        """Blocks of the highest dimension, those without elements left out."""
        label, first = self._labels("eb", "block"), 0
        read: list[tuple[int, Elements]] = []
        lower = 0
        for number in range(1, self._file.size("num_el_blk") + 1):
            if self._is_empty(f"connect{number}", f"num_el_in_blk{number}"):
                continue
            shape, nodes = self._connectivity(number)
            if shape is None:
                lower += len(nodes)
            else:
                read.append((number, self._elements(shape, label(number), nodes, first)))
            first += len(nodes)
        dimension = max((block.shape.dimension for _, block in read), default=0)
        kept = [(number, block) for number, block in read if block.shape.dimension == dimension]
        self._numbers = [number for number, _ in kept]
        self.blocks = [block for _, block in kept]
        lower += sum(len(block) for _, block in read) - sum(map(len, self.blocks))
        self.declared = Declared(self._file.size("num_elem") or None, omitted={"elements of lower dimension": lower})

    def _is_empty(self, name: str, dimension: str) -> bool:
        """Whether a block or a set has no entries; FormatError if it has some and the variable isn't there.

        netCDF knows no dimension of length 0, so the library writes neither the dimension nor the variable.
        """
        count = self._file.size(dimension)
        if count and name not in self._file:
            raise FormatError(f"expected {count} entries, found no variable", file=self._file.path, place=name)
        return name not in self._file

    def _connectivity(self, number: int) -> tuple[Shape | None, Ints]:
        """The shape of a block's elements, None for lines and points, and their nodes (n, k)."""
        name = f"connect{number}"
        nodes, kind = self._file.ints(name, 2) - 1, self._file.element_type(name)
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(self._places):
            expected = f"nodes from 1 to {len(self._places)}"
            raise FormatError(f"expected {expected}, found others", file=self._file.path, place=name)
        return shape_of(kind, nodes.shape[1], self._file.path), nodes

    def _elements(self, shape: Shape, name: str, nodes: Ints, first: int) -> Elements:
        """Elements with nodes (n, k), numbered from ``first`` on over all blocks."""
        kind = (shape, nodes.shape[1])
        if kind not in self._functions:
            self._functions[kind] = _Functions(*kind)
        functions = self._functions[kind]
        return Elements(
            shape,
            len(nodes),
            functions.order,
            nodes[:, UNIT[shape].corners],
            ids=first + np.arange(len(nodes)),
            region=name,
            pyramid=PyramidSpace.RATIONAL,
            key=NodalBlock(NodalValues(self._places, functions, nodes)),
        )

    def _labels(self, what: str, noun: str) -> Callable[[int], str]:
        """Names of blocks or side sets by number: those of the file, else the noun with the id or the number."""
        names = self._file.texts(f"{what}_names")
        ids = self._file.ints(f"{what}_prop1").tolist() if f"{what}_prop1" in self._file else []

        def label(number: int) -> str:
            own = ids[number - 1] if number <= len(ids) else number
            name = names[number - 1] if number <= len(names) else ""
            return name or f"{noun} {own}"

        return label

    def _side_sets(self) -> list[Boundary]:
        """The side sets that have sides, whose numbers are declared."""
        label, boundaries, counts = self._labels("ss", "sides"), list[Boundary](), dict[str, int]()
        for number in range(1, self._file.size("num_side_sets") + 1):
            if self._is_empty(f"elem_ss{number}", f"num_side_ss{number}"):
                continue
            elements, sides = self._file.ints(f"elem_ss{number}") - 1, self._file.ints(f"side_ss{number}") - 1
            if len(elements) != len(sides):
                expected = f"{len(elements)} sides"
                raise FormatError(f"expected {expected}, found {len(sides)}", file=self._file.path, place=f"ss{number}")
            name = label(number)
            counts[name] = counts.get(name, 0) + len(elements)
            boundaries.append(Boundary(name, vertices=self._sides(elements, sides)))
        self.declared = replace(self.declared, sides=counts)
        return boundaries

    def _sides(self, elements: Ints, sides: Ints) -> list[Ints]:
        """Vertices of sides (n,) of elements (n,)."""
        vertices = []
        for block in self.blocks:
            nodes = self.nodal(block).geometry.nodes
            if nodes is None or block.ids is None or not len(block):
                continue
            rows = elements - int(block.ids[0])
            here = (rows >= 0) & (rows < len(nodes))
            for side, corners in enumerate(SIDES[block.shape]):
                own = nodes[rows[here & (sides == side)]][:, list(corners)]
                if len(own):
                    vertices.append(own)
        return vertices

    def _read_variables(self, number: int) -> None:
        times = _times(self._file)
        if not times:
            return
        number = checked_step(number, len(times), self._file.path)
        self.time = times[number]
        nodal, own = self._file.texts("name_nod_var"), self._file.texts("name_elem_var")
        for i, name in enumerate(nodal):
            found = self._nodal(i, number)
            if found.shape != (len(self._places),):
                raise FormatError(f"expected {name} at all nodes, found {found.shape}", file=self._file.path)
            geometries = [self.nodal(block).geometry for block in self.blocks]
            values = [replace(each, values=found[:, None]) for each in geometries]
            self.add_field((name, "nodal"), [name], values, is_continuous=True)
        for i, name in enumerate(own):
            label = f"{name}_element" if name in nodal else name
            self.add_field((name, "element"), [label], [self._own(i, each, number) for each in range(len(self.blocks))])

    def _nodal(self, index: int, step: int) -> Floats:
        name = f"vals_nod_var{index + 1}"
        where = (name, step) if name in self._file else ("vals_nod_var", step, index)
        return np.asarray(self._file.floats(*where), np.float64)

    def _own(self, index: int, block: int, step: int) -> NodalValues | None:
        """A variable on the elements of a block, where it has it."""
        name = f"vals_elem_var{index + 1}eb{self._numbers[block]}"
        if name not in self._file:
            return None
        found = np.asarray(self._file.floats(name, step), np.float64)
        count = len(self.blocks[block])
        if len(found) != count:
            expected = f"values on {count} elements"
            raise FormatError(f"expected {expected}, found {len(found)}", file=self._file.path, place=name)
        return NodalValues(found[:, None, None], None)


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
