"""Files of PyFR before 2.1: arrays named by kind of element and partition, which say less of themselves.

A mesh holds ``spt_KIND_pN`` (points, elements, d), the places of evenly spaced points of every element, and sides of
boundaries ``bcon_NAME_pN``; a solution ``soln_KIND_pN`` (points, variables, elements), at points that its configuration
names.  The tables of these points come with the package pyfr, but for products of Gauss rules.
"""

from __future__ import annotations

import configparser
import re
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.converters.shared.hdf5 import require, text
from elvis.converters.shared.unit import lattice
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import tensor_nodes

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

_LINES = {"gauss-legendre": gauss, "gauss-legendre-lobatto": lobatto}

#: kinds that are products of lines
_PRODUCTS = ("quad", "hex")

#: our shape of each kind
_SHAPES = {
    "tri": Shape.TRIANGLE,
    "quad": Shape.QUADRILATERAL,
    "tet": Shape.TETRAHEDRON,
    "pyr": Shape.PYRAMID,
    "pri": Shape.PRISM,
    "hex": Shape.HEXAHEDRON,
}

_HIGHEST = 15


@dataclass(frozen=True, eq=False)
class Values:
    """Values (n, variables, points) of elements of one kind, at points (points, d) in PyFR's coordinates.

    place  in the file, for messages
    rows   (n,) of the elements among all of the kind, None if these are all
    """

    place: str
    points: Floats
    values: Floats
    rows: Ints | None = None


def arrays(file: h5py.File, prefix: str) -> dict[str, Floats]:
    """Arrays by kind of element (points, ..., elements) or, for meshes, (points, elements, d), partitions concatenated.

    Raises FormatError if partitions don't fit together.
    """
    axis = 1 if prefix == "spt" else 2
    found: dict[str, list[tuple[int, Floats]]] = {}
    for name in file:
        match = re.fullmatch(rf"{re.escape(prefix)}_([a-z]+)_p(\d+)", name)
        if match:
            data = require(file, name)
            if data.ndim != 3 or data.dtype.kind != "f":
                raise FormatError(f"expected three indices, found {data.shape}", file=file.filename, place=name)
            found.setdefault(match[1], []).append((int(match[2]), np.asarray(data, np.float64)))
    joined = {}
    for kind, parts in sorted(found.items()):
        own = [array for _, array in sorted(parts, key=lambda part: part[0])]
        if len({tuple(np.delete(array.shape, axis)) for array in own}) > 1:
            shapes = " and ".join(str(array.shape) for array in own)
            raise FormatError(
                f"expected partitions alike, found {shapes}", file=file.filename, place=f"{prefix}_{kind}"
            )
        joined[kind] = np.concatenate(own, axis=axis)
    return joined


def values(file: h5py.File, prefix: str, config: configparser.ConfigParser) -> dict[str, Values]:
    """The values of a solution, by kind of element."""
    found = {}
    for kind, own in arrays(file, prefix).items():
        rule = config.get(f"solver-elements-{kind}", "soln-pts", fallback="")
        points = solution_points(kind, rule, len(own), file.filename)
        found[kind] = Values(f"{prefix}_{kind}", points, own.transpose(2, 1, 0))
    return found


def sides(file: h5py.File) -> dict[str, dict[str, Ints]]:
    """For each boundary, by kind of element, (n, 2) rows of elements, over all partitions, and faces."""
    firsts: dict[tuple[str, int], int] = {}
    counts: dict[str, int] = {}
    for name in sorted(file, key=_partition):
        match = re.fullmatch(r"spt_([a-z]+)_p(\d+)", name)
        if match:
            firsts[match[1], int(match[2])] = counts.get(match[1], 0)
            counts[match[1]] = counts.get(match[1], 0) + require(file, name).shape[1]
    found: dict[str, dict[str, list[tuple[int, int]]]] = {}
    for name in file:
        match = re.fullmatch(r"bcon_(.+)_p(\d+)", name)
        for entry in require(file, name)[()].tolist() if match else ():
            assert match is not None
            kind, row, face = text(entry[0]), int(entry[1]), int(entry[2])
            number = firsts.get((kind, int(match[2])), -1)
            if number < 0 or not 0 <= row < counts[kind] - number or not 0 <= face < _face_count(kind):
                raise FormatError(f"expected a side of an element, found {entry}", file=file.filename, place=name)
            found.setdefault(match[1], {}).setdefault(kind, []).append((number + row, face))
    return {name: {kind: np.array(own, np.int64) for kind, own in of.items()} for name, of in found.items()}


def _face_count(kind: str) -> int:
    shape = _SHAPES[kind]
    return len(shape.faces if shape.dimension == 3 else shape.edges)


def _partition(name: str) -> tuple[int, str]:
    number = name.rpartition("_p")[2]
    return (int(number) if number.isdigit() else -1, name)


def shape_points(kind: str, count: int, file: str) -> Floats:
    """(count, d) the evenly spaced points of an element, the first coordinate fastest, in PyFR's coordinates."""
    for order in range(1, _HIGHEST + 1):
        points = _lattice(kind, order)
        if len(points) == count:
            return points
    raise FormatError(f"expected the points of some order in a {kind}, found {count}", file=file)


def _lattice(kind: str, order: int) -> Floats:
    """Evenly spaced points of an order; in pyramids every layer has a square of its own."""
    if kind != "pyr":
        return np.asarray(2 * lattice(_SHAPES[kind], order) / order - 1)
    layers = []
    for low in range(order + 1):
        line = (np.arange(low, 2 * order - low + 1, 2) / order) - 1
        square = tensor_nodes(Shape.QUADRILATERAL, tuple(line.tolist()))
        layers.append(np.column_stack([square, np.full(len(square), 2 * low / order - 1)]))
    return np.concatenate(layers)


def solution_points(kind: str, rule: str, count: int, file: str) -> Floats:
    """(count, d) the points of a rule, in PyFR's coordinates and order; raises ElvisError if its table isn't there."""
    if kind in _PRODUCTS and rule in _LINES:
        shape = _SHAPES[kind]
        along = max(round(count ** (1 / shape.dimension)), 1)
        points = tensor_nodes(shape, tuple(_LINES[rule](along)[0].tolist()))
    else:
        points = _table(kind, rule, count)
    if len(points) != count:
        raise FormatError(f"expected {len(points)} points of {rule} in a {kind}, found {count}", file=file)
    return points


def _table(kind: str, rule: str, count: int) -> Floats:
    """A table of the package."""
    spec = find_spec("pyfr")
    if spec is None or not spec.submodule_search_locations:
        raise ElvisError(
            f"the solution points {rule} of a {kind} come with the package pyfr, which is not installed; "
            "pip install pyfr installs it"
        )
    folder = Path(next(iter(spec.submodule_search_locations))) / "quadrules" / kind
    known = [path for path in folder.glob("*.txt") if re.match(rf"{re.escape(rule)}-n{count}-", path.name)]
    if not known:
        raise ElvisError(f"the package pyfr has no table of {count} solution points {rule} in a {kind}")
    return np.loadtxt(sorted(known)[0], ndmin=2)[:, : _SHAPES[kind].dimension]
