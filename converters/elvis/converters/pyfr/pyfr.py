"""PyFR meshes and solutions (.pyfrm, .pyfrs): HDF5 files that describe themselves.

Elements hold nodes at their shape points, solutions values at their solution points; both points are in the files.
Layout: PyFR documentation, file format, version 1 (PyFR 2.1 and later); older files: `elvis.converters.pyfr.old`.
"""

from __future__ import annotations

import configparser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.converters.pyfr import old as pyfr_old
from elvis.converters.pyfr.old import Values
from elvis.converters.shared.hdf5 import floats, holds, ints, reading, require, texts
from elvis.converters.shared.inputs import check_roles, check_rows
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.shapes import Shape
from elvis.formats.nektar.hdf5_checks import check_attribute
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import (
    NodalBasis,
    NodalBlock,
    NodalConverter,
    NodalValues,
    native_points,
    nearest_nodes,
    order_of_space,
)
from elvis.plugins.conversion.plugin import DOUBLE, SINGLE, Boundary, Elements, Option, PyramidSpace, Reads, SourceField

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_BASE = tuple((x, y, -1) for x, y in _SQUARE)

#: by type of element: our shape; its reference vertices in our order; our local face for each of the file's
_KINDS: dict[str, tuple[Shape, tuple[tuple[int, ...], ...], tuple[int, ...]]] = {
    "quad": (Shape.QUADRILATERAL, _SQUARE, (0, 1, 2, 3)),
    "tri": (Shape.TRIANGLE, ((-1, -1), (1, -1), (-1, 1)), (0, 1, 2)),
    "hex": (Shape.HEXAHEDRON, (*_BASE, *((x, y, 1) for x, y in _SQUARE)), (0, 1, 2, 3, 4, 5)),
    "pri": (
        Shape.PRISM,
        ((-1, -1, -1), (-1, 1, -1), (-1, 1, 1), (-1, -1, 1), (1, -1, -1), (1, -1, 1)),
        (1, 3, 4, 2, 0),
    ),
    "pyr": (Shape.PYRAMID, (*_BASE, (0, 0, 1)), (0, 1, 2, 3, 4)),
    "tet": (Shape.TETRAHEDRON, ((-1, -1, -1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)), (0, 1, 3, 2)),
}

#: orders that derived quantities get above the solution's, for they are not polynomials; the highest of a solution
_DERIVED, _HIGHEST = 2, 30


#: name in messages for data that are in no file
_RUNNING = "a running solver"


@dataclass(frozen=True, eq=False)
class RunState:
    """The solution of a running solver on all elements.

    names   of the variables
    values  by kind of element: points (m, d) in PyFR's coordinates, and values (n, variables, m) there, elements in the
            order of the mesh file
    config  the text of the solver's configuration
    """

    names: Sequence[str]
    values: Mapping[str, tuple[Floats, Floats]]
    config: str


