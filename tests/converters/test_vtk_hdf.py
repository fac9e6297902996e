"""VTKHDF files that VTK writes, and parts and steps that are written here, against VTK's own reader."""

import os
import sys

import h5py
import numpy as np
import pytest
from neko_writer import write_neko

from elvis import ElvisError, FormatError, open_series, read, sample
from elvis.converters.vtk.hdf import is_vtkhdf, read_vtkhdf
from elvis.converters.vtk.vtk import Vtk
from elvis.core.integrals import integrate
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check

hdf = pytest.importorskip("vtkmodules.vtkIOHDF")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["mfem_fichera_q3.vtu", "mfem_fichera_mixed_p2.vtu"])
def test_files_of_the_library_contain_the_written_values(solvers, tmp_path, name):
    """Lagrange cells of orders 2 and 3: all arrays arrive bit by bit, and so does the conversion."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader, writer = vtkXMLUnstructuredGridReader(), hdf.vtkHDFWriter()
    reader.SetFileName(str(solvers / "vtk" / name))
    reader.Update()
    writer.SetFileName(str(tmp_path / "a.vtkhdf"))
    writer.SetInputData(reader.GetOutput())
    writer.Write()
    done, wanted = check(Vtk, [tmp_path / "a.vtkhdf"]), convert(Vtk([solvers / "vtk" / name]))
    assert done.report.elements == wanted.report.elements
    names = [field.name for field in wanted.dataset.fields]
    assert {field.name for field in done.dataset.fields} == set(names)
    for quantity in ("1", *names[:3]):
        found = integrate(done.dataset, quantity)[0]
        assert found.value == pytest.approx(integrate(wanted.dataset, quantity)[0].value, rel=1e-12, abs=1e-13)


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def written(path, steps, is_shared=False):
    """Steps of two parts each, a square and two triangles next to it; cells may be those of the first step for all."""
    cells = [([0, 1, 2, 3], [9]), ([0, 1, 2, 0, 2, 3], [5, 5])]
    ends = [[0, 4], [0, 3, 6]]
    points, values, constants = [], [], []
    for step in range(steps):
        for part in range(2):
            own = SQUARE * [1 + step, 1, 1] + [part * (1 + step), 0, 0]
            points.append(own)
            values.append(own @ [1.0, 2, 0] + step)
            constants.append(10.0 * step + part + np.arange(len(cells[part][1])))
    times = 1 if is_shared else steps
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = [2, 2]
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        data = {
            "NumberOfPoints": np.tile([4, 4], steps),
            "NumberOfCells": np.tile([1, 2], steps),
            "NumberOfConnectivityIds": np.tile([4, 6], steps),
            "Points": np.concatenate(points),
            "Connectivity": np.concatenate([own for own, _ in cells] * times),
            "Offsets": np.concatenate(ends * times),
            "Types": np.concatenate([kinds for _, kinds in cells] * times).astype(np.uint8),
            "PointData/u": np.concatenate(values),
            "CellData/c": np.concatenate(constants),
        }
        for name, array in data.items():
            root[name] = array
        group = root.create_group("Steps")
        group.attrs["NSteps"] = steps
        number = np.arange(steps)
        offsets = {"CellOffsets": 3, "ConnectivityIdOffsets": 10}
        group["Values"] = 0.5 + number
        group["NumberOfParts"], group["PartOffsets"] = np.full(steps, 2), 2 * number
        group["PointOffsets"] = 8 * number
        for name, size in offsets.items():
            group[name] = (0 if is_shared else size) * number[:, None]
        group["PointDataOffsets/u"], group["CellDataOffsets/c"] = 8 * number, 3 * number
    return path


def by_library(path, time):
    """Points, cells and values as VTK's reader has them, part by part."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = hdf.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.UpdateTimeStep(time)
    whole = reader.GetOutputDataObject(0)
    grids = [whole.GetPartition(i) for i in range(whole.GetNumberOfPartitions())]
    counts = np.cumsum([0, *(grid.GetNumberOfPoints() for grid in grids)])
    points = [vtk_to_numpy(grid.GetPoints().GetData()) for grid in grids]
    own = [vtk_to_numpy(grid.GetCells().GetConnectivityArray()) for grid in grids]
    nodes = [first + table for first, table in zip(counts, own, strict=False)]
    lengths = [np.diff(vtk_to_numpy(grid.GetCells().GetOffsetsArray())) for grid in grids]
    values = [vtk_to_numpy(grid.GetPointData().GetArray("u")) for grid in grids]
    constants = [vtk_to_numpy(grid.GetCellData().GetArray("c")) for grid in grids]
    offsets = np.cumsum(np.concatenate([[0], *lengths]))
    return [np.concatenate(points), np.concatenate(nodes), offsets, np.concatenate(values), np.concatenate(constants)]


