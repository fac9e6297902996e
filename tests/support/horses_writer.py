"""Small files of HORSES3D, after its documentation: arrays of elements with numbers of nodes of their own."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from trixi_writer import lobatto_line

#: the six reference values of a flow, and of none
FLOW = (1.4, 287.0, 68.0, 1.2, 288.0, 0.2)
NONE = (0.0,) * 6


def line_of(nodes: int, count: int) -> Any:
    """Gauss (1) or Gauss-Lobatto (2) nodes."""
    return legendre.leggauss(count)[0] if nodes == 1 else lobatto_line(count - 1)


def nodes_of(nodes: int, counts: Sequence[int]) -> Any:
    """(n, 3) nodes of a cube, the first direction fastest."""
    z, y, x = np.meshgrid(*(line_of(nodes, count) for count in counts[::-1]), indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def write_horses(
    path: Path,
    kind: int,
    nodes: int,
    elements: Sequence[tuple[Sequence[int], Sequence[Any]]],
    sensors: Sequence[float] | None = None,
    references: Sequence[float] = FLOW,
    time: float = 0.75,
) -> Path:
    """A file of a kind: of each element the numbers of nodes and its arrays (n, k), the sensor after the first part.

    The arrays of a file with sensors come in two lists, those before and those after the sensor.
    """
    data = b"RESULTS/case.hsol".ljust(128, b"\0")
    data += struct.pack("<4i7di", kind, nodes, len(elements), 12, time, *references, 88)
    for number, (counts, arrays) in enumerate(elements):
        before, after = arrays if sensors is not None else (arrays, ())
        data += struct.pack("<5i", 4, before[0].shape[1], *counts)
        data += b"".join(np.ascontiguousarray(array, "<f8").tobytes() for array in before)
        data += b"" if sensors is None else struct.pack("<d", sensors[number])
        data += b"".join(np.ascontiguousarray(array, "<f8").tobytes() for array in after)
    path.write_bytes(data + struct.pack("<i", 99))
    return path


def write_zones(path: Path, zones: Sequence[tuple[str, Sequence[int], Sequence[int]]]) -> Path:
    """A list of boundaries: names, elements and sides from 1."""
    lines = [str(len(zones))]
    for name, elements, sides in zones:
        lines += [f" {name}", str(len(elements))]
        lines += ["".join(f"{number:8d}" for number in numbers) for numbers in (elements, sides)]
    path.write_text("\n".join(lines) + "\n")
    return path


def boxes(counts: Sequence[int], bend: Callable[[Any], Any]) -> list[Callable[[Any], Any]]:
    """The maps of the cells of a box of unit cubes, from reference points to places."""
    corners = [(i, j, k) for k in range(counts[2]) for j in range(counts[1]) for i in range(counts[0])]
    return [lambda r, corner=corner: bend(np.array(corner) + (r + 1) / 2) for corner in corners]
