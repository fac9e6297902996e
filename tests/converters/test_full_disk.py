"""Disks that are full: every format says which file it could not write, and leaves nothing of it.

A limit on the size of files stands for the disk: writing beyond it fails as it does on one that is full.
"""

import gc
import resource
import sys
from contextlib import contextmanager
from dataclasses import replace

import h5py
import numpy as np
import pytest

from elvis import Dataset, ElvisError, Shape, write
from elvis.converters.shared.exporting import exported
from elvis.core.files.columns import write_columns
from elvis.core.files.nrrd import Grid, write_nrrd
from elvis.core.testing import approximated, grid
from elvis.formats.nektar.hdf5 import created


@contextmanager
def files_up_to(size):
    """Files can't grow beyond a number of bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope="module")
def dataset():
    bare = Dataset(grid(Shape.HEXAHEDRON, 3))
    return replace(bare, fields=(approximated(bare, "u", lambda x: np.sin(x[:, 0] * x[:, 1]), 4),))


def write_vtu(dataset, path):
    pytest.importorskip("vtkmodules")
    from elvis.converters.vtk.export import VtkTarget
    from elvis.converters.vtk.export import write_vtu as write

    write(path, exported(dataset, None, None, VtkTarget()), None)


def write_msh(dataset, path):
    pytest.importorskip("gmsh")
    from elvis.converters.gmsh.export import GmshTarget
    from elvis.converters.gmsh.export import write_msh as write

    with GmshTarget() as target:
        write(path, exported(dataset, None, None, target), dataset.mesh, target, None)


def write_archive(dataset, path):
    write_columns(path, {"u": np.arange(4000), "v": np.linspace(0, 1, 4000)})


def write_grid(dataset, path):
    write_nrrd(path, Grid((0, 0, 0), (1, 1, 1), (10, 10, 10)), ["u"], [np.zeros((1000, 1))] * 4)


WRITERS = {
    "mesh.xml": lambda dataset, path: write(replace(dataset, fields=()), path),
    "field.fld": lambda dataset, path: write(dataset, field_path=path),
    "field.chk": lambda dataset, path: write(dataset, field_path=path, field_format="hdf5"),
    "mesh.nekg": lambda dataset, path: write(replace(dataset, fields=()), path.with_suffix(".xml"), mesh_format="hdf5"),
    "out.vtu": write_vtu,
    "out.msh": write_msh,
    "out.csv": write_archive,
    "out.npz": write_archive,
    "out.nrrd": write_grid,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_names_the_file_and_preserves_the_old_one(dataset, tmp_path, name, capfd):
    """Whether it is full at once, in the middle, or at the last byte."""
    path = tmp_path / name
    WRITERS[name](dataset, path)
    whole = path.stat().st_size
    for file in tmp_path.iterdir():
        file.write_text("old")
    old = sorted(tmp_path.iterdir())
    capfd.readouterr()
    for size in (0, 100, 512, 1000, 2048, whole // 2, whole - 1):
        # the stub of a mesh whose data are elsewhere is a small file of its own
        about = name if size > 400 or name != "mesh.nekg" else r"mesh\.(xml|nekg)"
        sentence = rf"{about}: cannot be written: (File too large|.* could not write all of it)"
        with files_up_to(size), pytest.raises(ElvisError, match=sentence):
            WRITERS[name](dataset, path)
        assert sorted(tmp_path.iterdir()) == old
        assert {file.read_text() for file in old} == {"old"}
    assert capfd.readouterr() == ("", "")
    WRITERS[name](dataset, path)
    assert path.stat().st_size == whole


def test_output_beyond_the_disk_can_be_read_during_writing(tmp_path):
    """The library reads what it has written before; what it would find on the disk is not there."""

    def written_and_read():
        with created(tmp_path / "u.h5") as file:
            file["a"] = file["b"] = np.arange(40000.0)
            file.flush()
            assert np.array_equal(file["a"][:], np.arange(40000.0))
            file.attrs["complete"] = True

    with files_up_to(1000), pytest.raises(OSError, match="File too large"):
        written_and_read()


def test_an_interrupt_while_a_file_is_closed_prints_nothing(tmp_path, monkeypatch):
    """What h5py could not close then is written when it is let go: nobody hears of it."""
    heard = []
    monkeypatch.setattr(sys, "unraisablehook", heard.append)

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(h5py.File, "__exit__", interrupted)
        with pytest.raises(KeyboardInterrupt), created(tmp_path / "u.h5") as file:
            file["u"] = np.arange(1000.0)
    del file
    gc.collect()
    assert not heard
