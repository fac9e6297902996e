"""One rule for several files: parts of a mesh, steps of a series, fields of one mesh; the same in every command."""

import numpy as np
import pytest
from exodus_writer import ExodusBlock, unit_cubes, write_classic, write_hdf5

from elvis import FormatError, integrate, open_series, read
from elvis.core.data.moments import Moment
from elvis.plugins.data.data import Reading
from elvis.plugins.series.finding import find_steps
from elvis.plugins.testing import values_found

READINGS = (Reading(), Reading(moment=Moment(wants_series=True)), Reading(moment=Moment(step=-1)))


def exodus_parts(folder, write, ranges, total, has_map=True, name="run.e", time=0.0, u=lambda x: x):
    """Files of a row of cubes, each with the cubes of a range, which may overlap; u and its sides travel along."""
    places, nodes = unit_cubes(total)
    paths = []
    for number, (start, end) in enumerate(ranges):
        used = np.unique(nodes[start:end])
        own = np.searchsorted(used, nodes[start:end])
        sides = {"inflow": [(1, 4)] if start == 0 else [], "outflow": [(end - start, 2)] if end == total else []}
        extra = {"node_num_map": used + 1} if has_map else {}
        path = folder / f"{name}.{len(ranges)}.{number}"
        blocks = [ExodusBlock("fluid", "HEX8", own)]
        paths.append(write(path, blocks, places[used], sides, {"u": u(places[used, 0])}, extra=extra, time=time))
    return paths


@pytest.mark.sampled
@pytest.mark.parametrize("write", [write_classic, write_hdf5])
@pytest.mark.parametrize("has_map", [True, False])
@pytest.mark.parametrize("ranges", [[(0, 1), (1, 2)], [(0, 2), (2, 3), (3, 5)], [(0, 3), (2, 5), (4, 6)]])
def test_files_of_processes_are_one_mesh(tmp_path, write, has_map, ranges):
    """Also if they hold copies of each other's elements."""
    total = ranges[-1][1]
    paths = exodus_parts(tmp_path, write, ranges, total, has_map)
    for reading in READINGS:
        assert find_steps(paths, reading) is None
    dataset = read(*paths)
    assert integrate(dataset, "volume")[0].value == pytest.approx(total, rel=1e-13)
    assert integrate(dataset, "u")[0].value == pytest.approx(total**2 / 2, rel=1e-13)
    # what lies between two files is no boundary
    assert integrate(dataset, "area", "all")[-1].value == pytest.approx(4 * total + 2, rel=1e-13)
    for name, x in (("inflow", 0), ("outflow", total)):
        area, moment = integrate(dataset, ["area", "x"], name)
        assert (area.value, moment.value) == pytest.approx((1, x), abs=1e-13)
    assert len(dataset.remarks) == 1


def test_a_single_part_is_reported(tmp_path):
    paths = exodus_parts(tmp_path, write_classic, [(0, 1), (1, 2), (2, 3)], 3)
    assert "run.e.3.1: 1 of the 3 parts of a mesh by name" in read(paths[1]).remarks[1]
    assert "2 of the 3 parts" in read(*paths[:2]).remarks[1]


def test_parts_of_several_times_are_rejected(tmp_path):
    first = exodus_parts(tmp_path, write_classic, [(0, 1), (1, 2)], 2)
    second = exodus_parts(tmp_path / "..", write_classic, [(0, 1), (1, 2)], 2, name=f"{tmp_path.name}/late.e", time=1.0)
    second[1].rename(first[1])
    with pytest.raises(FormatError, match=r"expected the time 0\.0, found 1\.0"):
        read(*first)


def test_a_sequence_of_meshes_is_a_series(tmp_path):
    """Adaptive runs write a new file, with a number in its name, whenever the mesh changes."""
    for number, count in enumerate((1, 2, 4), 1):
        places, nodes = unit_cubes(count)
        name = "out.e" if number == 1 else f"out.e-s{number:03d}"
        blocks = [ExodusBlock("fluid", "HEX8", nodes)]
        write_classic(tmp_path / name, blocks, places, None, {"u": number + places[:, 0]}, time=0.5 * number)
    paths = sorted(tmp_path.iterdir())
    series = open_series(*paths)
    assert series.times.tolist() == [0.5, 1.0, 1.5]
    volumes = [integrate(step, "volume")[0].value for step in series]
    assert volumes == pytest.approx([1, 2, 4])
    assert integrate(read(*paths), "volume")[0].value == pytest.approx(4)
    assert integrate(read(tmp_path / "out.e-s002"), "volume")[0].value == pytest.approx(2)


def test_a_sequence_may_be_in_parts(tmp_path):
    paths = exodus_parts(tmp_path, write_classic, [(0, 1), (1, 2)], 2, name="out.e", time=1.0)
    paths += exodus_parts(tmp_path, write_classic, [(0, 1), (1, 2), (2, 3)], 3, name="out.e-s002", time=2.0)
    series = open_series(*paths)
    assert [integrate(step, "volume")[0].value for step in series] == pytest.approx([2, 3])


def vtk_cubes(path, start, u, kind=12, order=(0, 1, 2, 3, 4, 5, 6, 7), name="u"):
    """A unit cube from x = start on with a field."""
    vtk = pytest.importorskip("vtkmodules.all")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
    corners[:, 0] += start
    grid, points, ids = vtk.vtkUnstructuredGrid(), vtk.vtkPoints(), vtk.vtkIdList()
    points.SetDataTypeToDouble()
    for place in corners:
        points.InsertNextPoint(*place)
    for node in order:
        ids.InsertNextId(node)
    grid.SetPoints(points)
    grid.InsertNextCell(kind, ids)
    array = numpy_support.numpy_to_vtk(u(corners), deep=True)
    array.SetName(name)
    grid.GetPointData().AddArray(array)
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    assert writer.Write()
    return path


