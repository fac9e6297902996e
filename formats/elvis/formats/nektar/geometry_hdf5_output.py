"""Writing meshes as HDF5 (format notes 1.9): version 1 for one domain, which most readers know, else version 2."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.arrays import Ints
from elvis.core.errors import ElvisError
from elvis.core.mesh import Curves, Mesh
from elvis.formats.nektar.composites import format_tokens
from elvis.formats.nektar.domain import written_composites
from elvis.formats.nektar.geometry_hdf5 import NAMES
from elvis.formats.nektar.geometry_output import entity_ids, member_ids
from elvis.formats.nektar.hdf5_output import created
from elvis.formats.nektar.idlist import format_ids

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


def write_geometry(path: Path, mesh: Mesh) -> None:
    """The file of a mesh that has a domain; ElvisError where ids are too great for it."""
    with created(path) as file:
        geometry = file.create_group("NEKTAR/GEOMETRY")
        is_plain = list(mesh.domains) == [0]
        geometry.attrs.create("FORMAT_VERSION", 1 if is_plain else 2, dtype=np.uint32)
        data, maps = geometry.create_group("MESH"), geometry.create_group("MAPS")
        data["VERT"], maps["VERT"] = mesh.vertices, int32(mesh.vertex_ids)
        for shape, name in NAMES.items():
            if len(mesh.of(shape)):
                data[name], maps[name] = int32(member_ids(mesh, shape)), int32(mesh.of(shape).ids)
        _write_curves(data, maps, mesh)
        _write_composites(data, maps, mesh)
        _write_domains(data, maps, mesh, is_plain)


def int32(values: Ints) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    """The values as the format stores them; ElvisError where they don't fit."""
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
    """Composites as text; names, for which the format has no place, in an attribute that other readers pass over."""
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
