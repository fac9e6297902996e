"""VTX arrays as DOLFINx lays them out, in blocks of processes, and the folder that ADIOS2's library makes of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from trixi_writer import lobatto_line

from elvis.converters.vtk.cells import Cell, Kind

#: numbers of nodes of an order, by VTK's type of cells
COUNTS: dict[int, Callable[[int], int]] = {
    68: lambda n: n + 1,
    69: lambda n: (n + 1) * (n + 2) // 2,
    70: lambda n: (n + 1) ** 2,
    71: lambda n: (n + 1) * (n + 2) * (n + 3) // 6,
    72: lambda n: (n + 1) ** 3,
    73: lambda n: (n + 1) ** 2 * (n + 2) // 2,
}


def vtx_nodes(kind: int, order: int, is_even: bool) -> Any:
    """(k, 3) nodes of the reference cell in VTK's order, evenly spaced or at Gauss-Lobatto places (tensors)."""
    nodes = Cell(Kind(kind, COUNTS[kind](order)), "").nodes
    line = (lobatto_line(order) + 1) / 2
    return nodes if is_even else np.where(nodes >= 0, line[np.rint(nodes * order).astype(int)], 0)


def vtx_blocks(
    cells: Sequence[Sequence[Any]], numbers: Sequence[Sequence[Any]], functions: Mapping[str, Callable[[Any], Any]]
) -> dict[str, list[Any]]:
    """The arrays of processes, each of which has cells with nodes of their own.

    cells    places (k, 3) of the nodes of each cell of each process
    numbers  (k,) of these nodes in the whole
    """
    blocks: dict[str, list[Any]] = {
        name: [] for name in ("geometry", "connectivity", "vtkOriginalPointIds", *functions)
    }
    for own, ids in zip(cells, numbers, strict=True):
        points, count = np.concatenate(own), len(own[0])
        table = np.arange(len(points)).reshape(-1, count)
        blocks["geometry"].append(points)
        blocks["connectivity"].append(np.column_stack([np.full(len(own), count), table]))
        blocks["vtkOriginalPointIds"].append(np.concatenate(ids))
        for name, function in functions.items():
            values = function(points)
            blocks[name].append(values.reshape(len(values), -1))
    return blocks


def schema_of(at_points: Sequence[str], on_cells: Sequence[str]) -> str:
    """The XML that names arrays."""
    parts = [
        f"<{section}>{''.join(f'<DataArray Name={chr(34)}{name}{chr(34)} />' for name in names)}</{section}>"
        for section, names in (("PointData", at_points), ("CellData", on_cells))
    ]
    piece = f"<UnstructuredGrid><Piece>{''.join(parts)}</Piece></UnstructuredGrid>"
    return f'<VTKFile type="UnstructuredGrid" version="2.2">{piece}</VTKFile>'


def write_vtx(path: Path, kind: int, steps: Sequence[tuple[float, Mapping[str, Sequence[Any]]]], schema: str) -> Path:
    """A folder with steps; the arrays of a step that holds no mesh are those of the first."""
    import adios2

    with adios2.Stream(str(path), "w") as stream:
        stream.write_attribute("vtk.xml", schema)
        for time, arrays in steps:
            stream.begin_step()
            stream.write("step", np.array(time))
            if "connectivity" in arrays:
                stream.write("types", np.array(kind, np.uint32))
            for name, blocks in arrays.items():
                for block in blocks:
                    own = np.ascontiguousarray(block)
                    stream.write(name, own, [], [], list(own.shape))
            stream.end_step()
    return path
