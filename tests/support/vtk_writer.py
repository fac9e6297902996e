"""VTK files of a few cells, by the library's writers."""

import numpy as np

from elvis.converters.vtk.cells import LAGRANGE, Cell, Kind
from elvis.core.shapes import Shape

#: number of nodes of Lagrange and Bezier cells of one order
NODES = {
    Shape.SEGMENT: lambda p: p + 1,
    Shape.TRIANGLE: lambda p: (p + 1) * (p + 2) // 2,
    Shape.QUADRILATERAL: lambda p: (p + 1) ** 2,
    Shape.TETRAHEDRON: lambda p: (p + 1) * (p + 2) * (p + 3) // 6,
    Shape.PRISM: lambda p: (p + 1) ** 2 * (p + 2) // 2,
    Shape.HEXAHEDRON: lambda p: (p + 1) ** 3,
}


def grid(points, cells, point_data=None, cell_data=None):
    """The library's grid of points (n, 3) and cells, pairs of type and nodes, with arrays by name."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkIdList, vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    result, places = vtkUnstructuredGrid(), vtkPoints()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
    result.SetPoints(places)
    for kind, nodes in cells:
        ids = vtkIdList()
        for node in nodes:
            ids.InsertNextId(int(node))
        result.InsertNextCell(kind, ids)
    for data, arrays in ((result.GetPointData(), point_data), (result.GetCellData(), cell_data)):
        for name, values in (arrays or {}).items():
            array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
            array.SetName(name)
            data.AddArray(array)
    return result


def write(path, data):
    """The file, by the library's writer."""
    from vtkmodules import vtkIOLegacy, vtkIOXML

    kinds = {".vtk": vtkIOLegacy.vtkUnstructuredGridWriter, ".vtm": vtkIOXML.vtkXMLMultiBlockDataWriter}
    writer = kinds.get(path.suffix, vtkIOXML.vtkXMLUnstructuredGridWriter)()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    writer.Write()
    return path


def linear(x):
    return 1 + x[:, 0] - 2 * x[:, 1] + 0.5 * x[:, 2]


def one(kind, nodes, degrees=(0, 0, 0), seed=0, scale=0.03):
    """A curved cell with a linear function of the coordinates, which its functions reproduce whatever its nodes are."""
    cell = Cell(Kind(kind, nodes, degrees), "")
    x = cell.nodes + scale * np.random.default_rng(seed).uniform(-1, 1, cell.nodes.shape)
    if cell.shape.dimension < 3:
        x[:, cell.shape.dimension :] = 0
    cells = {"HigherOrderDegrees": np.array([degrees], float)} if any(degrees) else {}
    return grid(x, [(kind, range(nodes))], {"u": linear(x), "v": x}, cells)


def cube(kind=71, order=2, shift=0.0):
    """Points and cells of two curved tetrahedra that share a face."""
    cell = Cell(Kind(kind, NODES[LAGRANGE[kind]](order)), "")
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], float) + np.array([shift, 0, 0])
    parts = [corners[list(c)] for c in ((0, 1, 2, 3), (1, 4, 2, 3))]
    affine = [p[0] + cell.nodes @ (p[1:4] - p[0]) for p in parts]
    x = np.concatenate(affine)
    x += 0.05 * np.sin(x[:, [1, 2, 0]])
    return x, [(kind, np.arange(len(cell.nodes)) + i * len(cell.nodes)) for i in range(2)]
