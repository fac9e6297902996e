"""Whatever is no plain file is rejected at once, everywhere that a file is read."""

import os
import socket
from pathlib import Path

import pytest

from elvis import ElvisError
from elvis import read as open_data
from elvis.core.distances.triangle_files import triangles_of
from elvis.core.files.archives import names_in
from elvis.core.files.plain import leading
from elvis.core.numbers.queries import points_in_table
from elvis.formats.reading import read
from elvis.formats.strict import findings
from elvis.plugins.conversion.discovery import choose_converter, installed_converters
from elvis.plugins.runtime.opening import open_files
from elvis.reference.record import Record
from elvis.renderer.passes.solids.hits import triangles
from elvis.scene.model.files import read_scene
from elvis.scene.record.palette import points_in

#: how a file is read, and the suffix by which some are told
DOORS = {
    "data": (read, ".xml"),
    "data for a converter": (lambda path: choose_converter(installed_converters(), [path]), ".vtu"),
    "data for a plugin": (lambda path: open_files([path]), ".npz"),
    "scene": (read_scene, ".yaml"),
    "palette": (lambda path: points_in(str(path)), ".xml"),
    "triangles": (lambda path: triangles_of(str(path)), ".stl"),
    "triangles of a scene": (lambda path: triangles(str(path)), ".stl"),
    "points": (points_in_table, ".csv"),
    "record": (Record.load, ".npz"),
}


@pytest.fixture
def others(tmp_path):
    """Something of each kind that is not a plain file, under names that end as asked."""

    def made(suffix):
        pipe, folder, device = (tmp_path / f"{name}{suffix}" for name in ("pipe", "folder", "device"))
        os.mkfifo(pipe)
        folder.mkdir()
        device.symlink_to("/dev/zero")
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(os.path.relpath(tmp_path / f"socket{suffix}"))
        listener.close()
        return {"a pipe": pipe, "a folder": folder, "a device": device, "a socket": tmp_path / f"socket{suffix}"}

    return made


@pytest.mark.parametrize("door", DOORS)
def test_special_files_are_rejected_without_opening(door, others):
    action, suffix = DOORS[door]
    for kind, path in others(suffix).items():
        if kind == "a folder" and door.startswith("data"):
            continue
        with pytest.raises(ElvisError, match=f"{path.name}: expected a file, found {kind}"):
            action(path)


@pytest.mark.parametrize("door", DOORS)
def test_a_missing_file(door, tmp_path):
    action, suffix = DOORS[door]
    for name in (f"none{suffix}", f"none/none{suffix}"):
        with pytest.raises(ElvisError, match=f"none{suffix}: there is no such file"):
            action(tmp_path / name)


def test_converters_and_plugins_open_only_regular_files(others, monkeypatch):
    for path in others(".msh").values():
        for candidate in installed_converters():
            if not (path.is_dir() and candidate.name == "native"):
                assert not candidate.converter.opens([path])
        assert leading(path, 10) == b""
        assert names_in(path) == frozenset()


def test_strict_checks_reject_special_files(others):
    for kind, path in others(".xml").items():
        if kind != "a folder":
            assert f"found {kind}" in findings(path)[0].sentence


def test_referenced_files_must_be_regular(tmp_path):
    os.mkfifo(tmp_path / "part.vtu")
    (tmp_path / "whole.pvtu").write_text(
        '<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid><Piece Source="part.vtu"/></PUnstructuredGrid></VTKFile>'
    )
    (tmp_path / "series.pvd").write_text(
        '<VTKFile type="Collection"><Collection><DataSet timestep="0" file="part.vtu"/></Collection></VTKFile>'
    )
    converter = choose_converter(installed_converters(), [tmp_path / "whole.pvtu"]).converter
    with pytest.raises(ElvisError, match=r"part\.vtu: expected a file, found a pipe"):
        converter([tmp_path / "whole.pvtu"])
    with pytest.raises(ElvisError, match=r"expected a VTK file part\.vtu next to it, found none"):
        converter([tmp_path / "series.pvd"])


def test_links_to_plain_files_are_followed(tmp_path):
    (tmp_path / "points.csv").write_text("1 2 3\n")
    (tmp_path / "link.csv").symlink_to(Path("points.csv"))
    assert points_in_table(tmp_path / "link.csv").tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    ("action", "name", "start"),
    [
        (open_data, "a.vtu.series", '{"file-series-version": "1.0", "files": '),
        (open_data, "a.mfem_root", '{"dsets": '),
        (lambda path: open_files([path]), "a.json", '{"format": "elvis-nurbs", "x": '),
    ],
)
def test_deeply_nested_lists_are_rejected(tmp_path, action, name, start):
    (tmp_path / name).write_text(start + "[" * 100_000 + "]" * 100_000 + "}")
    with pytest.raises(ElvisError, match=f"{name}: expected JSON, found lists or tables that are nested too deeply"):
        action(tmp_path / name)


def test_messages_that_quote_several_lines_are_one():
    assert str(ElvisError("a: expected b, found c\n  d\r\n e")) == "a: expected b, found c d e"