def test_steps_and_parts(tmp_path):
    path = written(tmp_path / "a.vtkhdf", 3)
    assert Vtk.times([path]) == [0.5, 1.5, 2.5]
    for step, time in enumerate((0.5, 1.5, 2.5)):
        (own,) = read_vtkhdf(path, step)
        found = [own["points"], own["nodes"], own["offsets"], own["point_data"]["u"][:, 0], own["cell_data"]["c"][:, 0]]
        for mine, theirs in zip(found, by_library(path, time), strict=True):
            assert np.array_equal(mine, theirs)
        dataset = check(Vtk, [path], step=str(step)).dataset if step else convert(Vtk([path], step="0")).dataset
        assert dataset.time == time
        wide = 1.0 + step
        assert integrate(dataset, "1")[0].value == pytest.approx(2 * wide, abs=1e-13)
        # u = x + 2 y + step over a box of that width, twice
        assert integrate(dataset, "u")[0].value == pytest.approx(2 * wide * (wide + 1 + step), abs=1e-12)
        wanted = wide * (10 * step) + wide / 2 * ((10 * step + 1) + (10 * step + 2))
        assert integrate(dataset, "c")[0].value == pytest.approx(wanted, abs=1e-12)


def test_steps_may_share_their_cells(tmp_path):
    path = written(tmp_path / "a.vtkhdf", 2, is_shared=True)
    (own,) = read_vtkhdf(path, 1)
    assert own["nodes"].tolist() == [0, 1, 2, 3, 4, 5, 6, 4, 6, 7]
    assert own["offsets"].tolist() == [0, 4, 7, 10]
    assert integrate(convert(Vtk([path])).dataset, "1")[0].value == pytest.approx(4, abs=1e-13)


def test_blocks_have_names(tmp_path):
    path = written(tmp_path / "a.vtkhdf", 1)
    with h5py.File(path, "r+") as file:
        del file["VTKHDF/Steps"]
        file.move("VTKHDF", "old")
        root = file.create_group("VTKHDF")
        root.attrs.create("Type", np.bytes_("PartitionedDataSetCollection"))
        file.move("old", "VTKHDF/fluid")
        root["Assembly/fluid"] = h5py.SoftLink("/VTKHDF/fluid")
    dataset = convert(Vtk([path])).dataset
    assert "fluid" in {composite.name for composite in dataset.mesh.composites}
    # blocks may have plain names and the tree those that mean something
    with h5py.File(path, "r+") as file:
        file.move("VTKHDF/fluid", "VTKHDF/Block_1")
        del file["VTKHDF/Assembly/fluid"]
        file["VTKHDF/Assembly/water"] = h5py.SoftLink("/VTKHDF/Block_1")
    assert "water" in {composite.name for composite in convert(Vtk([path])).dataset.mesh.composites}


CHANGES = [
    ("NumberOfPoints", [4, 4, 4, 4, 4, 40], "Points: expected 60 rows of numbers, found"),
    ("NumberOfParts", [2, 2, 9], "expected parts up to 6, found 13"),
    ("Offsets", [0, 4, 0, 3, 6] * 2 + [0, 5, 0, 3, 6], "Offsets: expected ascending offsets from 0 to 4"),
    ("Connectivity", [9] * 30, "Connectivity: expected points 0 to 3, found 9 to 9"),
    ("NumberOfCells", [1, 2, 1, 2, 1, -2], "expected equally many numbers of points"),
]