class PyFR(NodalConverter):
    """A mesh, with the solution that goes with it."""

    format = "PyFR mesh and solution (.pyfrm, .pyfrs)"
    keeps = "curved elements of all shapes and orders, boundaries, all variables, time; also time averages"
    loses = "partitionings, statistics, the configuration but for its name"
    reads = Reads(
        "all",
        "any",
        "nodal, at points in the file",
        "by name",
        "numbered files",
        "one file",
        "no",
        "no",
    )
    options = (
        Option("primitive", "Add velocity and pressure, derived from the conservative variables.", None),
        Option("subset", "Convert only the elements of a solution that covers part of the mesh.", None),
    )
    #: what `take` takes
    state = RunState

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file is a PyFR mesh or solution."""
        return all(_is_mesh(path) or _is_solution(path) for path in paths)

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The time of the solution, if it has one."""
        _, solution = _roles(paths)
        if solution is None:
            return ()
        with reading(solution) as file:
            time = _time(_ini(file, "stats"))
        return () if time is None else [time]

    def __init__(self, paths: Sequence[Path], primitive: bool = False, subset: bool = False) -> None:
        mesh, solution = _roles(paths)
        # old ones are read with tables of PyFR's own
        self.further_files = None if _is_old(mesh) else [mesh]
        self._kinds: list[str] = []
        self._config: str | None = None
        self._bases: dict[tuple[str, bytes], NodalBasis] = {}
        self.blocks: list[Elements] = []
        with reading(mesh) as file:
            (self._read_old_mesh if _is_old(mesh) else self._read_mesh)(file)
            self.declared = _declared(file)
        if solution is not None:
            with reading(solution) as file:
                _check_uuid(file, _uuid(mesh), mesh)
                self._read_solution(file, primitive, subset)
        elif primitive or subset:
            raise ElvisError("expected a solution for the options primitive and subset, found none")

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """Interpolation through the solution points; derived quantities are computed from interpolated ones."""
        if not isinstance(field.key, str):
            return super().sample(block, field, points)
        own = self.nodal(block).fields["solution"]
        conserved = {name: own.component(i, block.rows, points) for i, name in enumerate(self._names)}
        return _derive(field.name, conserved, self._gamma)

    def _read_mesh(self, file: h5py.File) -> None:
        nodes = require(file, "nodes")
        places = np.asarray(nodes["location"], np.float64)
        if places.ndim != 2 or places.shape[1] not in (2, 3):
            raise FormatError(f"expected positions, found numbers of shape {places.shape}", place="nodes")
        self.precision = SINGLE if nodes.dtype["location"].base == np.float32 else DOUBLE
        links: dict[str, Ints] = {}
        for kind in sorted(file["eles"]):
            data = require(file, f"eles/{kind}")
            numbers = np.asarray(data["nodes"], np.int64)
            check_rows(numbers, len(places), "nodes", file=file.filename)
            self._add(file, kind, partial(_points, data), places, numbers)
            links[kind] = np.asarray(data["faces"]["cidx"], np.int64)
        self.boundaries = self._boundaries(texts(file, "codec"), links)

    def _read_old_mesh(self, file: h5py.File) -> None:
        for kind, nodes in pyfr_old.arrays(file, "spt").items():
            points_of = partial(pyfr_old.shape_points, kind, len(nodes), file.filename)
            self._add(file, kind, points_of, nodes.transpose(1, 0, 2))
        if len({self.nodal(block).geometry.values.shape[2] for block in self.blocks}) != 1:
            raise FormatError("expected elements of one dimension, found others or none", file=file.filename)
        self.boundaries = [Boundary(name, sides=self._sides(own)) for name, own in pyfr_old.sides(file).items()]

    def _add(
        self, file: h5py.File, kind: str, points_of: Callable[[], Floats], places: Floats, nodes: Ints | None = None
    ) -> None:
        """A block of elements of a kind: places (m, d) of nodes (n, k) that they share, else places (n, k, d)."""
        if kind not in _KINDS:
            raise FormatError(f"expected elements {', '.join(_KINDS)}, found {kind}", file=file.filename)
        shape, frame, _ = _KINDS[kind]
        points = native_points(shape, np.array(frame, float), points_of())
        order = _order(shape, len(points), file.filename)
        own = places if nodes is None else nodes
        if own.ndim < 2 or own.shape[1] != len(points) or (nodes is not None and own.ndim > 2):
            raise FormatError(f"expected {len(points)} nodes an element, found {own.shape[1:]}", place=kind)
        vertices = None if nodes is None else nodes[:, nearest_nodes(points, shape.vertices)]
        block = NodalBlock(NodalValues(places, NodalBasis(shape, order, points), nodes))
        space = PyramidSpace.POLYNOMIAL
        self.blocks.append(Elements(shape, len(own), order, vertices, pyramid=space, key=block))
        self._kinds.append(kind)

    def _sides(self, pairs: Mapping[str, Ints]) -> list[tuple[int, Ints, Ints]]:
        """Sides (n, 2) by kind, an element's row and a face of the file's, as our blocks have them."""
        found = []
        for i, kind in enumerate(self._kinds):
            if kind in pairs:
                rows, faces = pairs[kind].T
                found.append((i, rows, np.array(_KINDS[kind][2])[faces]))
        return found

    def _boundaries(self, codec: Sequence[str], links: dict[str, Ints]) -> list[Boundary]:
        """Faces by what the codec says that they are connected to."""
        result = []
        for number, name in enumerate(codec):
            if name.startswith("bc/"):
                own = {kind: np.argwhere(cidx == number) for kind, cidx in links.items()}
                result.append(Boundary(name.removeprefix("bc/"), sides=self._sides(own)))
        return result

    def _read_solution(self, file: h5py.File, primitive: bool, subset: bool) -> None:
        stats, config = _ini(file, "stats"), _ini(file, "config")
        prefix = stats.get("data", "prefix", fallback="soln")
        names = [name.strip() for name in stats.get("data", "fields", fallback="").split(",")]
        found = pyfr_old.values(file, prefix, config) if "mesh_uuid" in file else _values(file, prefix)
        total = sum(map(len, self.blocks))
        values = self._add_solution(names, found, file.filename)
        missing = total - sum(map(len, self.blocks))
        if missing and not subset:
            expected = f"values on all {total} elements of the mesh"
            raise FormatError(
                f"expected {expected}, found none on {missing}; see the option subset", file=file.filename
            )
        if primitive:
            orders = [None if own is None else own.order for own in values]
            self._gamma = config.getfloat("constants", "gamma", fallback=1.4)
            self.fields = [*self.fields, *_primitive(self._names, orders, file.filename)]
        self.time = _time(stats)
        self.metadata = {"Program": _text(file, "creator") if "creator" in file else "PyFR"}
        self.metadata |= _constants(config)
        self.declared = Declared(self.declared.elements, omitted={"elements without a solution": missing})

    def take(self, state: RunState) -> None:
        """Replace the data by the solution of a running solver; raises FormatError if it does not fit."""
        self.clear_fields()
        if state.values.keys() != set(self._kinds):
            wanted, kinds = ", ".join(self._kinds), ", ".join(state.values)
            raise FormatError(f"expected values on elements {wanted}, found those on {kinds}", file=_RUNNING)
        found = {kind: Values(kind, *own) for kind, own in state.values.items()}
        self._add_solution(state.names, found, _RUNNING)
        if self._config != state.config:
            self._config, self.metadata = state.config, _running(state.config)

    def _add_solution(self, names: Sequence[str], found: Mapping[str, Values], file: str) -> list[NodalValues | None]:
        """The fields of a solution; elements without values are dropped."""
        self._names = list(names)
        values: list[NodalValues | None] = []
        for index, kind in enumerate(self._kinds):
            values.append(self._take(file, found[kind], index) if kind in found else None)
            if kind not in found:
                self._keep(index, np.empty(0, np.int64))
        self.add_field("solution", self._names, values)
        return values

    def _take(self, file: str, found: Values, index: int) -> NodalValues:
        """The values on a block, which loses the elements that have none."""
        block = self.blocks[index]
        rows = np.arange(len(block)) if found.rows is None else found.rows
        wanted = (len(rows), len(self._names), len(found.points))
        if found.values.shape != wanted or rows.max(initial=-1) >= len(block):
            expected = f"{wanted} values on {len(block)} elements"
            raise FormatError(f"expected {expected}, found {found.values.shape}", file=file, place=found.place)
        if found.rows is not None:
            self._keep(index, rows)
        return NodalValues(np.moveaxis(found.values, 1, 2), self._basis(self._kinds[index], found.points, file))

    def _basis(self, kind: str, places: Floats, file: str) -> NodalBasis:
        """The functions of solution points (n, d) of a kind.

        Cached, because a running solver has the same ones at each step.
        """
        key = kind, places.tobytes()
        if key not in self._bases:
            shape, frame, _ = _KINDS[kind]
            points = native_points(shape, np.array(frame, float), places)
            self._bases[key] = NodalBasis(shape, _order(shape, len(points), file), points)
        return self._bases[key]

    def _keep(self, index: int, rows: Ints) -> None:
        """Only the elements ``rows`` of a block."""
        block = self.blocks[index]
        geometry = self.nodal(block).geometry
        if geometry.nodes is None:
            kept = replace(geometry, values=geometry.values[rows])
        else:
            kept = replace(geometry, nodes=geometry.nodes[rows])
        place = np.full(len(block), -1)
        place[rows] = np.arange(len(rows))
        self.boundaries = [_restrict(boundary, index, place) for boundary in self.boundaries]
        self.blocks[index] = replace(block.take(rows), key=NodalBlock(kept), rows=slice(None))


