"""Quadratic tetrahedra with a cubic field from the files of other programs: seconds and memory of each step.

python benchmarks/conversion.py FORMAT FILE OUTPUT      one process that converts a file and prints JSON
"""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from cases import bend
from measuring import ENVIRONMENT
from million import Diary
from tables import Table, mebibytes, seconds

from elvis import Dataset, Shape, write
from elvis.core.base.arrays import Floats, Ints
from elvis.core.testing import grid

#: converters, and the libraries that make and read their files
FORMATS = {"gmsh": "gmsh", "vtk": "vtkmodules"}
LABELS = {"gmsh": "MSH 4.1, binary", "vtk": "VTK Lagrange"}
STEPS = ("read", "project", "convert", "write")

#: peak memory over the arrays of the result
LIMIT = 5.0


def measure(cells: tuple[int, ...]) -> dict[str, Any]:
    """Make files of 6 cells^3 elements and convert each in a process of its own."""
    runs = []
    for kind, library in FORMATS.items():
        for count in cells if find_spec(library) else ():
            with TemporaryDirectory() as folder:
                path = Path(folder) / f"case.{'msh' if kind == 'gmsh' else 'vtu'}"
                MAKERS[kind](path, count)
                command = [sys.executable, __file__, kind, str(path), f"{folder}/out.xml"]
                process = subprocess.run(command, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True)
                found = json.loads(process.stdout.splitlines()[-1])
                runs.append({"format": kind, "elements": 6 * count**3, "file": path.stat().st_size, **found})
    return {"runs": runs}


def steps(kind: str, path: Path, output: Path) -> dict[str, Any]:
    """Read, project the fields alone, convert as a whole, write."""
    from elvis.converters.gmsh.gmsh import Gmsh
    from elvis.converters.vtk.vtk import Vtk
    from elvis.plugins.conversion.converting import convert
    from elvis.plugins.projection.fitting import fit_fields
    from elvis.plugins.projection.sampling import Sampler

    # the libraries themselves don't count
    import_module({"gmsh": "gmsh", "vtk": "vtkmodules.vtkIOXML"}[kind])
    diary = Diary()
    source = diary.step("read", lambda: {"gmsh": Gmsh, "vtk": Vtk}[kind]([path]))
    conversion = diary.step("convert", partial(convert, source, files=[path]))
    diary.step("write", partial(write, conversion.dataset, output))
    diary.step("project", lambda: fit_fields(Sampler(source), conversion.blocks, source.fields))
    base = diary.steps["read"]["before"]
    return {
        "steps": diary.steps,
        "arrays": size(conversion.dataset),
        "peak": max(diary.steps[name]["peak"] for name in ("read", "convert", "write")) - base,
        "states": [each.state for each in (conversion.report.geometry, *conversion.report.fields)],
    }


def size(dataset: Dataset) -> int:
    """Bytes of the arrays of mesh and fields."""
    mesh = dataset.mesh
    arrays = [mesh.vertex_ids, mesh.vertices]
    arrays += [array for entities in mesh.entities.values() for array in (entities.ids, entities.members)]
    for curves in (mesh.edge_curves, mesh.face_curves):
        arrays += [curves.rows, curves.kinds, curves.offsets, curves.points]
    arrays += [block.coefficients for field in dataset.fields for block in field.blocks]
    return sum(array.nbytes for array in arrays)


def table(numbers: dict[str, Any]) -> Table:
    """A row a file."""
    columns = [
        "from",
        "elements",
        "file MiB",
        *(f"{name} s" for name in STEPS),
        "CPU s",
        "CPU us an element",
        "peak MiB",
        "peak / arrays",
    ]
    shown = Table("Conversion, quadratic tetrahedra with a cubic field", columns)
    for run in numbers["runs"]:
        times = [run["steps"][name]["seconds"] for name in STEPS]
        busy = sum(run["steps"][name]["processor"] for name in ("read", "convert", "write"))
        costs = [seconds(busy), f"{1e6 * busy / run['elements']:.1f}"]
        figures = [f"{run['elements']:,}", mebibytes(run["file"]), *map(seconds, times), *costs]
        shown.rows.append(
            [LABELS[run["format"]], *figures, mebibytes(run["peak"]), f"{run['peak'] / run['arrays']:.1f}"]
        )
    shown.notes = [
        "Project: fitting the field alone, once more; convert: topology, curves, the fit, one trace on what elements "
        "share, and the check of errors. Peak: above what the process held before reading. "
        "CPU: read, convert and write; of the process itself, without the one in which a library reads. "
        f"Limits: project at most as long as read; peak at most {LIMIT:.0f} times the arrays of the result."
    ]
    return shown