@pytest.mark.parametrize(("name", "values", "words"), CHANGES)
def test_bad_files(tmp_path, name, values, words):
    path = written(tmp_path / "a.vtkhdf", 3)
    with h5py.File(path, "r+") as file:
        place = "VTKHDF/Steps" if name == "NumberOfParts" else "VTKHDF"
        file[place][name][...] = values
    with pytest.raises(FormatError, match=words):
        Vtk([path])
    with h5py.File(path, "r+") as file:
        file["VTKHDF"].attrs.modify("Type", np.bytes_("ImageData"))
    assert not is_vtkhdf(path)
    assert not Vtk.opens([path])
    assert Vtk.hint(path).startswith("a VTKHDF file of the type ImageData: save an unstructured grid")
    with h5py.File(path, "r+") as file:
        file["VTKHDF/other"] = h5py.ExternalLink("b.vtkhdf", "VTKHDF")
    assert Vtk.hint(path).endswith("whose blocks lie in other files: pass those files")


@pytest.mark.parametrize(
    ("values", "words"),
    [([2, 2], r"expected 3 rows of numbers, found int64 of shape"), ([2.5] * 3, "expected a whole number")],
)
def test_incomplete_tables_of_steps(tmp_path, values, words):
    path = written(tmp_path / "a.vtkhdf", 3)
    with h5py.File(path, "r+") as file:
        steps = file["VTKHDF/Steps"]
        del steps["NumberOfParts"]
        steps["NumberOfParts"] = values
    with pytest.raises(FormatError, match=f"Steps/NumberOfParts: {words}"):
        Vtk([path])


def bent(points):
    """Elements all of whose edges are curved."""
    x, y, z = points.T
    return np.stack(
        [x + 0.05 * np.sin(2 * y + z), y + 0.1 * np.sin(x + z), z + 0.1 * np.sin(3 * x) * (y + 0.3)], axis=1
    )


NEKO_FIELDS = {
    "Pressure": lambda x, step: x[:, 0] ** 2 + step,
    "Velocity": lambda x, step: np.stack([(1 + step) * x[:, 0], x[:, 1] - step, x[:, 2]], axis=1),
}


def without_vtk(monkeypatch):
    """As if the library were not installed."""
    for name in ("vtk", "vtkmodules"):
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize("bend", [lambda x: x, bent])
def test_files_of_neko_need_no_library(tmp_path, monkeypatch, bend):
    """Values lie in a file a step, nodes at Gauss-Lobatto places; also read from another folder."""
    path = write_neko(tmp_path / "field_0.vtkhdf", 5, 3, bend, NEKO_FIELDS)
    without_vtk(monkeypatch)
    series = open_series(path, cache=False)
    assert series.times.tolist() == [0.0, 0.5, 1.0]
    line = (np.polynomial.legendre.leggauss(4)[0] + 1) / 2
    inside = np.stack(np.meshgrid(4 * line, line, line), axis=-1).reshape(-1, 3)
    for step in (0, 2):
        if bend is bent:
            # the nodes are where values are exact, whatever the map is between them
            with h5py.File(path) as file:
                inside = file["VTKHDF/Points"][::7]
        found = sample(series[step], ["Velocity_x", "Velocity_y", "Pressure"], inside).values
        x, y, _ = inside.T
        assert found == pytest.approx(np.stack([(1 + step) * x, y - step, x**2 + step], axis=1), abs=1e-11)


def test_other_files_of_vtk_name_the_library(tmp_path, monkeypatch):
    (tmp_path / "a.vtk").write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n")
    path = write_rare(tmp_path / "a.vtkhdf")
    without_vtk(monkeypatch)
    with pytest.raises(ElvisError, match=r"needs vtk, which is not installed; pip install 'elvis-viz\[vtk\]'"):
        read(tmp_path / "a.vtk")
    with pytest.raises(ElvisError, match=r"cells of type 30 need the library vtk, .* pip install 'elvis-viz\[vtk\]'"):
        read(path)


