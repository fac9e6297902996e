"""NGSolve's elements: objects of a session, its own files, or samples (.elems.npz) of `export`.

The library evaluates positions and values of objects and of its own files.  Samples hold, for each shape S (tet,
pyramid, prism, hex, trig, quad): S_elem (n,) numbers, S_verts (n, k) vertices in NGSolve's order, S_ref (m, d)
reference points, S_xyz (n, m, D), S_f_NAME (n, m, components), and S_region (n,) names if there are any; order: the
degree of the map and the highest of the fields; order_NAME, continuous, time, boundary_S_verts, boundary_S_region,
boundary_S_number (from 1), and the errors of polynomials through the samples for the map (error) and for functions
(error_NAME) are optional.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from elvis.converters.ngsolve.export import SHAPES, UNIT_VERTICES, Session, export
from elvis.converters.ngsolve.files import is_mesh, opened
from elvis.converters.shared.evaluated import EvaluatedValues
from elvis.converters.shared.unit import UNIT, unit_basis
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.files.archives import Archive, names_in
from elvis.core.files.plain import leading
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import (
    NodalBasis,
    NodalBlock,
    NodalConverter,
    NodalValues,
    component_names,
    order_of_space,
)
from elvis.plugins.conversion.plugin import Boundary, Elements, Option, PyramidSpace, Reads

_HIGHEST, _HEAD = 30, 4096

#: names of the arrays that are read
_SHAPE = "|".join(SHAPES)
_KNOWN = re.compile(
    rf"({_SHAPE})_(elem|verts|ref|xyz|region|f_.+)|boundary_({_SHAPE})_(verts|region|number)|order(_.+)?|"
    rf"error(_.+)?|continuous|time"
)


class Asked(Protocol):
    """The library with a mesh and functions, as `elvis.converters.ngsolve.export.Session`."""

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """(k, n, D) world coordinates at reference points (n, d) of elements (k,)."""

    def values(self, name: str, elements: Ints, points: Floats) -> Floats:
        """(k, n, c) components of a function at reference points (n, d) of elements (k,)."""


class NGSolve(NodalConverter):
    """Elements with values at points that determine their polynomials."""

    format = "NGSolve's meshes and grid functions (.vol, .vol.gz, .gfu), samples from a session (.elems.npz)"
    keeps = (
        "curved elements of all shapes and orders, H1 and L2 functions exactly, others with a measured error, "
        "materials, boundaries, time"
    )
    loses = "pickled sessions, which can run any code: export from Python; .vol and .gfu files need the package ngsolve"
    reads = Reads(
        "all",
        "any",
        "H1, L2, vectors of these, H(div), H(curl), products, values at quadrature points",
        "by name and number",
        "none",
        "none",
        "no",
        "two fields, `u_re` and `u_im`",
    )
    options = (
        Option(
            "spaces",
            "Spaces of the .gfu files in order, such as H1:5,VectorH1:3*H1:2 (a product), H1:4:complex, L2:4@air.",
        ),
    )
    further_files = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether it is a mesh with files of functions, or one archive with the elements and places of a shape."""
        if sum(map(is_mesh, paths)) == 1:
            return all(is_mesh(path) or path.suffix == ".gfu" for path in paths)
        names = names_in(paths[0]) if len(paths) == 1 else frozenset()
        return any({f"{shape}_ref", f"{shape}_xyz", f"{shape}_verts"} <= names for shape in SHAPES)

    @classmethod
    def hint(cls, path: Path) -> str:
        """Functions without their mesh, pickled sessions."""
        if path.suffix == ".gfu":
            return "numbers of an NGSolve function (.gfu) without a mesh: give the .vol file and --reader spaces=H1:5"
        head = leading(path, _HEAD)
        if head.startswith(b"\x80") and b"ngsolve" in head:
            return f"a pickled NGSolve session, which could run any code: use {export.__module__}.export in Python"
        return ""

    def __init__(self, paths: Sequence[Path], spaces: str | None = None) -> None:
        if len(paths) == 1 and names_in(paths[0]):
            self._take(_load(paths[0]), paths[0])
        else:
            self._take(*opened(paths, spaces))

    @classmethod
    def of(cls, session: Session) -> NGSolve:
        """The mesh and the functions of a session."""
        own = cls.__new__(cls)
        own._take(session.description(), Path("NGSolve"), session)
        return own

    def _take(self, data: dict[str, Any], path: Path, asked: Asked | None = None) -> None:
        """Blocks, fields and boundaries of a description, with samples, or with a library that evaluates them."""
        self._path, self._data, self._asked = path, data, asked
        self._parts: list[tuple[str, Ints]] = []
        self.blocks = []
        geometry = int(self._orders_of("order")[0])
        names = self._fields()
        for shape in SHAPES:
            if f"{shape}_verts" in self._data:
                self._read(shape, geometry, names)
        if not self.blocks:
            raise FormatError("expected elements, found none", file=self._path)
        self._add_fields(names)
        self.boundaries = self._borders()
        self.errors = self._errors(names)
        self.notes = [str(note) for note in self._data.get("notes", ())]
        if "pyramid_verts" in self._data:
            self.notes += [
                "NGSolve's functions on pyramids have a slightly displaced apex, so they are matched to 1e-7, not to "
                "rounding"
            ]
        self.time = self._time()
        declared = int(self._data.get("declared", -1))
        self.declared = Declared(declared if declared >= 0 else None)

    def _orders_of(self, name: str) -> Ints:
        orders = np.asarray(self._array(name)).reshape(-1)
        orders = orders.astype(np.int64) if orders.dtype.kind in "iu" else np.empty(0, np.int64)
        if not len(orders) or not 0 <= orders.min() <= orders.max() <= _HIGHEST:
            found = ", ".join(map(str, orders[:9].tolist())) or "none"
            raise FormatError(f"expected orders from 0 to {_HIGHEST}, found {found}", file=self._path, place=name)
        return orders

    def _errors(self, names: dict[str, int]) -> dict[str, tuple[float, float]]:
        """Errors of samples of the map, whose name is empty, and of each component of a function."""
        labels = {"error": [""], **{f"error_{name}": component_names(name, count) for name, count in names.items()}}
        found: dict[str, tuple[float, float]] = {}
        for key, own in labels.items():
            if key in self._data:
                found |= dict.fromkeys(own, (self._number(key), np.inf))
        return found

    def _time(self) -> float | None:
        return self._number("time") if "time" in self._data else None

    def _number(self, name: str) -> float:
        found = np.ravel(self._data[name])
        if len(found) != 1 or found.dtype.kind not in "iuf":
            raise FormatError(f"expected one number, found {found!r:.60}", file=self._path, place=name)
        return float(found[0])

    def _array(self, name: str) -> Any:
        if name not in self._data:
            raise FormatError(f"expected an array {name}, found none", file=self._path)
        return self._data[name]

    def _numbers(self, name: str, dimension: int) -> Any:
        """An array of numbers of this many dimensions."""
        found = np.asarray(self._array(name))
        if found.ndim != dimension or found.dtype.kind not in "iuf":
            expected = f"numbers of {dimension} dimensions"
            what = f"{found.dtype} of shape {found.shape}"
            raise FormatError(f"expected {expected}, found {what}", file=self._path, place=name)
        return found

    def _regions(self, name: str, count: int) -> Any:
        """(count,) names, empty if the file has none."""
        found = np.asarray(self._data.get(name, np.full(count, "")))
        if found.shape != (count,):
            raise FormatError(f"expected {count} names, found {found.shape}", file=self._path, place=name)
        return found

    def _fields(self) -> dict[str, int]:
        """Numbers of components by name."""
        if self._asked is not None:
            return {key[6:]: int(array) for key, array in self._data.items() if key.startswith("count_")}
        found: dict[str, int] = {}
        for key, array in self._data.items():
            shape, _, name = key.partition("_f_")
            if name and shape in SHAPES and array.ndim == 3:
                found.setdefault(name, array.shape[2])
        return found

    def _read(self, shape: str, geometry: int, names: dict[str, int]) -> None:
        """One block for every region that elements of a shape have."""
        own, vertices = SHAPES[shape], self._numbers(f"{shape}_verts", 2)
        basis = None if self._asked is not None else self._checked_basis(shape, geometry, names)
        regions = self._regions(f"{shape}_region", len(vertices))
        corners = np.array(UNIT_VERTICES[shape])[UNIT[own].corners]
        for region in np.unique(regions).tolist():
            rows = np.flatnonzero(regions == region)
            numbers = np.asarray(self._data[f"{shape}_elem"], np.int64)[rows]
            block = Elements(
                own,
                len(rows),
                max(geometry, 1),
                np.asarray(vertices, np.int64)[rows][:, corners],
                frame=None if basis is not None else UNIT[own].frame,
                ids=numbers,
                region=str(region),
                pyramid=PyramidSpace.RATIONAL,
                key=NodalBlock(self._places(shape, rows, numbers, geometry, basis)),
            )
            self.blocks = [*self.blocks, block]
            self._parts.append((shape, rows))

    def _places(self, shape: str, rows: Ints, numbers: Ints, geometry: int, basis: NodalBasis | None) -> NodalValues:
        """The map of some elements of a shape."""
        if self._asked is None:
            return NodalValues(self._data[f"{shape}_xyz"][rows], basis)
        return EvaluatedValues.of(self._asked.positions, numbers, geometry, 3)

    def _checked_basis(self, shape: str, geometry: int, names: dict[str, int]) -> NodalBasis:
        """The functions of the points of samples; raises FormatError if arrays don't fit."""
        own, vertices, reference = SHAPES[shape], self._numbers(f"{shape}_verts", 2), self._numbers(f"{shape}_ref", 2)
        count, width = len(vertices), len(reference)
        xyz = self._numbers(f"{shape}_xyz", 3)
        if not 1 <= xyz.shape[2] <= 3:
            raise FormatError(f"expected 1 to 3 coordinates, found {xyz.shape[2]}", file=self._path, place=shape)
        wanted: dict[str, tuple[int, ...]] = {
            f"{shape}_verts": (count, len(own.vertices)),
            f"{shape}_ref": (width, own.dimension),
        }
        wanted |= {f"{shape}_elem": (count,), f"{shape}_xyz": (count, width, xyz.shape[-1])}
        wanted |= {f"{shape}_f_{name}": (count, width, parts) for name, parts in names.items()}
        for key, expected in wanted.items():
            if self._numbers(key, len(expected)).shape != expected:
                raise FormatError(
                    f"expected {expected} numbers, found {self._array(key).shape}", file=self._path, place=key
                )
        order = self._order_of(shape, width)
        if geometry > order:
            found = f"those of order {order}"
            raise FormatError(f"expected samples of order {geometry}, found {found}", file=self._path, place=shape)
        return self._basis(shape, order, reference)

    def _order_of(self, shape: str, count: int) -> int:
        """The order of the functions that this many points determine."""
        order = order_of_space(SHAPES[shape], count, _HIGHEST, PyramidSpace.RATIONAL)
        if order is None:
            raise FormatError(
                f"expected the points of some order, found {count}", file=self._path, place=f"{shape}_ref"
            )
        return order

    def _basis(self, shape: str, order: int, reference: Floats) -> NodalBasis:
        try:
            return unit_basis(SHAPES[shape], order, reference)
        except ElvisError as error:
            raise FormatError(str(error), file=self._path, place=f"{shape}_ref") from None

    def _add_fields(self, names: dict[str, int]) -> None:
        """Fields by component; if the file doesn't name the continuous ones, all are tested."""
        stated, polynomial = self._data.get("continuous"), self._data.get("polynomial")
        for name, count in names.items():
            is_continuous = stated is None or name in np.ravel(stated).tolist()
            is_polynomial = polynomial is None or name in np.ravel(polynomial).tolist()
            own = int(self._orders_of(f"order_{name}")[0]) if f"order_{name}" in self._data else _HIGHEST
            parts = zip(self.blocks, self._parts, strict=True)
            regions = self._regions_of(name)
            values = [
                self._values(name, count, block, *part, own) if regions is None or block.region in regions else None
                for block, part in parts
            ]
            orders = [None if each is None else min(own, each.order) for each in values]
            labels = component_names(name, count)
            self.add_field(name, labels, values, is_continuous, is_polynomial, orders=orders)

    def _regions_of(self, name: str) -> list[str] | None:
        """The parts of the mesh that have a function, None for all."""
        found = self._data.get(f"regions_{name}")
        return None if found is None else [str(own) for own in np.ravel(found)]

    def _values(self, name: str, count: int, block: Elements, shape: str, rows: Ints, order: int) -> NodalValues:
        """A function on the elements of a block."""
        if self._asked is None:
            return NodalValues(self._data[f"{shape}_f_{name}"][rows], self.nodal(block).geometry.functions)
        assert block.ids is not None
        return EvaluatedValues.of(partial(self._asked.values, name), block.ids, order, count)

    def _borders(self) -> list[Boundary]:
        """Sides by the name of their boundary, and also by its number if several numbers have one name."""
        by_name: dict[str, list[Ints]] = {}
        by_number: dict[str, dict[int, list[Ints]]] = {}
        for shape in SHAPES:
            if not {f"boundary_{shape}_verts", f"boundary_{shape}_region"} <= set(self._data):
                continue
            vertices = np.asarray(self._numbers(f"boundary_{shape}_verts", 2))
            regions = self._regions(f"boundary_{shape}_region", len(vertices))
            numbers = self._boundary_numbers(shape, len(vertices))
            for name in np.unique(regions).tolist():
                label = str(name) or "boundary"
                by_name.setdefault(label, []).append(vertices[regions == name])
                for number in np.unique(numbers[regions == name]).tolist():
                    own = vertices[(regions == name) & (numbers == number)]
                    by_number.setdefault(label, {}).setdefault(number, []).append(own)
        shared = {n: faces for name, own in by_number.items() if len(own) > 1 for n, faces in own.items()}
        numbered = [Boundary(f"boundary{n}", vertices=faces) for n, faces in sorted(shared.items())]
        alone = {name: next(iter(own)) for name, own in by_number.items() if len(own) == 1}
        named = (Boundary(name, vertices=faces, number=alone.get(name)) for name, faces in sorted(by_name.items()))
        return [*numbered, *named]

    def _boundary_numbers(self, shape: str, count: int) -> Ints:
        """(count,) the numbers of the boundaries of sides; all 0 if the samples don't contain them."""
        name = f"boundary_{shape}_number"
        found = np.asarray(self._data.get(name, np.zeros(count, np.int64)))
        if found.shape != (count,) or found.dtype.kind not in "iu":
            raise FormatError(f"expected {count} numbers, found {found.shape}", file=self._path, place=name)
        return found.astype(np.int64)


def _load(path: Path) -> dict[str, Any]:
    """The arrays of an archive that are known."""
    with Archive(path) as archive:
        return {name: archive[name] for name in archive.names if _KNOWN.fullmatch(name)}
