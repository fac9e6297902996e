"""Parts of VTK meshes: each has its own version of the format, and a cell that several hold counts once."""

import numpy as np
import pytest
from vtk_writer import cube, grid, linear, one, write

from elvis import integrate, read
from elvis.converters.vtk.cells import Cell, Kind
from elvis.converters.vtk.numbering import upright
from elvis.converters.vtk.vtk import Vtk
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import values_found

pytest.importorskip("vtk")


def parted(path, parts):
    """An index of parts, each a grid."""
    lines = ['<VTKFile type="PUnstructuredGrid" version="0.1"><PUnstructuredGrid GhostLevel="0">']
    for i, part in enumerate(parts):
        write(path.with_name(f"part_{i}.vtu"), part)
        lines.append(f'<Piece Source="part_{i}.vtu"/>')
    path.write_text("\n".join([*lines, "</PUnstructuredGrid></VTKFile>"]))
    return path


def test_each_part_has_its_own_numbering_of_hexahedra(tmp_path):
    """Three parts, of which one was written by an old version and says that it is new: not a matter of majority."""
    hexahedron = one(72, 64)
    places = np.array([hexahedron.GetPoint(i) for i in range(64)])
    along = np.array([1, 0, 0])
    parts = [grid(places + i * along, [(72, range(64))], {"u": linear(places + i * along)}) for i in range(3)]
    cell = Cell(Kind(72, 64, (0, 0, 0)), "")
    first, second = upright(cell)
    order = np.arange(64)
    order[first], order[second] = second, first
    moved = places[order] + along
    parts[1] = grid(moved, [(72, range(64))], {"u": linear(moved)})
    dataset = read(parted(tmp_path / "all.pvtu", parts))
    points = places[:8].mean(axis=0) + np.array([(i, 0.3, 0.2) for i in range(3)])
    assert np.abs(values_found(dataset, "u", points) - linear(points)).max() < 1e-12
    assert integrate(dataset, "u - (1 + x - 2*y + 0.5*z)")[0].value == pytest.approx(0, abs=1e-13)
    assert [remark for remark in dataset.remarks if "part_1.vtu: edges of hexahedra" in remark]


@pytest.mark.parametrize(("part", "one_mesh"), [(0.5, True), (2.0, False)])
def test_cells_more_than_a_millionth_apart_are_distinct(tmp_path, part, one_mesh):
    """Fields of two files go together where the meshes are one: half and twice as far apart as that may be."""
    x, cells = cube(order=1)
    corner = np.zeros(x.shape)
    corner[0, 0] = part * 1e-6 * np.ptp(x, axis=0).max()
    first = write(tmp_path / "a.vtu", grid(x, cells, {"u": linear(x)}))
    second = write(tmp_path / "b.vtu", grid(x + corner, cells, {"v": linear(x)}))
    mesh = convert(Vtk([first, second])).dataset.mesh
    assert (len(mesh.of(Shape.TETRAHEDRON)) == 2) == one_mesh


@pytest.mark.parametrize("marks", [True, False])
def test_copies_of_cells_in_other_parts_count_once(tmp_path, marks):
    """Two parts share a cell, which the second one marks as a ghost, or doesn't."""
    x, cells = cube(order=2)
    far = x + np.array([1, 0, 0])
    both = grid(
        np.concatenate([far, x]),
        [*cells, *((kind, np.add(nodes, len(x))) for kind, nodes in cells[:1])],
        {"u": linear(np.concatenate([far, x]))},
    )
    if marks:
        from vtkmodules.util.numpy_support import numpy_to_vtk

        ghosts = numpy_to_vtk(np.array([0] * len(cells) + [1], np.uint8), deep=True)
        ghosts.SetName("vtkGhostType")
        both.GetCellData().AddArray(ghosts)
    path = parted(tmp_path / "all.pvtu", [grid(x, cells, {"u": linear(x)}), both])
    dataset, whole = read(path), read(write(tmp_path / "one.vtu", grid(x, cells)))
    twice = 2 * integrate(whole, "volume")[0].value
    assert integrate(dataset, "volume")[0].value == pytest.approx(twice, rel=1e-12)
    told = [remark for remark in dataset.remarks if "1 cells that are listed twice, each once, were skipped" in remark]
    assert bool(told) is not marks


def test_fields_that_hide_coordinates_are_reported(tmp_path):
    places, cells = cube()
    write(tmp_path / "a.vtu", grid(places, cells, {"x": linear(places), "u": linear(places)}))
    notes = convert(Vtk([tmp_path / "a.vtu"])).report.notes
    assert [note for note in notes if "coordinate" in note] == [
        "field x has the name of a coordinate: in expressions x is the field"
    ]