def _declared(file: h5py.File) -> Declared:
    """The number of elements in all tables, and of faces that are connected to each boundary."""
    if "mesh_uuid" in file:
        counts = {name: sum(map(len, own.values())) for name, own in pyfr_old.sides(file).items()}
        return Declared(sum(nodes.shape[1] for nodes in pyfr_old.arrays(file, "spt").values()), counts)
    links = [np.asarray(require(file, f"eles/{kind}")["faces"]["cidx"]) for kind in file["eles"]]
    sides = {
        name.removeprefix("bc/"): sum(int(np.count_nonzero(own == number)) for own in links)
        for number, name in enumerate(texts(file, "codec"))
        if name.startswith("bc/")
    }
    return Declared(sum(map(len, links)), sides)


def _running(config: str) -> dict[str, str]:
    """The metadata of a running solver with a configuration."""
    return {"Program": "PyFR", **_constants(_parsed(config, _RUNNING, "config"))}


def _points(data: h5py.Dataset) -> Floats:
    """(n, d) the points that an attribute of a dataset holds."""
    check_attribute(data, "pts")
    points = np.asarray(data.attrs["pts"], np.float64)
    if points.ndim != 2 or not len(points) or not np.isfinite(points).all():
        raise FormatError(f"expected points, found numbers of shape {points.shape}", place=data.name)
    return points


