"""Commands on series that several ranks run: each reads its part of the steps, and what comes out is that of one."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.core.testing.played_ranks import played
from elvis.formats import Dataset, write
from elvis.plugins import data as data_module
from elvis.plugins.command import elvis
from elvis.plugins.running import Settings
from elvis.plugins.series import series as series_module


def run(size, *arguments):
    """A command by so many ranks."""
    words = list(map(str, arguments))

    def work(ranks):
        elvis.main(words, prog_name="elvis", standalone_mode=False, obj=Settings(False, ranks))

    if size == 1:
        elvis.main(words, prog_name="elvis", standalone_mode=False, obj=Settings(False))
    else:
        played(size, work)


def function(time):
    return lambda p: np.sin(2.0 * p[:, 0] + p[:, 1] + time) * np.cos(3.0 * p[:, 2] - time)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Steps of two fields on bent tetrahedra, HDF5 and XML; a second solution on the same elements."""
    path = tmp_path_factory.mktemp("steps")
    mesh = curved(grid(Shape.TETRAHEDRON, 2), ripple(0.05), 3)
    bare = Dataset(mesh)
    for kind, options in {"h": {"mesh_format": "hdf5", "field_format": "hdf5"}, "x": {}}.items():
        write(bare, path / f"{kind}.xml", **options)
        (path / f"{kind}.fld").unlink(missing_ok=True)
        for number, time in enumerate((0.0, 0.5, 1.0)):
            fields = [approximated(bare, name, function(time + more), 4) for name, more in (("u", 0.0), ("v", 0.7))]
            write(Dataset(mesh, tuple(fields), time), field_path=path / f"{kind}_{number}.chk", **options)
    other = replace(approximated(bare, "u", function(0.3), 3))
    write(Dataset(mesh, (other,)), path / "ref.xml", path / "ref.fld")
    return path


@pytest.fixture
def parts_alone(monkeypatch):
    """Nothing is read whole, or converted by each."""

    def never(*_, **__):
        raise AssertionError("a rank reads the whole")

    for module, name in ((data_module, "state_of"), (series_module, "read_native"), (series_module, "with_fields")):
        monkeypatch.setattr(module, name, never)


def steps(folder, kind):
    return [folder / f"{kind}.xml", *sorted(folder.glob(f"{kind}_?.chk"))]


PICTURES = {
    "last": ("--faces", "all", "--field", "v"),
    "between": ("--time", "0.3", "--between", "cubic", "--isosurface", "0.3", "--field", "u"),
    "rate": ("--time", "0.7", "--plane", "0.5,0.45,0.52:0.3,0.2,1", "--field", "d(u,t)+v", "--range", "series"),
    "other": ("--step", "1", "--faces", "all", "--field", "u-ref:u", "--contours", "5"),
}


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_of_a_moment(folder, name, tmp_path, parts_alone, monkeypatch):
    words = ["render", *PICTURES[name], "--camera", "iso", "--size", "64x90"]
    if name == "other":
        words += ["--other", f"ref={folder / 'ref'}.xml,{folder / 'ref'}.fld"]
    for size, kind in ((3, "h"), (2, "x")):
        run(size, *words, *steps(folder, kind), "-o", tmp_path / f"{kind}.png", "-o", tmp_path / f"{kind}.npz")
    monkeypatch.undo()
    for kind in "hx":
        run(1, *words, *steps(folder, kind), "-o", tmp_path / "one.png", "-o", tmp_path / "one.npz", "--overwrite")
        for suffix in ("png", "npz"):
            assert (tmp_path / f"{kind}.{suffix}").read_bytes() == (tmp_path / f"one.{suffix}").read_bytes()
