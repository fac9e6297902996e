"""Times found without reading files: in VTK files, in every way that the library writes them; in indices of MFEM."""

import json
from itertools import product

import numpy as np
import pytest

from elvis import FormatError, open_series, read
from elvis.converters.mfem.files import read_root
from elvis.converters.vtk.times import time_in
from elvis.core.data.moments import Moment
from elvis.plugins.data.data import Reading
from elvis.plugins.series.finding import find_steps

vtk = pytest.importorskip("vtkmodules.all")
numpy_to_vtk = pytest.importorskip("vtkmodules.util.numpy_support").numpy_to_vtk

WAYS = [*product(("Ascii", "Binary", "Appended", "Raw"), (True, False), ("UInt32", "UInt64"), ("Little", "Big"))]


def square(time, name="TimeValue", kind=float, at=0):
    """The square [at, at + 1] x [0, 1] with u = t (x - at)."""
    grid, points, corners = vtk.vtkUnstructuredGrid(), vtk.vtkPoints(), vtk.vtkIdList()
    for i, place in enumerate([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]):
        points.InsertNextPoint(at + place[0], *place[1:])
        corners.InsertNextId(i)
    grid.SetPoints(points)
    grid.InsertNextCell(vtk.VTK_QUAD, corners)
    for data, own, values in (
        (grid.GetPointData(), "u", np.array([0, 1, 1, 0]) * float(time)),
        (grid.GetFieldData(), "Cycle", np.array([7.0])),
        (grid.GetFieldData(), name, np.array([time], kind)),
    ):
        array = numpy_to_vtk(values, 1)
        array.SetName(own)
        data.AddArray(array)
    return grid


def written(path, grid, mode="Appended", is_packed=True, header="UInt64", order="Little"):
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    getattr(writer, f"SetDataModeTo{'Appended' if mode == 'Raw' else mode}")()
    writer.SetEncodeAppendedData(mode != "Raw")
    getattr(writer, f"SetHeaderTypeTo{header}")()
    getattr(writer, f"SetByteOrderTo{order}Endian")()
    if not is_packed:
        writer.SetCompressorTypeToNone()
    assert writer.Write()
    return path


def test_every_notation_of_time(tmp_path):
    for number, way in enumerate(WAYS):
        path = written(tmp_path / f"{number}.vtu", square(1 / 3), *way)
        assert time_in(path) == 1 / 3, way
    for number, (binary, name, kind) in enumerate(product((True, False), ("TIME", "Time"), (np.float64, np.float32))):
        writer = vtk.vtkUnstructuredGridWriter()
        writer.SetInputData(square(0.375, name, kind))
        writer.SetFileName(str(tmp_path / f"{number}.vtk"))
        writer.SetFileType(1 + binary)
        assert writer.Write()
        assert time_in(tmp_path / f"{number}.vtk") == 0.375
    # no time, or half a file, is no time
    assert time_in(written(tmp_path / "none.vtu", square(0.5, "Other"))) is None
    whole = (tmp_path / "0.vtu").read_bytes()
    for part in (0, 40, 200, 300):
        (tmp_path / "half.vtu").write_bytes(whole[:part])
        assert time_in(tmp_path / "half.vtu") is None


@pytest.mark.parametrize("damaged", [0, 1, 3])
def test_an_incomplete_file_is_skipped(tmp_path, monkeypatch, damaged):
    """Wherever it stands, and whether it is requested as a series or not."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    files = [written(tmp_path / f"flow_{number}.vtu", square(number / 2)) for number in range(4)]
    files[damaged].write_bytes(files[damaged].read_bytes()[:700])
    series = open_series(*files)
    assert series.times.tolist() == [number / 2 for number in range(4) if number != damaged]
    assert any(f"flow_{damaged}.vtu" in told and "the step is skipped" in told for told in series.remarks)
    last = read(*files)
    assert last.time == series.times[-1]
    assert f"flow_{damaged}.vtu" in last.remarks[1]


def test_files_without_an_index_state_their_times(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    times = [0.25, 0.5, 1.5]
    for number, time in enumerate(times):
        written(tmp_path / f"flow_{number}.vtu", square(time))
    monkeypatch.setattr(
        "elvis.plugins.data.data.state_of", lambda *_: pytest.fail("a file was read whole for its time")
    )
    series = open_series(tmp_path / "flow_*.vtu")
    assert series.times.tolist() == times
    # different times make them steps, not parts of one state, though no step is requested
    assert find_steps(sorted(tmp_path.glob("*.vtu")), Reading()) is not None
    # meshes that don't overlap are parts of one state, whatever is requested; a mesh that comes again is a step
    for number in range(3):
        written(tmp_path / f"part_{number}.vtu", square(0.5, at=number))
        written(tmp_path / f"again_{number}.vtu", square(0.5))
    for reading in (Reading(), Reading(moment=Moment(wants_series=True))):
        assert find_steps(sorted(tmp_path.glob("part*.vtu")), reading) is None
        steps = find_steps(sorted(tmp_path.glob("again*.vtu")), reading).steps
        assert [step.time for step in steps] == [0, 1, 2]


def test_indices_of_mfem_list_times_and_files(tmp_path):
    fields = {"u": {"path": "heat_000001/u.%06d"}, "v": {"path": "heat_000001/v.%06d"}}
    main = {"domains": 2, "time": 0.25, "mesh": {"path": "heat_000001/mesh.%06d"}, "fields": fields}
    root = tmp_path / "heat_000001.mfem_root"
    root.write_text(json.dumps({"dsets": {"main": main}}))
    with pytest.raises(FormatError, match=r"expected 2 files 'heat_000001/mesh\.%06d', found none of number 0"):
        read_root(root)
    (tmp_path / "heat_000001").mkdir()
    names = [f"{name}.00000{part}" for name in ("mesh", "u", "v") for part in range(2)]
    for name in names:
        (tmp_path / "heat_000001" / name).write_text("")
    assert read_root(root) == (0.25, [tmp_path / "heat_000001" / name for name in names])
    for bad in ("/etc/%06d", "../%06d", "mesh.%999999999d", "mesh"):
        root.write_text(json.dumps({"dsets": {"main": {**main, "mesh": {"path": bad}}}}))
        with pytest.raises(FormatError, match="expected a name below the index with %06d in it"):
            read_root(root)
    root.write_text("{}")
    with pytest.raises(FormatError, match="expected an index of MFEM's mesh and functions, found none"):
        read_root(root)