def _values(file: h5py.File, prefix: str) -> dict[str, Values]:
    """The values of a solution, by kind of element."""
    found = {}
    for name in file.get(prefix, ()):
        if name.count("-") == 1:
            place = f"{prefix}/{name}"
            own = ints(file, f"{place}-idxs", None) if f"{place}-idxs" in file else None
            values = floats(file, place, None, None, None)
            found[name.split("-")[1]] = Values(place, _points(file[place]), values, own)
    return found


def _restrict(boundary: Boundary, index: int, place: Ints) -> Boundary:
    """The sides of a boundary; sides of block ``index`` only if ``place`` (n,) gives a new row."""
    sides = []
    for i, rows, faces in boundary.sides:
        new = place[rows] if i == index else rows
        sides.append((i, new[new >= 0], faces[new >= 0]))
    return Boundary(boundary.name, sides=sides)


def _text(file: h5py.File, name: str) -> str:
    """A dataset that is one string."""
    found = texts(file, name)
    if len(found) != 1:
        raise FormatError(f"expected one string, found {len(found)}", place=name)
    return found[0]


def _is_mesh(path: Path) -> bool:
    return holds(path, "eles", "nodes", "codec", "mesh-uuid") or (_is_old(path) and not holds(path, "stats"))


def _is_solution(path: Path) -> bool:
    return holds(path, "stats", "config", "mesh-uuid") or (_is_old(path) and holds(path, "stats", "config"))


def _is_old(path: Path) -> bool:
    return holds(path, "mesh_uuid")


