"""HDF5 geometry, versions 1 and 2, read and written (format notes 1.9).

Version 1 is written for one domain, which most readers know, else version 2.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.mesh import MEMBERS, Curves, Mesh
from elvis.core.shapes import Shape
from elvis.formats.nektar import hdf5
from elvis.formats.nektar.assembly import RawComposite, RawCurves, RawGeometry
from elvis.formats.nektar.composites import composite_ids, format_tokens, parse_tokens, written_composites
from elvis.formats.nektar.geometry.output import entity_ids, lower_ids
from elvis.formats.nektar.geometry.xml import owned
from elvis.formats.nektar.hdf5 import created
from elvis.formats.nektar.numbers import IdList, format_ids

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


GREATEST_VERSION = 2

#: names of the datasets of each shape
NAMES = {
    Shape.SEGMENT: "SEG",
    Shape.TRIANGLE: "TRI",
    Shape.QUADRILATERAL: "QUAD",
    Shape.TETRAHEDRON: "TET",
    Shape.PYRAMID: "PYR",
    Shape.PRISM: "PRISM",
    Shape.HEXAHEDRON: "HEX",
}


def is_geometry(file: h5py.File) -> bool:
    """Whether an HDF5 file holds a mesh."""
    root = hdf5.group(file, "NEKTAR")
    return root is not None and hdf5.group(root, "GEOMETRY") is not None


def read_geometry(path: Path, dimension: int | None = None, space: int | None = None) -> RawGeometry:
    """The mesh of an HDF5 file; if dimensions aren't given, they are the smallest possible."""
    with hdf5.reading(path) as file:
        geometry = hdf5.required_group(hdf5.required_group(file, "NEKTAR"), "GEOMETRY")
        version = hdf5.version(geometry, GREATEST_VERSION)
        mesh, maps = hdf5.required_group(geometry, "MESH"), hdf5.required_group(geometry, "MAPS")
        vertex_ids, vertices = _vertices(mesh, maps)
        tables = dict(_tables(mesh, maps))
        dimension = dimension or max((shape.dimension for shape in tables), default=3)
        return RawGeometry(
            str(path),
            dimension,
            space or max(dimension, _extent(vertices)),
            vertex_ids,
            vertices,
            {shape: table for shape, table in tables.items() if shape.dimension <= dimension},
            _curves(mesh, maps, "CURVE_EDGE"),
            _curves(mesh, maps, "CURVE_FACE"),
            _composites(mesh, maps),
            _domains(mesh, maps, version),
        )


def _vertices(mesh: h5py.Group, maps: h5py.Group) -> tuple[Ints, Floats]:
    ids, points = hdf5.table(maps, "VERT"), hdf5.floats(mesh, "VERT", 3)
    if ids is None or points is None or len(ids) != len(points):
        raise FormatError(
            "expected VERT in MESH and MAPS, of one length, found otherwise", place="/NEKTAR/GEOMETRY/MESH"
        )
    return ids, points


def _tables(mesh: h5py.Group, maps: h5py.Group) -> list[tuple[Shape, tuple[Ints, Ints]]]:
    found = []
    for shape, name in NAMES.items():
        members, ids = hdf5.table(mesh, name, MEMBERS[shape]), hdf5.table(maps, name)
        if members is None and ids is None:
            continue
        if members is None or ids is None or len(ids) != len(members):
            raise FormatError(
                f"expected {name} in MESH and MAPS, of one length, found otherwise", place="/NEKTAR/GEOMETRY/MESH"
            )
        if len(ids):
            found.append((shape, (ids, members)))
    return found


def _extent(points: Floats) -> int:
    """The number of coordinates up to the last that isn't zero throughout."""
    return next((count for count in (3, 2) if points[:, count - 1].any()), 1)


def _curves(mesh: h5py.Group, maps: h5py.Group, name: str) -> RawCurves:
    """Curved edges or faces: rows of number of points, family, offset into the nodes."""
    table, entities = hdf5.ints(mesh, name, 3), hdf5.ints(maps, name)
    if table is None or entities is None or not len(table):
        return RawCurves.none()
    nodes = hdf5.floats(mesh, "CURVE_NODES", 3)
    if nodes is None or len(entities) != len(table):
        raise FormatError(
            f"expected {name} in MESH and MAPS and CURVE_NODES, found otherwise", place="/NEKTAR/GEOMETRY/MESH"
        )
    counts = table[:, 0].copy()
    return RawCurves(entities, table[:, 1].copy(), counts, nodes[owned(counts, table[:, 2], len(nodes))])


