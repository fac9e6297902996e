"""Export to tables of points (.csv, and .pts of Nektar++): places and values at Gauss points of every element.

The points lie inside the elements, as many in each collapsed coordinate as a polynomial of the order has coefficients,
so that they determine the fields.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from elvis.converters.shared.exporting import BoxTarget, Cell, Export, exporter_of
from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Dataset
from elvis.core.files.columns import write_columns
from elvis.core.files.output import replacing
from elvis.core.integrals.reference_cells import box_rule
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape


class PointTarget(BoxTarget):
    """Gauss points in collapsed coordinates, and the polynomials through values there."""

    def cell(self, shape: Shape, order: int) -> Cell:
        """The points of a product of Gauss rules."""
        return Cell(shape, order, 0, box_rule((order + 1,) * shape.dimension)[0])

    def along_line(self, order: int, places: Floats) -> Floats:
        """Lagrange's functions."""
        nodes = gauss(order + 1)[0]
        inverse = np.linalg.inv(np.polynomial.legendre.legvander(nodes, order))
        return np.asarray(np.polynomial.legendre.legvander(places, order) @ inverse)


def _write_csv(path: Path, export: Export, dataset: Dataset) -> None:
    ids = [np.repeat(piece.patch.element_ids, len(piece.cell.nodes)) for piece in export.pieces]
    write_columns(path, {**_columns(export, 3), "element": np.concatenate(ids)})


def _write_pts(path: Path, export: Export, dataset: Dataset) -> None:
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(_pts_lines(_columns(export, dataset.mesh.space), dataset.mesh.space))


#: the exporters of .csv and .pts files
export_csv = exporter_of(PointTarget, _write_csv, has_time=False)
export_pts = exporter_of(PointTarget, _write_pts, has_time=False)


def _columns(export: Export, space: int) -> dict[str, Floats]:
    """Coordinates and fields by name; nan for elements without a field."""
    places = np.concatenate([piece.places.reshape(-1, 3) for piece in export.pieces])
    columns = dict(zip("xyz", places.T[:space], strict=False))
    for number, name in enumerate(export.names):
        parts = [piece.values[number] for piece in export.pieces]
        counts = [piece.places.shape[:2] for piece in export.pieces]
        held = [np.full(count, np.nan) if own is None else own for own, count in zip(parts, counts, strict=True)]
        columns[name] = np.concatenate([own.reshape(-1) for own in held])
    return columns


def _pts_lines(columns: dict[str, Floats], space: int) -> Iterator[str]:
    fields = ",".join(list(columns)[space:])
    yield f'<?xml version="1.0" encoding="utf-8" ?>\n<NEKTAR>\n<POINTS DIM="{space}" FIELDS={quoteattr(fields)}>\n'
    for row in zip(*(own.tolist() for own in columns.values()), strict=True):
        yield " ".join(map(repr, row)) + "\n"
    yield "</POINTS>\n</NEKTAR>\n"
