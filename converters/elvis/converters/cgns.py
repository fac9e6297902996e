"""CGNS files: meshes of elements up to order 4, which Gmsh's library reads."""

from __future__ import annotations

import mmap
import re
from collections.abc import Sequence
from pathlib import Path

from elvis.converters.gmsh import Gmsh
from elvis.converters.gmsh_data import Contents
from elvis.converters.gmsh_mesh import read_mesh
from elvis.converters.hdf5 import holds, reading
from elvis.converters.inputs import single
from elvis.core.files.plain import leading
from elvis.formats.nektar.hdf5_checks import check_stored

#: how files of the older container begin; the library sets the highest bit of the first four bytes
_ADF, _MASK = b"@(#)ADF Database", bytes([0x7F] * 4 + [0xFF] * 12)

#: a node of that container: a mark, its name and its label, padded with blanks
_ADF_SOLUTION = re.compile(rb"NoDe(.{32})FlowSolution_t ", re.DOTALL)


class Cgns(Gmsh):
    """A mesh."""

    format = "CGNS meshes (.cgns)"
    keeps = "all shapes up to order 4, families by name"
    loses = "solutions, which the library passes over, zones and their order"
    options = ()
    beside = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether this is one CGNS file, in either container."""
        return len(paths) == 1 and (_is_adf(paths[0]) or holds(paths[0], "CGNSLibraryVersion"))

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """None: solutions are not read."""
        return ()

    def __init__(self, paths: Sequence[Path]) -> None:
        path = single(paths)
        _check_sizes(path)
        self.take_mesh(read_mesh(Contents(path, True, True, (), ()), with_entities=True, suffix=".cgns"))
        self.notes = [*self.notes, *_left_out(path)]


def _check_sizes(path: Path) -> None:
    """FormatError where an array is declared larger than the file can hold, which the library would take memory for."""
    if _is_adf(path):
        return
    with reading(path) as file:
        file.visititems(lambda name, node: check_stored(node, name) if hasattr(node, "shape") and node.shape else None)


def _is_adf(path: Path) -> bool:
    """Whether a file is in the older container."""
    start = leading(path, len(_ADF))
    return bytes(byte & mask for byte, mask in zip(start, _MASK, strict=False)) == _ADF


def _left_out(path: Path) -> list[str]:
    """A note where the file has solutions."""
    found = _adf_solutions(path) if _is_adf(path) else _hdf5_solutions(path)
    return [f"the solutions {', '.join(found)} were left out"] if found else []


def _adf_solutions(path: Path) -> list[str]:
    """Names of the solutions in a file of the older container, whose nodes are marked and stand one after another."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return [name.decode("ascii", "replace").strip() for name in _ADF_SOLUTION.findall(data)]


def _hdf5_solutions(path: Path) -> list[str]:
    """Paths of the solutions in an HDF5 file."""
    found: list[str] = []
    with reading(path) as file:
        file.visititems(lambda name, node: found.append(name) if _label(node) == "FlowSolution_t" else None)
    return found


def _label(node: object) -> str:
    value = getattr(node, "attrs", {}).get("label", b"")
    return value.decode("ascii", "replace").rstrip("\0 ") if isinstance(value, bytes) else str(value)