def lattice(cells: int, order: int, nodes: Floats) -> tuple[Floats, Ints]:
    """Nodes (n, 3) of the cube's tetrahedra, shared, in the unit cube; and rows (k, m) of those of each element.

    nodes  (m, 3) reference coordinates in [0, 1] of an element's nodes
    """
    mesh, side = grid(Shape.TETRAHEDRON, cells), order * cells + 1
    from elvis.core.mapping.orientation import local_vertices

    corners = mesh.vertices[local_vertices(mesh, Shape.TETRAHEDRON)]
    weights = np.column_stack([1 - nodes.sum(axis=1), nodes])
    places = np.rint(np.einsum("kci,mc->kmi", corners, weights) * (side - 1)).astype(np.int64)
    rows = places @ np.array([1, side, side * side])
    points = np.indices((side,) * 3).reshape(3, -1)[::-1].T / (side - 1)
    return points, rows


def field(points: Floats) -> Floats:
    """Something smooth."""
    return np.sin(3 * points[:, 0] + points[:, 1]) * np.cos(2 * points[:, 2])


def quadratic(points: Floats, cells: int) -> Floats:
    """Points moved a little; as in cases, but kept small against an element."""
    return points + (bend(points) - points) * min(1.0, 4 / cells)


def make_gmsh(path: Path, cells: int) -> None:
    """Nodes shared, the field by a scheme of cubic functions on each element."""
    import gmsh

    from elvis.converters.shared.apart import ignore_closed_pipes

    gmsh.initialize(["benchmark"], readConfigFiles=False, interruptible=False)
    ignore_closed_pipes()
    gmsh.option.setNumber("General.Terminal", 0)
    map_type, field_type = 11, 29
    mesh_nodes, field_nodes = (
        np.array(gmsh.model.mesh.getElementProperties(kind)[4]).reshape(-1, 3) for kind in (map_type, field_type)
    )
    points, rows = lattice(cells, 2, mesh_nodes)
    gmsh.model.add("cube")
    gmsh.model.addDiscreteEntity(3, 1)
    gmsh.model.mesh.addNodes(3, 1, 1 + np.arange(len(points)), quadratic(points, cells).reshape(-1))
    gmsh.model.mesh.addElementsByType(1, map_type, 1 + np.arange(len(rows)), (1 + rows).reshape(-1))
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.write(str(path))
    gmsh.finalize()

    # functions of the cubic nodes as combinations of monomials
    exponents = np.array([(a, b, c) for a in range(4) for b in range(4 - a) for c in range(4 - a - b)])
    coefficients = np.linalg.inv(np.prod(field_nodes[:, None] ** exponents[None], axis=2)).T
    finer, own = lattice(cells, 3, field_nodes)
    lines = np.empty(len(own), [("head", "<i4", (2,)), ("values", "<f8", (20,))])
    lines["head"][:, 0], lines["head"][:, 1], lines["values"] = 1 + np.arange(len(own)), 20, field(finer)[own]
    with path.open("ab") as file:
        matrices = "".join(
            f"{len(m)} {m.shape[1]}\n" + "\n".join(" ".join(map(repr, row)) for row in m.tolist()) + "\n"
            for m in (coefficients, exponents.astype(float))
        )
        file.write(f'$InterpolationScheme\n"cubic"\n1\n5\n2\n{matrices}$EndInterpolationScheme\n'.encode())
        file.write(f'$ElementNodeData\n2\n"u"\n"cubic"\n1\n0.0\n3\n0\n1\n{len(own)}\n'.encode())
        file.write(lines.tobytes() + b"\n$EndElementNodeData\n")


def make_vtk(path: Path, cells: int) -> None:
    """Lagrange cells of order 3, points shared, for VTK has one order for map and field; the map is quadratic."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkLagrangeTetra, vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    cell = vtkLagrangeTetra()
    cell.GetPoints().SetNumberOfPoints(20)
    cell.GetPointIds().SetNumberOfIds(20)
    cell.Initialize()
    nodes = np.array(cell.GetParametricCoords()).reshape(-1, 3)
    points, rows = lattice(cells, 3, nodes)
    grid_, places, connectivity = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
    places.SetData(numpy_to_vtk(interpolated(points, rows, nodes, cells), deep=True))
    offsets = 20 * np.arange(len(rows) + 1)
    connectivity.SetData(
        numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(rows.reshape(-1), deep=True)
    )
    grid_.SetPoints(places)
    grid_.SetCells(71, connectivity)
    values = numpy_to_vtk(field(points), deep=True)
    values.SetName("u")
    grid_.GetPointData().AddArray(values)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid_)
    writer.Write()


def interpolated(points: Floats, rows: Ints, nodes: Floats, cells: int) -> Floats:
    """Places (n, 3) of the cubic nodes under the quadratic map of each element."""
    own = np.array([(a, b, c) for a in range(3) for b in range(3 - a) for c in range(3 - a - b)]) / 2
    powers = np.rint(2 * own)
    table = np.prod(nodes[:, None] ** powers, axis=2) @ np.linalg.inv(np.prod(own[:, None] ** powers, axis=2))
    coarse, members = lattice(cells, 2, own)
    moved, places = quadratic(coarse, cells), np.empty_like(points)
    for first in range(0, len(rows), 4096):
        part = slice(first, first + 4096)
        places[rows[part]] = table @ moved[members[part]]
    return places


MAKERS = {"gmsh": make_gmsh, "vtk": make_vtk}

if __name__ == "__main__":
    print(json.dumps(steps(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))))