def test_names_of_dolfinx_identify_parts_and_steps(tmp_path):
    paths = [
        vtk_cubes(tmp_path / f"u_p{part}_{step:06d}.vtu", part, lambda x, step=step: step + x[:, 0])
        for step in range(2)
        for part in range(3)
    ]
    series = open_series(*paths)
    assert len(series) == 2
    assert [integrate(step, "u")[0].value for step in series] == pytest.approx([4.5, 7.5])
    assert integrate(read(*paths), "u")[0].value == pytest.approx(7.5)
    assert find_steps(paths[:3], READINGS[1]) is None
    assert "a part of a mesh by name" in read(paths[1]).remarks[1]


@pytest.mark.parametrize("name", ["vtkGhostType", "vtkGhostLevels"])
def test_parts_may_contain_copies_of_all_cells_of_each_other(tmp_path, name):
    """If ghost arrays mark the copies: each cell counts once, and the files are no steps."""
    paths = [tmp_path / f"piece_{number}.vtk" for number in range(2)]
    for path, starts in zip(paths, ((0, 1), (1, 0)), strict=True):
        points = [(x + start, y, z) for start in starts for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines = ["# vtk DataFile Version 3.0", "two cubes", "ASCII", "DATASET UNSTRUCTURED_GRID", "POINTS 16 double"]
        lines += [" ".join(map(str, point)) for point in points]
        lines += ["CELLS 2 18", "8 0 1 2 3 4 5 6 7", "8 8 9 10 11 12 13 14 15", "CELL_TYPES 2", "12 12"]
        lines += ["CELL_DATA 2", f"SCALARS {name} unsigned_char", "LOOKUP_TABLE default", "0 1"]
        path.write_text("\n".join(lines) + "\n")
    for reading in READINGS:
        assert find_steps(paths, reading) is None
    assert integrate(read(*paths), "volume")[0].value == pytest.approx(2, rel=1e-13)


def test_other_fields_on_the_same_mesh_are_fields(tmp_path):
    paths = [vtk_cubes(tmp_path / f"f_{i}.vtu", 0, lambda x, i=i: x[:, i], name=f"f{i}") for i in range(2)]
    for reading in READINGS:
        assert find_steps(paths, reading) is None
    assert sorted(read(*paths)) == ["f0", "f1"]


def test_fields_in_separate_files_form_steps(tmp_path):
    """Two files a step, on one mesh."""
    names = {"u": 0, "p": 1}
    paths = [
        vtk_cubes(tmp_path / f"{name}_{i}.vtu", 0, lambda x, i=i, axis=axis: i + x[:, axis], name=name)
        for i in range(2)
        for name, axis in names.items()
    ]
    for reading in READINGS:
        steps = find_steps(paths, reading).steps
        assert [sorted(path.name for path in step.files) for step in steps] == [
            ["p_0.vtu", "u_0.vtu"],
            ["p_1.vtu", "u_1.vtu"],
        ]
    dataset = read(*paths)
    assert sorted(dataset) == ["p", "u"]
    assert integrate(dataset, "u")[0].value == pytest.approx(1.5)


def test_parts_of_steps_without_marks_are_rejected(tmp_path):
    paths = [vtk_cubes(tmp_path / f"f_{i}.vtu", start, lambda x: x[:, 0]) for i, start in enumerate((0, 1, 0))]
    with pytest.raises(FormatError, match="expected parts of one mesh, or steps, found both"):
        read(*paths)


def test_partitions_in_separate_files_form_one_mesh(tmp_path):
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("box")
        box = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 2)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [box], name="fluid")
        gmsh.model.addPhysicalGroup(2, [1], name="wall")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.option.setNumber("Mesh.PartitionSplitMeshFiles", 1)
        gmsh.option.setNumber("Mesh.PartitionCreateGhostCells", 1)
        gmsh.model.mesh.partition(3)
        gmsh.write(str(tmp_path / "split.msh"))
    finally:
        gmsh.finalize()
    paths = sorted(tmp_path.glob("split_*.msh"))
    assert len(paths) == 3
    for reading in READINGS:
        assert find_steps(paths, reading) is None
    dataset = read(*paths)
    assert integrate(dataset, "volume")[0].value == pytest.approx(2, rel=1e-12)
    assert integrate(dataset, "area", "all")[-1].value == pytest.approx(10, rel=1e-12)
    assert integrate(dataset, "area", "wall")[0].value == pytest.approx(2, rel=1e-12)
    assert "partitions 1, 3 of 3" in read(paths[0], paths[2]).remarks[1]


@pytest.mark.thorough
def test_functions_of_one_space_are_steps_and_of_others_fields(tmp_path):
    mfem = pytest.importorskip("mfem.ser")
    mesh = mfem.Mesh(2, 2, "QUADRILATERAL")
    mesh.Save(str(tmp_path / "square.mesh"))
    for number, order in enumerate((1, 1, 2)):
        collection = mfem.H1_FECollection(order, 2)
        space = mfem.FiniteElementSpace(mesh, collection)
        function = mfem.GridFunction(space)
        function.Assign(float(number))
        function.Save(str(tmp_path / f"u_{number}.gf"))
    paths = [tmp_path / "square.mesh", *(tmp_path / f"u_{number}.gf" for number in range(3))]
    for reading in READINGS:
        assert [step.time for step in find_steps(paths[:3], reading).steps] == [0, 1]
        assert find_steps([paths[0], *paths[2:]], reading) is None
    assert values_found(read(*paths[:3]), "u", np.array([[0.3, 0.4, 0]]))[0] == pytest.approx(1)
    assert len(list(read(paths[0], *paths[2:]))) == 2
