"""Files of every shape are opened by Gmsh and by VTK, with our values and places between the nodes.

Each program works in a process of its own, for what it can't hold crashes it or ends in a message of its own.
"""

import subprocess
import sys

import numpy as np
import pytest

from elvis import integrate, read
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field
from elvis.plugins.conversion.exporting import exporter

SHAPES = [
    Shape.TRIANGLE,
    Shape.QUADRILATERAL,
    Shape.TETRAHEDRON,
    Shape.PYRAMID,
    Shape.PRISM,
    Shape.HEXAHEDRON,
]

#: the numbering of nodes goes from one shell of an element to the next: orders to 5 have all kinds of nodes
ORDERS = (1, 2, 3, 4, 5, 9)
#: shapes for which collapsed hexahedra stand from order 3 on: areas of their sides take long
COLLAPSED = (Shape.PYRAMID, Shape.PRISM)

#: opens files and prints for each the number of elements, and the largest difference of u to 1 + x^p between nodes
GMSH = """
import sys
import gmsh, numpy as np
gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
for text in sys.argv[1:]:
    path, order = text.split("=")
    gmsh.clear()
    gmsh.open(path)
    kind, tags, values, time, count = gmsh.view.getModelData(gmsh.view.getTags()[0], 0)
    known = dict(zip(tags, values))
    worst, number = 0.0, 0
    for type_ in gmsh.model.mesh.getElementTypes(gmsh.model.getDimension()):
        own, nodes = gmsh.model.mesh.getElementsByType(type_)
        nodes = np.reshape(nodes, (len(own), -1))
        local = np.random.default_rng(0).dirichlet([1, 1, 1, 1], 20)[:, :3]
        table = np.reshape(gmsh.model.mesh.getBasisFunctions(type_, local.ravel(), "Lagrange")[1], (20, -1))
        for tag, row in zip(own, nodes):
            places = table @ np.array([gmsh.model.mesh.getNode(node)[0] for node in row])
            worst = max(worst, np.abs(table @ known[tag] - 1 - places[:, 0] ** int(order)).max())
            number += 1
    print(number, worst)
"""

VTK = """
import sys
import numpy as np
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader
for text in sys.argv[1:]:
    path, order = text.split("=")
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(path)
    reader.Update()
    grid = reader.GetOutput()
    values, worst = grid.GetPointData().GetArray("u"), 0.0
    for number in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(number)
        for local in np.random.default_rng(0).dirichlet([1, 1, 1, 1], 20)[:, :3]:
            place, weights = [0.0] * 3, [0.0] * cell.GetNumberOfPoints()
            cell.EvaluateLocation(reference(0), local, place, weights)
            found = sum(w * values.GetValue(cell.GetPointId(i)) for i, w in enumerate(weights))
            worst = max(worst, abs(found - 1 - place[0] ** int(order)))
    print(grid.GetNumberOfCells(), worst)
"""


@pytest.mark.sampled
@pytest.mark.parametrize(("suffix", "program", "package"), [("msh", GMSH, "gmsh"), ("vtu", VTK, "vtk")])
@pytest.mark.parametrize("shape", SHAPES)
def test_other_programs_read_the_same_values(tmp_path, shape, suffix, program, package):
    pytest.importorskip(package)
    texts = []
    for order in ORDERS:
        data = with_field(grid(shape, 1), lambda p, order=order: 1 + p[:, 0] ** order, order + 1)
        losses = []
        path = tmp_path / f"{order}.{suffix}"
        exporter(suffix)(data, None, None, path, losses.extend)
        assert all(loss.is_within(1e-7) for loss in losses)
        texts.append(f"{path}={order}")
    found = subprocess.run([sys.executable, "-c", program, *texts], capture_output=True, text=True, check=False)
    assert not found.returncode, found.stderr
    lines = [line.split() for line in found.stdout.splitlines()]
    elements = len(data.mesh.domain_ids())
    assert [int(line[0]) for line in lines] == [elements] * len(ORDERS)
    # Gmsh has few digits at its highest orders
    assert max(float(line[1]) for line in lines[:-1]) < 1e-10
    assert max(float(line[1]) for line in lines) < 1e-6


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("shape", "order"),
    [(shape, order) for shape in SHAPES for order in (1, 2, 4) if order < 3 or shape not in COLLAPSED],
)
def test_boundaries_become_physical_groups_in_gmsh(tmp_path, shape, order):
    pytest.importorskip("gmsh")
    data = with_field(grid(shape, 2), lambda p: p[:, 1], order + 1)
    exporter("msh")(data, None, None, tmp_path / "a.msh", lambda losses: None)
    again = read(tmp_path / "a.msh", cache=False)
    names = [each.name or each.label or f"boundary {each.id}" for each in data.mesh.composites]
    held = {each.name for each in again.mesh.composites}
    wanted = integrate(data, "1", "all")
    assert integrate(again, "1", "all").value == pytest.approx(wanted.value, rel=1e-12)
    for composite, name in zip(data.mesh.composites, names, strict=True):
        if any(tag in ("E", "F") for tag, _ in composite.parts):
            assert name in held
            before, after = (integrate(own, "1", over) for own, over in ((data, str(composite.id)), (again, name)))
            assert after.value == pytest.approx(before.value, rel=1e-12)
    assert again.time is None
    assert np.isfinite(again["u"].blocks[0].coefficients).all()
