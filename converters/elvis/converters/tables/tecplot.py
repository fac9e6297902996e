"""Export to Tecplot: each element as a lattice of linear cells, in text (.dat) or binary (.plt, version 112).

As in FieldConvert every element becomes lines, quadrilaterals or bricks between evenly spaced collapsed coordinates.
Each element has points of its own, so jumps stay.  Tecplot draws cells as linear ones; the error that this makes is
measured.  (Tecplot 360 Data Format Guide, "ASCII data" and "binary data file format".)
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from elvis.converters.shared.exporting import BoxTarget, Cell, Export, Piece, exporter_of
from elvis.core.base.arrays import Floats, Ints, grid_points
from elvis.core.data.dataset import Dataset
from elvis.core.files.output import replacing
from elvis.core.shapes import Shape

#: name and number of the zones of each dimension
_ZONES = {1: ("FELINESEG", 1), 2: ("FEQUADRILATERAL", 3), 3: ("FEBRICK", 5)}

#: markers of a zone, and of the end of the header
_ZONE_MARKER, _END_OF_HEADER = 299.0, 357.0
#: type of a variable in the file
_DOUBLE = 2
#: numbers in a line of text; lines may have 32000 characters
_IN_A_LINE = 500


class TecplotTarget(BoxTarget):
    """Lattices of linear cells between evenly spaced collapsed coordinates; the order is the number of cells a side."""

    def cell(self, shape: Shape, order: int) -> Cell:
        """The points of the lattice, the first coordinate fastest."""
        line = np.linspace(-1.0, 1.0, order + 1)
        nodes = grid_points(*[line] * shape.dimension)
        return Cell(shape, order, _ZONES[shape.dimension][1], nodes[:, ::-1])

    def directions(self, dimension: int) -> Iterator[int]:
        """The last direction is the slowest one."""
        return reversed(range(dimension))

    def along_line(self, order: int, places: Floats) -> Floats:
        """Piecewise linear functions."""
        steps = (places + 1) / 2 * order
        return np.asarray(np.maximum(0.0, 1 - np.abs(steps[:, None] - np.arange(order + 1))))


def lattice_cells(dimension: int, order: int) -> Ints:
    """(order^d, 2^d) the points of each cell of a lattice, around its bottom, then around its top."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    cube = [(*corner, k) for k in (0, 1) for corner in square]
    around = {1: np.array([(0,), (1,)]), 2: np.array(square), 3: np.array(cube)}
    strides = (order + 1) ** np.arange(dimension)
    corners = around[dimension] @ strides
    lowest = np.array([each[::-1] for each in product(range(order), repeat=dimension)]) @ strides
    return np.asarray(lowest[:, None] + corners)


@dataclass(frozen=True, eq=False)
class _Zone:
    """Cells of one kind: values (n,) of each variable, None for a field without values, and the points of cells."""

    name: str
    kind: tuple[str, int]
    variables: list[Floats | None]
    cells: Ints

    @property
    def points(self) -> int:
        """Number of points."""
        first = self.variables[0]
        assert first is not None
        return len(first)


def _write_dat(path: Path, export: Export, dataset: Dataset) -> None:
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(_text(_variables(export, dataset), _zones(export, dataset), dataset.time))


def _write_plt(path: Path, export: Export, dataset: Dataset) -> None:
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(_binary(_variables(export, dataset), _zones(export, dataset), dataset.time))


#: the exporters of .dat and .plt files
export_dat = exporter_of(TecplotTarget, _write_dat)
export_plt = exporter_of(TecplotTarget, _write_plt)


def _variables(export: Export, dataset: Dataset) -> list[str]:
    """Names of the coordinates and of the fields, without quotes, which end a name."""
    return [name.replace('"', "'") for name in (*"xyz"[: dataset.mesh.space], *export.names)]


def _zones(export: Export, dataset: Dataset) -> list[_Zone]:
    return [_zone(piece, dataset.mesh.space) for piece in export.pieces]


def _zone(piece: Piece, space: int) -> _Zone:
    places = piece.places.reshape(-1, 3)
    values = [None if own is None else own.reshape(-1) for own in piece.values]
    dimension, order = piece.cell.shape.dimension, piece.cell.order
    first = len(piece.cell.nodes) * np.arange(len(piece.patch))
    cells = first[:, None, None] + lattice_cells(dimension, order)
    variables = [*places.T[:space], *values]
    return _Zone(piece.patch.shape.label.lower(), _ZONES[dimension], variables, cells.reshape(-1, cells.shape[-1]))


def _text(names: Sequence[str], zones: Sequence[_Zone], time: float | None) -> Iterator[str]:
    """The lines of a text file."""
    yield "VARIABLES = " + " ".join(f'"{name}"' for name in names) + "\n"
    for zone in zones:
        missing = [str(number) for number, own in enumerate(zone.variables, 1) if own is None]
        yield f'ZONE T="{zone.name}", NODES={zone.points}, ELEMENTS={len(zone.cells)}\n'
        yield f"DATAPACKING=BLOCK, ZONETYPE={zone.kind[0]}\n"
        yield f"PASSIVEVARLIST=[{','.join(missing)}]\n" if missing else ""
        yield "" if time is None else f"STRANDID=1, SOLUTIONTIME={time!r}\n"
        for own in zone.variables:
            yield from _lines(own.tolist() if own is not None else [])
        for cell in (zone.cells + 1).tolist():
            yield " ".join(map(str, cell)) + "\n"


def _lines(numbers: list[float]) -> Iterator[str]:
    for first in range(0, len(numbers), _IN_A_LINE):
        yield " ".join(map(repr, numbers[first : first + _IN_A_LINE])) + "\n"


def _binary(names: Sequence[str], zones: Sequence[_Zone], time: float | None) -> Iterator[bytes]:
    """The parts of a binary file: the header of each zone, then the data of each."""
    yield b"#!TDV112" + struct.pack("<ii", 1, 0) + _string("") + struct.pack("<i", len(names))
    yield from map(_string, names)
    # no parent; strand and time of the solution; default colour; type; values at points; no neighbours are stored
    strand, moment = (-1, 0.0) if time is None else (0, time)
    for zone in zones:
        yield struct.pack("<f", _ZONE_MARKER) + _string(zone.name)
        yield struct.pack("<iidiiiii", -1, strand, moment, -1, zone.kind[1], 0, 0, 0)
        yield struct.pack("<iiiiii", zone.points, len(zone.cells), 0, 0, 0, 0)
    yield struct.pack("<f", _END_OF_HEADER)
    for zone in zones:
        yield from _data(zone)


def _data(zone: _Zone) -> Iterator[bytes]:
    """The data section of a zone: formats, fields without values, ranges, values, points of cells from 0."""
    is_passive = [own is None for own in zone.variables]
    held = [own for own in zone.variables if own is not None]
    yield struct.pack("<f", _ZONE_MARKER) + np.full(len(zone.variables), _DOUBLE, "<i4").tobytes()
    yield struct.pack("<i", any(is_passive))
    if any(is_passive):
        yield np.array(is_passive, "<i4").tobytes()
    # neither variables nor the points of cells are shared with other zones
    yield struct.pack("<ii", 0, -1)
    yield np.array([(own.min(), own.max()) for own in held], "<f8").tobytes()
    for own in held:
        yield own.astype("<f8").tobytes()
    yield zone.cells.astype("<i4").tobytes()


def _string(text: str) -> bytes:
    """A text as 32-bit characters, which end with zero."""
    return np.array([*map(ord, text), 0], "<i4").tobytes()
