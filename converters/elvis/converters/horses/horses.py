"""Meshes, solutions and statistics of HORSES3D: values at Gauss or Gauss-Lobatto nodes, with orders of each element.

A mesh (.hmesh) holds the places of nodes, a solution or statistics (.hsol) values, whose nodes may be others.  The
names of boundaries stand in a .bmesh file, which is sought next to the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elvis.converters.horses.files import (
    MESH,
    MOMENTS,
    SOLUTIONS,
    STATISTICS,
    WITH_GRADIENTS,
    Header,
    Layout,
    Record,
    header_of,
    read_records,
    read_zones,
)
from elvis.converters.shared.inputs import by_kind, check_roles, check_rows
from elvis.converters.shared.unit import directed_sides
from elvis.core.base.arrays import Ints
from elvis.core.base.errors import FormatError
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, NodalValues, TensorBasis
from elvis.plugins.conversion.plugin import Boundary, Elements, Option, Reads

#: the direction -x, x, -y, y, -z, z of each side: front, back, bottom, right, top, left
_SIDES = np.array([2, 3, 4, 1, 5, 0])

#: families of nodes by number
_NODES = {1: gauss, 2: lobatto}

#: names of variables by equations
_VARIABLES = {
    "ns": ("rho", "rhou", "rhov", "rhow", "rhoe"),
    "nssa": ("rho", "rhou", "rhov", "rhow", "rhoe", "rhotheta"),
    "ins": ("rho", "rhou", "rhov", "rhow", "p"),
    "mu": ("c", "sqrtrhou", "sqrtrhov", "sqrtrhow", "p"),
    "ch": ("c",),
    "caa": ("rho", "u", "v", "w", "p"),
}

#: names of means in statistics
_MEANS = ("u", "v", "w", "uu", "vv", "ww", "uv", "uw", "vw")

#: the end of the name of a list of boundaries
_ZONES = ".bmesh"

#: heights that differ by less than this share of the largest are one
_LEVEL = 1e-12

#: names of the reference values
_REFERENCES = ("gamma", "R", "V", "rho", "T", "Mach")


class Horses(NodalConverter):
    """A mesh, with the solution or the statistics that go with it."""

    format = "HORSES3D meshes, solutions and statistics (.hmesh, .hsol), boundaries from .bmesh"
    keeps = "curved hexahedra of any orders, variables, gradients, viscosities, sources, sensors, means, time"
    loses = "files of the faces of a zone"
    reads = Reads(
        "hexahedra, quadrilaterals",
        "any, of each element and direction",
        "Gauss, Gauss-Lobatto",
        "`.bmesh`, by name",
        "numbered files",
        "one file",
        "by place",
        "no",
    )
    options = (
        Option(
            "equations",
            "Equation set that names the variables of HORSES3D; the files don't store it.",
            ("auto", *_VARIABLES),
            "auto",
        ),
    )

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether these are a mesh, a solution and a list of boundaries, at least one of the first two."""
        kinds = [_kind(path) for path in paths]
        return all(kinds) and ("mesh" in kinds or "solution" in kinds)

    @classmethod
    def hint(cls, path: Path) -> str:
        """Files of zones."""
        found = header_of(path)
        return "" if found is None else "values of HORSES3D on the faces of a zone: give a solution and its mesh"

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The time of the solution."""
        return [header.time for path in paths if _kind(path) == "solution" and (header := header_of(path)) is not None]

    def __init__(self, paths: Sequence[Path], equations: str = "auto") -> None:
        roles = by_kind(paths, _kind)
        check_roles(len(roles["mesh"]), len(roles["solution"]))
        (mesh,) = roles["mesh"]
        head = header_of(mesh)
        assert head is not None
        self.further_files = []
        _, places = read_records(mesh, head)
        values: list[Record] = places
        solution = roles["solution"][0] if roles["solution"] else None
        own = None if solution is None else header_of(solution)
        if solution is not None and own is not None:
            if own.elements != head.elements:
                expected = f"a solution on the {head.elements} elements of the mesh"
                raise FormatError(f"expected {expected}, found one on {own.elements}", file=solution)
            layout, values = read_records(solution, own)
        self.declared = Declared(head.elements)
        self._make_blocks(mesh, head, places, values)
        if own is not None:
            self._add_variables(own, layout, values, equations)
        self._add_boundaries(mesh, roles["zones"])

    def _make_blocks(self, path: Path, head: Header, places: list[Record], values: list[Record]) -> None:
        """A block for each combination of the numbers of nodes of the map and of the values."""
        keys = np.array([(*place.nodes, *value.nodes) for place, value in zip(places, values, strict=True)])
        if not len(keys):
            raise FormatError("expected elements, found none", file=path)
        flat = np.flatnonzero((keys[:, :3] == 1).all(axis=0) & (keys[:, 3:] == 1).all(axis=0))
        if len(flat) > 1 or (np.delete(keys[:, :3], flat, axis=1) == 1).any():
            raise FormatError("expected maps of order 1 or more in at least two directions, found others", file=path)

        self._axes = [axis for axis in range(3) if axis not in flat]
        self._shape = Shape.QUADRILATERAL if len(flat) else Shape.HEXAHEDRON
        space = self._space(places)
        distinct, which = np.unique(keys, axis=0, return_inverse=True)
        self._rows = [np.flatnonzero(which.reshape(-1) == number) for number in range(len(distinct))]
        self.blocks = []
        for key, rows in zip(distinct, self._rows, strict=True):
            nodes = np.array([places[row].arrays[0][:, :space] for row in rows])
            geometry = NodalValues(nodes, self._basis(head, key[:3]))
            self.blocks.append(Elements(self._shape, len(rows), geometry.order, ids=rows, key=NodalBlock(geometry)))

    def _space(self, places: list[Record]) -> int:
        """In how many dimensions elements lie: plane ones of one height in two."""
        heights = np.concatenate([place.arrays[0][:, 2] for place in places])
        is_level = float(np.ptp(heights)) <= _LEVEL * float(np.abs(heights).max())
        return 2 if is_level and self._shape is Shape.QUADRILATERAL else 3

    def _basis(self, head: Header, counts: Ints) -> TensorBasis:
        """The functions of nodes of one family, with ``counts`` in each direction."""
        return TensorBasis(self._shape, [_NODES[head.nodes](int(counts[axis]))[0] for axis in self._axes])

    def _add_variables(self, head: Header, layout: Layout, values: list[Record], equations: str) -> None:
        """The fields of a solution or of statistics."""
        for number, names in enumerate(self._names(head, layout, equations)):
            fields = []
            for rows in self._rows:
                nodes = np.array([values[row].arrays[number] for row in rows])
                fields.append(NodalValues(nodes, self._basis(head, np.array(values[rows[0]].nodes))))
            self.add_field(number, names, fields)
        if layout.has_sensor:
            sensors = [np.array([[[values[row].sensor]] for row in rows], np.float64) for rows in self._rows]
            self.add_field("sensor", ["sensor"], [NodalValues(own, None) for own in sensors])
        self.time = head.time
        own = zip(_REFERENCES, head.references, strict=True)
        self.metadata = {f"Reference {name}": f"{value:.15g}" for name, value in own if value}
        self.metadata |= {"Iteration": str(head.iteration)}

    def _names(self, head: Header, layout: Layout, equations: str) -> list[list[str]]:
        """The names of the variables of each array."""
        is_statistics = head.kind in STATISTICS
        first = layout.before[1] if is_statistics else layout.before[0]
        own = self._variables(head, first, equations)
        names = [list(own)]
        if head.kind in WITH_GRADIENTS:
            names += [[f"{name}_{axis}" for name in own] for axis in "xyz"]
        if is_statistics:
            if layout.before[0] != MOMENTS:
                raise FormatError(f"expected {MOMENTS} means of velocities, found {layout.before[0]}")
            return [[f"mean_{name}" for name in _MEANS], *([f"mean_{name}" for name in part] for part in names)]
        after = [["mu"], ["mu_sgs"]] if layout.after[:2] == (1, 1) else []
        if len(layout.after) > len(after):
            after.append([f"source_{name}" for name in own])
        return names + after

    def _variables(self, head: Header, count: int, equations: str) -> tuple[str, ...]:
        """The names of the variables of the requested equations, or of those that the reference values suggest.

        Raises FormatError if the equations have another number of variables.
        """
        if equations == "auto":
            gamma, _, _, density, _, _ = head.references
            by_count = {1: "ch", 5: "ns" if gamma else "ins" if density else "", 6: "nssa" if gamma else ""}
            equations = by_count.get(count, "")
            words = f"variables were named as those of the equations {equations}"
            if not equations:
                words = "the files don't name the equations, so variables were numbered"
            self.notes = [f"{words} (option equations)"]
            if not equations:
                return tuple(f"q{number + 1}" for number in range(count))
        if len(_VARIABLES[equations]) != count:
            expected = f"{len(_VARIABLES[equations])} variables of the equations {equations}"
            raise FormatError(f"expected {expected}, found {count} (option equations)")
        return _VARIABLES[equations]

    def _add_boundaries(self, mesh: Path, given: list[Path]) -> None:
        """The sides that a list names: the one that is given, or that lies next to the mesh."""
        beside = mesh.with_suffix(_ZONES)
        if not given and not beside.is_file():
            return
        path = given[0] if given else beside
        self.further_files = [path]
        block = np.empty(sum(map(len, self._rows)), np.int64)
        row = np.empty_like(block)
        for number, rows in enumerate(self._rows):
            block[rows], row[rows] = number, np.arange(len(rows))
        directions = [
            2 * self._axes.index(axis) + end if axis in self._axes else -1 for axis in range(3) for end in (0, 1)
        ]
        own = directed_sides(self._shape)
        for name, elements, sides in read_zones(path):
            numbers, local = np.array(elements, np.int64) - 1, np.array(sides, np.int64) - 1
            check_rows(numbers, len(block), "elements", 1, file=path)
            check_rows(local, len(_SIDES), "sides", 1, file=path)
            towards = np.array(directions)[_SIDES[local]]
            # the two sides across the flat direction are the elements themselves
            kept = towards >= 0
            found = []
            for number in range(len(self._rows)):
                here = kept & (block[numbers] == number)
                found.append((number, row[numbers[here]], own[towards[here]]))
            if kept.any():
                self.boundaries = [*self.boundaries, Boundary(name, sides=found)]


def _kind(path: Path) -> str:
    """``mesh``, ``solution`` or ``zones``; empty for any other file."""
    header = header_of(path)
    if header is None:
        return "zones" if path.suffix == _ZONES and path.is_file() else ""
    if header.kind == MESH:
        return "mesh"
    return "solution" if header.kind in (*SOLUTIONS, *STATISTICS) else ""
