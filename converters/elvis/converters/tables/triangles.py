"""Triangles of surfaces as files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module
from elvis.core.files.output import write_bytes
from elvis.core.files.polydata import write_triangles
from elvis.core.triangles import SurfaceTriangles

#: suffixes of files; formats with 32-bit coordinates; formats that hold quantities
SUFFIXES = (".stl", ".ply", ".obj", ".glb", ".vtp")
_SINGLE = (".stl", ".ply", ".glb")
_WITH_VALUES = (".ply", ".glb", ".vtp")
#: rounding of coordinates of 32 bits, and of the digits of texts
_ROUNDING, _DIGITS = 2.0**-24, 15


def check_name(path: Path) -> None:
    """Raise ElvisError for a name with another suffix, or if the library that writes such files is missing."""
    if path.suffix not in SUFFIXES:
        raise ElvisError(f"{path}: expected a name ending in {', '.join(SUFFIXES)}")
    if path.suffix != ".vtp":
        require_module("trimesh", f"writing {path.suffix} files", "distances")


def export_triangles(surface: SurfaceTriangles, path: Path) -> list[str]:
    """Write a surface with its normals, and quantities if the format supports them; return messages about omissions."""
    check_name(path)
    if path.suffix == ".vtp":
        write_triangles(path, surface.points, surface.triangles, {"normals": surface.normals, **surface.values})
        return []
    write_bytes(path, _content(surface, path.suffix))
    said = []
    if surface.values and path.suffix not in _WITH_VALUES:
        said.append(f"{path.suffix} files contain no quantities: {', '.join(surface.values)} are skipped")
    rounding = _ROUNDING * float(np.abs(surface.points).max(initial=0.0))
    if path.suffix in _SINGLE and rounding > surface.distance / 10:
        said.append(f"{path.suffix} files have coordinates of 32 bits, which are rounded by up to {rounding:.1g}")
    return said


def _content(surface: SurfaceTriangles, suffix: str) -> bytes:
    """The content of a file, by trimesh."""
    trimesh = require_module("trimesh", f"writing {suffix} files", "distances")

    mesh = trimesh.Trimesh(surface.points, surface.triangles, vertex_normals=surface.normals, process=False)
    if suffix in _WITH_VALUES:
        mesh.vertex_attributes.update({_attribute(name, suffix): own for name, own in surface.values.items()})
    options: dict[str, dict[str, Any]] = {
        ".stl": {},
        ".ply": {"vertex_normal": True},
        ".obj": {"include_normals": True, "digits": _DIGITS},
        ".glb": {"include_normals": True},
    }
    found = mesh.export(file_type=suffix[1:], **options[suffix])
    return found.encode() if isinstance(found, str) else bytes(found)


def _attribute(name: str, suffix: str) -> str:
    """The name of a quantity: words in PLY, with a leading underscore in glTF (specification 3.7.2.1)."""
    word = "".join(letter if letter.isalnum() else "_" for letter in name)
    return f"_{word}" if suffix == ".glb" else word
