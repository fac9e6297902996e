"""Triangle meshes of files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints, narrow_ints
from elvis.core.base.errors import FormatError
from elvis.core.base.needing import require_module
from elvis.core.distances.triangle_texts import Indexed, triangles_in_text
from elvis.core.files.plain import content

#: suffixes of files that are read
SUFFIXES = (".stl", ".ply", ".obj", ".glb")
_NAMED = re.compile(
    rf"(\bdistance\(\s*[\"'])([^\"']*(?:{'|'.join(map(re.escape, SUFFIXES))}))([\"']\s*\))", re.IGNORECASE
)


def renamed(expression: str, change: Callable[[str], str]) -> str:
    """An expression with other names of the files that distances in it are measured to."""
    return _NAMED.sub(lambda found: f"{found[1]}{change(found[2])}{found[3]}", expression)


def named_files(expression: str) -> list[Path]:
    """The files that distances in an expression are measured to."""
    return [Path(found[2]) for found in _NAMED.finditer(expression)]


def triangles_of(name: str) -> tuple[Floats, Ints]:
    """Vertices (n, 3), those at one place one, and triangles (m, 3) of them.

    Raises FormatError if the file holds none.
    """
    vertices, triangles = _indexed(name)
    points, numbers = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    triangles = narrow_ints(numbers.reshape(-1), len(points))[triangles]
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not distinct.any():
        raise FormatError("expected triangles, found only some without an area", file=name)
    return points, triangles[distinct]


def corners_of(name: str) -> Floats:
    """(m, 3, 3) the corners of the triangles of a file; raises FormatError if it holds none."""
    vertices, triangles = _indexed(name)
    return vertices[triangles]


def _indexed(name: str) -> Indexed:
    """Vertices (n, 3) that triangles use, and triangles (m, 3); raises FormatError if there are none."""
    try:
        found = triangles_in_text(content(name), Path(name).suffix.lower())
    except FormatError as error:
        raise error.within(name) from None
    vertices, triangles = _by_library(name) if found is None else found
    if not len(triangles):
        raise FormatError("expected triangles, found none", file=name)
    if vertices.shape[1:] != (3,):
        raise FormatError(f"expected three coordinates, found {vertices.shape[-1]}", file=name)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise FormatError(f"expected corners among {len(vertices)} vertices, found others", file=name, place="face")
    is_used = np.zeros(len(vertices), np.bool_)
    is_used[triangles] = True
    vertices = vertices[is_used]
    if not np.isfinite(vertices).all():
        raise FormatError("expected finite coordinates, found others", file=name)
    return vertices, (np.cumsum(is_used) - 1)[triangles]


def _by_library(name: str) -> Indexed:
    """Vertices and triangles of a binary file."""
    trimesh = require_module("trimesh", "a triangle file", "distances")
    try:
        mesh = trimesh.load_mesh(name, process=False)
        return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except Exception as error:
        raise FormatError(
            f"expected a triangle mesh, found none that can be read: {_words(error)}", file=name
        ) from error


def _words(error: Exception) -> str:
    """The text of a library's error, as part of a sentence."""
    return " ".join(str(error).split())[:120] or type(error).__name__