def write_rare(path):
    """A quadrilateral that is quadratic in one direction."""
    with h5py.File(written(path, 1), "r+") as file:
        root = file["VTKHDF"]
        del root["Steps"], root["CellData"], root["PointData"]
        new = {"NumberOfPoints": [6], "NumberOfCells": [1], "NumberOfConnectivityIds": [6], "Offsets": [0, 6]}
        new |= {"Points": np.zeros((6, 3)), "Connectivity": np.arange(6), "Types": np.array([30], np.uint8)}
        for name, values in new.items():
            del root[name]
            root[name] = values
    return path


def test_parts_in_separate_files(tmp_path):
    """As VTK's writer makes them."""
    vtk = pytest.importorskip("vtkmodules.all")
    parts = vtk.vtkPartitionedDataSet()
    for number in range(3):
        source = vtk.vtkCellTypeSource()
        source.SetCellType(vtk.VTK_HEXAHEDRON)
        source.SetBlocksDimensions(2, 1, 1)
        source.Update()
        shift = vtk.vtkTransform()
        shift.Translate(2.0 * number, 0, 0)
        moved = vtk.vtkTransformFilter()
        moved.SetTransform(shift)
        moved.SetInputConnection(source.GetOutputPort())
        moved.Update()
        parts.SetPartition(number, moved.GetOutput())
    writer = hdf.vtkHDFWriter()
    writer.SetFileName(str(tmp_path / "a.vtkhdf"))
    writer.SetInputDataObject(parts)
    writer.SetUseExternalPartitions(True)
    assert writer.Write()
    del writer  # which keeps the files open
    assert len(list(tmp_path.iterdir())) == 4
    every = sorted(tmp_path.iterdir())
    parts = [path for path in every if path.name != "a.vtkhdf"]
    for paths in (["a.vtkhdf"], every, parts):
        assert integrate(read(*[tmp_path / path for path in paths]), "1")[0].value == pytest.approx(6)
    assert "a part of a mesh by name: also give a_part0.vtkhdf, a_part2.vtkhdf" in read(parts[1]).remarks[1]
    named = [path.rename(tmp_path / f"{number}.vtkhdf") for number, path in enumerate(parts)]
    assert integrate(read(*named), "1")[0].value == pytest.approx(6)
    named = [path.rename(parts[number]) for number, path in enumerate(named)]
    # a conversion that is retained is not taken once a part changes
    with h5py.File(tmp_path / "a_part2.vtkhdf", "r+") as file:
        file["VTKHDF/Points"][:, 0] *= 2
    assert integrate(read(tmp_path / "a.vtkhdf"), "1")[0].value == pytest.approx(8)


def test_bad_references(tmp_path):
    path = write_neko(tmp_path / "a.vtkhdf", 3, 2, lambda x: x, NEKO_FIELDS)
    value = tmp_path / "a.data" / "1.h5"
    value.rename(tmp_path / "a.data" / "other.h5")
    assert read(path, reader={"step": "0"})["Pressure"] is not None
    with pytest.raises(FormatError, match=r"Pressure: expected 216 rows of numbers, found no file a\.data/1\.h5"):
        Vtk([path], step="1")
    os.mkfifo(value)
    with pytest.raises(FormatError, match=r"1\.h5: .*pipe"):
        Vtk([path], step="1")
    with h5py.File(path, "r+") as file:
        del file["VTKHDF/PointData/Pressure"]
        layout = h5py.VirtualLayout((216,), float)
        layout[:] = h5py.VirtualSource("../b.h5", "Pressure", (216,))
        file["VTKHDF/PointData"].create_virtual_dataset("Pressure", layout)
    with pytest.raises(FormatError, match=r"expected data in files below the folder of a\.vtkhdf, found .*\.\./b\.h5"):
        Vtk([path])
