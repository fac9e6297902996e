"""Exodus II: meshes of orders 1 and 2 with values at nodes and on elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from elvis.converters.exodus_files import CORNERS, SIDES, Variables, is_exodus, nodes_of, shape_of
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import ElvisError, FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion import DOUBLE, SINGLE, Boundary, Converter, Elements, Option, PyramidSpace, SourceField
from elvis.plugins.nodal import space_size, space_values


@dataclass(eq=False)
class _Part:
    """A block of the file: rows (n, k) of nodes, of elements from ``first`` on, counted over all blocks."""

    number: int
    shape: Shape
    name: str
    nodes: Ints
    first: int


class Exodus(Converter):
    """A mesh and its variables at one time."""

    format = "Exodus II (.e, .exo, .gen)"
    keeps = (
        "elements of orders 1 and 2, serendipity ones too, blocks and side sets by name, nodal and element variables"
    )
    loses = "node sets, attributes, variables of sides and sets; elements of lower dimension"
    needs = ("scipy",)
    options = (Option("step", "Which step of a series, counted from 0; the last by default."),)

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether this is one file of netCDF with blocks of elements."""
        return len(paths) == 1 and is_exodus(paths[0])

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        if step is not None and not step.lstrip("-").isdigit():
            raise ElvisError(f"expected a number for --step, found {step!r}")
        if len(paths) != 1:
            raise FormatError(f"expected one file, found {len(paths)}", file=paths[0])
        self._file = Variables(Path(paths[0]))
        self.notes: list[str] = []
        self._places = self._coordinates()
        self._parts = self._blocks()
        self._tables = {(p.shape, p.nodes.shape[1]): _Functions(p.shape, p.nodes.shape[1]) for p in self._parts}
        self.blocks = [self._elements(i, part) for i, part in enumerate(self._parts)]
        self.boundaries = self._side_sets()
        self.fields: list[SourceField] = []
        self._values: dict[tuple[str, int], Floats] = {}
        self._read_variables(step)

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The nodes, combined by their functions."""
        part = self._parts[block.key]
        table = self._tables[part.shape, part.nodes.shape[1]].at(points)
        return np.asarray(np.matmul(table, self._places[part.nodes[block.rows]]))

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """Values at nodes, combined likewise; values on elements as they are."""
        part = self._parts[block.key]
        if field.is_continuous:
            table = self._tables[part.shape, part.nodes.shape[1]].at(points)
            return np.asarray(self._values[field.key, -1][part.nodes[block.rows]] @ table.T)
        return np.repeat(self._values[field.key, part.number][block.rows, None], len(points), axis=1)

    def _coordinates(self) -> Floats:
        if "coord" in self._file:
            columns = list(self._file.floats("coord", dimension=2))
        else:
            columns = [self._file.floats(f"coord{axis}") for axis in "xyz" if f"coord{axis}" in self._file]
        if not 1 <= len(columns) <= 3 or len({len(column) for column in columns}) > 1:
            raise FormatError("expected coordinates of the nodes, found none", file=self._file.path)
        self.precision = SINGLE if columns[0].dtype.itemsize == 4 else DOUBLE
        return np.stack(columns, axis=1).astype(np.float64)

    def _blocks(self) -> list[_Part]:
        names, found, first, number = self._file.texts("eb_names"), [], 0, 1
        ids = self._file.ints("eb_prop1").tolist() if "eb_prop1" in self._file else []
        while f"connect{number}" in self._file:
            nodes = self._file.ints(f"connect{number}", 2) - 1
            kind = self._file.element_type(f"connect{number}")
            if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(self._places):
                expected = f"nodes from 1 to {len(self._places)}"
                raise FormatError(f"expected {expected}, found others", file=self._file.path, place=f"connect{number}")
            shape = shape_of(kind, nodes.shape[1], self._file.path)
            label = names[number - 1] if number <= len(names) else ""
            own = ids[number - 1] if number <= len(ids) else number
            if shape is not None:
                found.append(_Part(number, shape, label or f"block {own}", nodes, first))
            first, number = first + len(nodes), number + 1
        dimension = max((part.shape.dimension for part in found), default=0)
        kept = [part for part in found if part.shape.dimension == dimension]
        if len(kept) < number - 1:
            self.notes = [*self.notes, f"{number - 1 - len(kept)} blocks of lower dimension were left out"]
        return kept

    def _elements(self, key: int, part: _Part) -> Elements:
        corners = list(CORNERS.get(part.shape, range(len(part.shape.vertices))))
        order = self._tables[part.shape, part.nodes.shape[1]].order
        ids = part.first + np.arange(len(part.nodes))
        space = PyramidSpace.RATIONAL
        return Elements(part.shape, len(ids), order, part.nodes[:, corners], None, ids, part.name, space, key=key)

    def _side_sets(self) -> list[Boundary]:
        names, number, found = self._file.texts("ss_names"), 1, []
        ids = self._file.ints("ss_prop1").tolist() if "ss_prop1" in self._file else []
        while f"elem_ss{number}" in self._file:
            elements, sides = self._file.ints(f"elem_ss{number}") - 1, self._file.ints(f"side_ss{number}") - 1
            if len(elements) != len(sides):
                expected = f"{len(elements)} sides"
                raise FormatError(f"expected {expected}, found {len(sides)}", file=self._file.path, place=f"ss{number}")
            vertices = []
            for part in self._parts:
                rows = elements - part.first
                here = (rows >= 0) & (rows < len(part.nodes))
                for side, corners in enumerate(SIDES[part.shape]):
                    own = part.nodes[rows[here & (sides == side)]][:, list(corners)]
                    if len(own):
                        vertices.append(own)
            label = names[number - 1] if number <= len(names) else ""
            own_id = ids[number - 1] if number <= len(ids) else number
            found.append(Boundary(label or f"sides {own_id}", vertices=vertices))
            number += 1
        return found

    def _read_variables(self, step: str | None) -> None:
        times = self._file.floats("time_whole") if "time_whole" in self._file else np.empty(0)
        if not len(times):
            return
        number = -1 if step is None else int(step)
        if not -len(times) <= number < len(times):
            raise FormatError(f"expected a step below {len(times)}, found {step}", file=self._file.path)
        self.time = float(times[number])
        nodal, own = self._file.texts("name_nod_var"), self._file.texts("name_elem_var")
        for i, name in enumerate(nodal):
            found = self._nodal(i, number)
            if found.shape != (len(self._places),):
                raise FormatError(f"expected {name} at all nodes, found {found.shape}", file=self._file.path)
            self._values[name, -1] = found
            order = [self._tables[p.shape, p.nodes.shape[1]].order for p in self._parts]
            self.fields.append(SourceField(name, order, True, key=name))
        for i, name in enumerate(own):
            label = f"{name}_element" if name in nodal else name
            parts = [f"vals_elem_var{i + 1}eb{part.number}" for part in self._parts]
            orders = [0 if each in self._file else None for each in parts]
            for part, each in zip(self._parts, parts, strict=True):
                if each in self._file:
                    self._values[label, part.number] = self._own(each, number, len(part.nodes))
            self.fields.append(SourceField(label, orders, key=label))

    def _nodal(self, index: int, step: int) -> Floats:
        name = f"vals_nod_var{index + 1}"
        where = (name, step) if name in self._file else ("vals_nod_var", step, index)
        return np.asarray(self._file.floats(*where), np.float64)

    def _own(self, name: str, step: int, count: int) -> Floats:
        """(count,) values on the elements of a block."""
        found = np.asarray(self._file.floats(name, step), np.float64)
        if len(found) != count:
            expected = f"values on {count} elements"
            raise FormatError(f"expected {expected}, found {len(found)}", file=self._file.path, place=name)
        return found


class _Functions:
    """The functions of the nodes of a type of elements; of serendipity ones where nodes are missing.

    order  of the least complete space that holds them
    """

    def __init__(self, shape: Shape, count: int) -> None:
        self.shape = shape
        self.order = 1 if count == len(shape.vertices) else 2
        self._is_complete = count == space_size(shape, self.order, PyramidSpace.RATIONAL)
        self._inverse = np.linalg.inv(self._space(nodes_of(shape, count)))

    def at(self, points: Floats) -> Floats:
        """(n, count) values at points (n, d) of our reference element."""
        return np.asarray(self._space(points) @ self._inverse)

    def _space(self, points: Floats) -> Floats:
        """(n, count) values of a basis."""
        if self._is_complete:
            return space_values(self.shape, self.order, points, PyramidSpace.RATIONAL)
        if self.shape is Shape.PYRAMID:
            # Bedrosian, Shape functions and integration formulas for three-dimensional finite element analysis, 1992:
            # all functions but the biquadratic one of the base, which comes last
            return space_values(self.shape, self.order, points, PyramidSpace.RATIONAL)[:, :-1]
        return np.stack([np.prod(points**exponents, axis=1) for exponents in self._exponents()], axis=1)

    def _exponents(self) -> list[Ints]:
        """Monomials of superlinear degree 2 at most; on prisms the triangle's quadratic ones times linear ones too."""
        found = [np.array(e) for e in product(range(3), repeat=self.shape.dimension)]
        if self.shape is not Shape.PRISM:
            return [e for e in found if e[e > 1].sum() <= 2]
        inside = [e for e in found if e[0] + e[2] <= 2]
        return [e for e in inside if e[1] <= 1 or e[0] + e[2] <= 1]
