"""Lagrange wedges of two numberings: VTK 8 ran the nodes of the third quadrilateral the other way."""

import numpy as np
import pytest

from elvis.converters.vtk.cells import Cell, Kind
from elvis.converters.vtk.numbering import third_face
from elvis.converters.vtk.vtk import Vtk
from elvis.core.base.errors import FormatError
from elvis.plugins.testing import check, positions_at

pytest.importorskip("vtk")


def wedge(degrees, seed=0, scale=0.05):
    """A curved wedge: its cell and the places of its nodes, as VTK 9 numbers them."""
    i, _, k = degrees
    cell = Cell(Kind(73, (i + 1) * (i + 2) // 2 * (k + 1), degrees), "")
    return cell, cell.nodes + scale * np.random.default_rng(seed).uniform(-1, 1, cell.nodes.shape)


def as_vtk_8(cell, places):
    """The same places as VTK 8 numbers them, found without the converter: (0, s, t) and (0, 1 - s, t) exchanged."""
    result = places.copy()
    for at, (r, s, t) in enumerate(cell.nodes):
        if r == 0 and 0 < s < 1 and 0 < t < 1:
            other = [n for n, node in enumerate(cell.nodes) if np.allclose(node, (0, 1 - s, t))]
            result[other[0]] = places[at]
    return result


def saved(path, degrees, *cells):
    """A file of wedges at given places, with a quadratic function of them at the nodes, by the library's writer."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    x = np.concatenate([places + np.array([2.0 * i, 0, 0]) for i, places in enumerate(cells)])
    u, own = (x[:, 0] - 2 * x[:, 1]) ** 2, np.tile(np.array([degrees], float), (len(cells), 1))
    data, points, writer = vtkUnstructuredGrid(), vtkPoints(), vtkXMLUnstructuredGridWriter()
    points.SetData(numpy_to_vtk(x, deep=True))
    data.SetPoints(points)
    for nodes in np.arange(len(x)).reshape(len(cells), -1):
        data.InsertNextCell(73, len(nodes), nodes.tolist())
    for name, values, to in (("u", u, data.GetPointData()), ("HigherOrderDegrees", own, data.GetCellData())):
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        to.AddArray(array)
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    writer.Write()
    return path


def test_a_wedge_of_mfem_is_a_straight_one(findings):
    """Two wedges of order 6, half a cube each: their map is that of their corners, as the text of the file has them."""
    path = findings / "wedge_in_1x1x1_block_o6.vtk"
    words = path.read_text().split()
    at, cells = words.index("POINTS") + 3, words.index("CELLS") + 3
    x = np.array(words[at : at + 3 * 343], float).reshape(-1, 3)
    done = check(Vtk, [path])
    assert any("VTK 8" in note for note in done.report.notes)
    r, s, t = points = np.random.default_rng(1).uniform(0, 0.5, (3, 40))
    for cell in range(2):
        start = cells + cell * 197 + 1
        a, b, c, top = (x[int(words[start + i])] for i in range(4))
        wanted = a + np.outer(r, b - a) + np.outer(s, c - a) + np.outer(t, top - a)
        found = positions_at(done, 0, np.full(40, cell), points.T)
        assert np.abs(found - wanted).max() < 1e-5  # text of six digits


@pytest.mark.parametrize("degrees", [(3, 3, 3), (4, 4, 2), (6, 6, 3)])
def test_both_numberings_give_the_same_values(tmp_path, degrees):
    cell, places = wedge(degrees)
    new = Vtk([saved(tmp_path / "new.vtu", degrees, places)])
    old = Vtk([saved(tmp_path / "old.vtu", degrees, as_vtk_8(cell, places))])
    assert not np.array_equal(as_vtk_8(cell, places), places)
    points = np.random.default_rng(2).uniform(0, 0.5, (20, 3))
    assert np.array_equal(old.positions(old.blocks[0], points), new.positions(new.blocks[0], points))
    assert np.array_equal(*(each.sample(each.blocks[0], each.fields[0], points) for each in (old, new)))
    assert [any("VTK 8" in note for note in each.notes) for each in (old, new)] == [True, False]
    forced = Vtk([tmp_path / "old.vtu"], wedges="as-read")
    assert np.abs(forced.positions(forced.blocks[0], points) - new.positions(new.blocks[0], points)).max() > 1e-2
    told = Vtk([tmp_path / "old.vtu"], wedges="vtk8")
    assert np.array_equal(told.positions(told.blocks[0], points), new.positions(new.blocks[0], points))


def test_wedges_of_order_2_have_one_numbering():
    cell, _ = wedge((2, 2, 2))
    assert np.array_equal(*third_face(cell))


def test_ambiguous_numberings_are_rejected(tmp_path):
    degrees = (3, 3, 3)
    cell, places = wedge(degrees)
    both = saved(tmp_path / "both.vtu", degrees, places, as_vtk_8(cell, places))
    with pytest.raises(FormatError, match=r"both\.vtu: expected wedges of one numbering, found 1 as in VTK 9 and 1 as"):
        Vtk([both])
    inside, mirrored = third_face(cell)
    folded = places.copy()
    folded[inside] = (places[inside] + places[mirrored]) / 2
    with pytest.raises(FormatError, match=r"found 0 as in VTK 9 and 0 as in VTK 8; choose one with the option wedges"):
        Vtk([saved(tmp_path / "folded.vtu", degrees, folded)])
    assert Vtk([tmp_path / "folded.vtu"], wedges="as-read").blocks