def _roles(paths: Sequence[Path]) -> tuple[Path, Path | None]:
    """The mesh and the solution, which refers to its mesh only by a code.

    Raises FormatError unless there is one mesh.
    """
    meshes, solutions = [p for p in paths if _is_mesh(p)], [p for p in paths if _is_solution(p)]
    if not meshes and len(solutions) == 1:
        meshes = [path for path in sorted(solutions[0].parent.glob("*.pyfrm")) if _uuid(path) == _uuid(solutions[0])]
        if not meshes:
            raise FormatError(
                "expected its mesh (.pyfrm) next to it, found none; also give the mesh", file=solutions[0]
            )
        meshes = meshes[:1]
    check_roles(len(meshes), len(solutions))
    return meshes[0], solutions[0] if solutions else None


def _time(stats: configparser.ConfigParser) -> float | None:
    """The time in the statistics of a solution."""
    time = stats.get("solver-time-integrator", "tcurr", fallback=None)
    return None if time is None else float(time)


def _uuid(path: Path) -> str:
    """The code of a mesh, or of a solution's mesh; empty without one."""
    for name in ("mesh-uuid", "mesh_uuid"):
        if holds(path, name):
            with reading(path) as file:
                return _text(file, name)
    return ""


def _check_uuid(file: h5py.File, uuid: str, mesh: Path) -> None:
    own = _text(file, "mesh_uuid" if "mesh_uuid" in file else "mesh-uuid")
    if own != uuid:
        raise FormatError(
            f"expected a solution on the mesh {mesh.name} ({uuid}), found one on {own}", file=file.filename
        )


def _ini(file: h5py.File, name: str) -> configparser.ConfigParser:
    """A record of the file that is an INI file."""
    return _parsed(_text(file, name), file.filename, name)


def _parsed(text: str, file: str, place: str) -> configparser.ConfigParser:
    """The text of an INI file."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    try:
        parser.read_string(text)
    except configparser.Error as error:
        reason = " ".join(str(error).split())
        raise FormatError(f"expected sections of keys and values, found: {reason}", file=file, place=place) from None
    return parser


def _order(shape: Shape, count: int, file: str) -> int:
    """The order of a complete space of this many functions."""
    order = order_of_space(shape, count, _HIGHEST)
    if order is None:
        raise FormatError(f"expected the points of a {shape.label.lower()} of some order, found {count}", file=file)
    return order


def _primitive(names: Sequence[str], orders: Sequence[int | None], file: str) -> list[SourceField]:
    """Velocities and pressure; raises FormatError if the variables do not belong to a compressible flow."""
    velocities = [name for name in "uvw" if f"rho{name}" in names]
    if not {"rho", "E"} <= set(names) or not velocities:
        raise FormatError(f"expected rho, rhou, ..., E to derive from, found {', '.join(names)}", file=file)
    raised = [None if order is None else order + _DERIVED for order in orders]
    return [SourceField(name, raised, is_polynomial=False, key=name) for name in (*velocities, "p")]


def _constants(config: configparser.ConfigParser) -> dict[str, str]:
    """The constants of the flow that predefined quantities take, by the names that metadata have for them.

    Not the viscosity where it changes with the temperature.
    """
    known = dict(config.items("constants")) if config.has_section("constants") else {}
    is_constant = config.get("solver", "viscosity-correction", fallback="none") == "none"
    wanted = ("gamma", "mu", "nu") if is_constant else ("gamma",)
    return {key.capitalize(): known[key] for key in wanted if key in known}


def _derive(name: str, conserved: dict[str, Any], gamma: float) -> Floats:
    """A velocity or the pressure of an ideal gas."""
    if name != "p":
        return np.asarray(conserved[f"rho{name}"] / conserved["rho"])
    squares = sum(conserved[f"rho{v}"] ** 2 for v in "uvw" if f"rho{v}" in conserved)
    return np.asarray((gamma - 1) * (conserved["E"] - 0.5 * squares / conserved["rho"]))
