"""Triangle meshes of files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.files.plain import check_plain
from elvis.core.needing import require_module

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
    corners = corners_of(name)
    points, triangles = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not distinct.any():
        raise FormatError("expected triangles, found only some without an area", file=name)
    return points, triangles[distinct]


def corners_of(name: str) -> Floats:
    """(m, 3, 3) the corners of the triangles of a file; raises FormatError if it holds none."""
    trimesh = require_module("trimesh", "a triangle file", "distances")

    check_plain(name)
    try:
        corners = np.asarray(trimesh.load_mesh(name, process=False).triangles, dtype=np.float64)
    except Exception as error:
        raise FormatError(
            f"expected a triangle mesh, found none that can be read: {_words(error)}", file=name
        ) from error
    if not len(corners):
        raise FormatError("expected triangles, found none", file=name)
    if corners.shape[1:] != (3, 3):
        raise FormatError(f"expected three coordinates, found {corners.shape[-1]}", file=name)
    if not np.isfinite(corners).all():
        raise FormatError("expected finite coordinates, found others", file=name)
    return corners


def _words(error: Exception) -> str:
    """The text of a library's error, as part of a sentence."""
    return " ".join(str(error).split())[:120] or type(error).__name__