def _composites(mesh: h5py.Group, maps: h5py.Group) -> tuple[RawComposite, ...]:
    texts, ids = hdf5.strings(mesh, "COMPOSITE") or [], hdf5.ints(maps, "COMPOSITE")
    if len(texts) != (0 if ids is None else len(ids)):
        raise FormatError(
            "expected COMPOSITE in MESH and MAPS, of one length, found otherwise", place="/NEKTAR/GEOMETRY/MESH"
        )
    if ids is None:
        return ()
    names = _composite_names(maps, len(texts))
    return tuple(
        (id, parse_tokens(text.encode()), name) for id, text, name in zip(ids.tolist(), texts, names, strict=True)
    )


def _composite_names(maps: h5py.Group, count: int) -> list[str | None]:
    """Names that this project keeps in an attribute, for want of a place in the format."""
    values = hdf5.dataset_attribute(maps, "COMPOSITE", "NAME")
    return [hdf5.text(value) or None for value in values] if len(values) == count else [None] * count


def _domains(mesh: h5py.Group, maps: h5py.Group, version: int) -> dict[int, IdList]:
    """Domain id -> list of composites; version 1 has one domain and no ids."""
    texts = hdf5.strings(mesh, "DOMAIN") or []
    ids = hdf5.ints(maps, "DOMAIN") if version > 1 else None
    numbers = range(len(texts)) if ids is None else ids.tolist()
    if len(numbers) != len(texts):
        raise FormatError(
            "expected DOMAIN in MESH and MAPS, of one length, found otherwise", place="/NEKTAR/GEOMETRY/MESH"
        )
    return {id: composite_ids(text.encode()) for id, text in zip(numbers, texts, strict=True)}


def write_geometry(path: Path, mesh: Mesh) -> None:
    """The file of a mesh that has a domain; raises ElvisError if ids are too great for it."""
    with created(path) as file:
        geometry = file.create_group("NEKTAR/GEOMETRY")
        is_plain = list(mesh.domains) == [0]
        geometry.attrs.create("FORMAT_VERSION", 1 if is_plain else 2, dtype=np.uint32)
        data, maps = geometry.create_group("MESH"), geometry.create_group("MAPS")
        data["VERT"], maps["VERT"] = mesh.vertices, int32(mesh.vertex_ids)
        for shape, name in NAMES.items():
            if len(mesh.of(shape)):
                data[name] = int32(lower_ids(mesh, shape))[mesh.of(shape).members]
                maps[name] = int32(mesh.of(shape).ids)
        _write_curves(data, maps, mesh)
        _write_composites(data, maps, mesh)
        _write_domains(data, maps, mesh, is_plain)


def int32(values: Ints) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    """The values as the format stores them; raises ElvisError if they don't fit."""
    if values.size and not 0 <= values.min() <= values.max() < 2**31:
        raise ElvisError(f"expected ids below 2^31 for HDF5, found {values.min()} to {values.max()}")
    return values.astype("<i4")


def _write_curves(data: h5py.Group, maps: h5py.Group, mesh: Mesh) -> None:
    """Edges and faces over common nodes, edges first; all three datasets always exist."""
    offset = 0
    for name, curves, dimension in (("CURVE_EDGE", mesh.edge_curves, 1), ("CURVE_FACE", mesh.face_curves, 2)):
        data[name] = int32(_curve_rows(curves, offset))
        maps[name] = int32(entity_ids(mesh, dimension)[curves.rows])
        offset += len(curves.points)
    data["CURVE_NODES"] = np.concatenate([mesh.edge_curves.points, mesh.face_curves.points])


def _curve_rows(curves: Curves, offset: int) -> Ints:
    return np.stack([np.diff(curves.offsets), curves.kinds, curves.offsets[:-1] + offset], axis=1)


def _write_composites(data: h5py.Group, maps: h5py.Group, mesh: Mesh) -> None:
    """Composites as text.

    Names, for which the format has no place, are stored in an attribute that other readers ignore.
    """
    import h5py

    composites = written_composites(mesh)
    texts = [format_tokens(composite.parts) for composite in composites]
    data.create_dataset("COMPOSITE", (len(texts),), h5py.string_dtype("ascii"), texts)
    maps["COMPOSITE"] = int32(np.array([composite.id for composite in composites], np.int64))
    names = [composite.name or "" for composite in composites]
    if any(names):
        maps["COMPOSITE"].attrs.create("NAME", names, dtype=h5py.string_dtype("utf-8"))


def _write_domains(data: h5py.Group, maps: h5py.Group, mesh: Mesh, is_plain: bool) -> None:
    import h5py

    texts = [format_ids(np.array(composites, np.int64)) for composites in mesh.domains.values()]
    data.create_dataset("DOMAIN", (len(texts),), h5py.string_dtype("ascii"), texts)
    if not is_plain:
        maps["DOMAIN"] = int32(np.array(list(mesh.domains), np.int64))
