"""Rules for HDF5 files: types of numbers, strings of variable length, attributes, groups (format notes 1.9, 5.2)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elvis.formats.nektar import hdf5
from elvis.formats.nektar.geometry.hdf5 import NAMES
from elvis.formats.strict.finding import Finding, library_rule, style_rule

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

_FIELD_TYPES = {
    "DECOMPOSITION": "uint64",
    "ELEMENTIDS": "uint32",
    "POLYORDERS": "uint32",
    "HOMOGENEOUSYIDS": "uint32",
    "HOMOGENEOUSZIDS": "uint32",
    "HOMOGENEOUSSIDS": "uint32",
    "DATA": "float64",
}
_CURVES = ("CURVE_EDGE", "CURVE_FACE", "CURVE_NODES")
_DEFINITION = {"FIELDS": "strings", "BASIS": "int32", "SHAPE": "strings", "NUMMODESPERDIR": "strings"}


def mesh_file_findings(file: h5py.File) -> Iterator[Finding]:
    """The rules that an HDF5 mesh breaks."""
    geometry = hdf5.required_group(hdf5.required_group(file, "NEKTAR"), "GEOMETRY")
    version = hdf5.version(geometry, 2)
    yield from _version(geometry)
    mesh, maps = hdf5.required_group(geometry, "MESH"), hdf5.required_group(geometry, "MAPS")
    integral = [*NAMES.values(), "CURVE_EDGE", "CURVE_FACE"]
    yield from _types(mesh, {"VERT": "float64", "CURVE_NODES": "float64", **dict.fromkeys(integral, "int32")})
    yield from _types(maps, dict.fromkeys(["VERT", *integral, "COMPOSITE", "DOMAIN"], "int32"))
    yield from _types(mesh, {"COMPOSITE": "strings", "DOMAIN": "strings"})
    for name in ("VERT", "COMPOSITE", "DOMAIN", *_CURVES):
        if name not in mesh:
            kind = style_rule if name in _CURVES else library_rule
            yield kind(mesh.name, f"expected a dataset {name}, found none")
    if version > 1 and "DOMAIN" not in maps:
        yield library_rule(maps.name, "expected a dataset DOMAIN, as in version 2, found none")


def field_file_findings(file: h5py.File) -> Iterator[Finding]:
    """The rules that an HDF5 field file breaks."""
    root = hdf5.required_group(file, "NEKTAR")
    yield from _version(root)
    if hdf5.group(root, "Metadata") is None:
        yield library_rule(root.name, "expected a group Metadata, found none")
    else:
        notes = hdf5.required_group(root, "Metadata")
        yield from _attributes(notes, dict.fromkeys(hdf5.attribute_names(notes), "strings"))
    yield from _types(root, _FIELD_TYPES)
    for name in ("DECOMPOSITION", "ELEMENTIDS", "DATA"):
        if name not in root:
            yield library_rule(root.name, f"expected a dataset {name}, found none")
    for key in root:
        if key.isdigit():
            own = hdf5.required_group(root, key)
            missing = [name for name in _DEFINITION if name not in own.attrs]
            yield from (library_rule(own.name, f"expected an attribute {name}, found none") for name in missing)
            yield from _attributes(own, {**_DEFINITION, "HOMOGENEOUSLENGTHS": "float64"})


def _version(group: h5py.Group) -> Iterator[Finding]:
    """FORMAT_VERSION is one unsigned number of 32 bits."""
    if "FORMAT_VERSION" not in group.attrs:
        yield library_rule(group.name, "expected an attribute FORMAT_VERSION, found none")
        return
    found = group.attrs.get_id("FORMAT_VERSION")
    if str(found.dtype) != "uint32" or found.shape != ():
        sentence = f"expected FORMAT_VERSION as one uint32, found {found.dtype} of shape {found.shape}"
        yield style_rule(group.name, sentence)


def _types(group: h5py.Group, wanted: dict[str, str]) -> Iterator[Finding]:
    """Datasets of the right types."""
    for name, kind in wanted.items():
        if name in group and not _is(group[name].dtype, kind):
            yield _of_type(f"{group.name}/{name}", kind, group[name].dtype)


def _attributes(group: h5py.Group, wanted: dict[str, str]) -> Iterator[Finding]:
    """Attributes of the right types."""
    for name, kind in wanted.items():
        if name in group.attrs:
            dtype = group.attrs.get_id(name).dtype
            if not _is(dtype, kind):
                yield _of_type(f"{group.name}, attribute {name}", kind, dtype)


def _of_type(place: str, kind: str, dtype: object) -> Finding:
    """Numbers of other types are converted by readers.

    Strings of fixed length, or data that are not strings, stop them.
    """
    rule = library_rule if kind == "strings" else style_rule
    return rule(place, f"expected {_label(kind)}, found {dtype}")


def _is(dtype: object, kind: str) -> bool:
    """Whether a type is the one called ``kind``; strings must have variable length."""
    import h5py

    if kind != "strings":
        return str(dtype) == kind
    found = h5py.check_string_dtype(dtype)
    return found is not None and found.length is None


def _label(kind: str) -> str:
    return "strings of variable length" if kind == "strings" else kind
