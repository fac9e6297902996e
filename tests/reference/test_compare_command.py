"""``elvis compare`` from the command line."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Plane, Scene
from elvis.plugins.command.command import main
from elvis.reference.commands.compare import compare
from elvis.reference.picture import render
from elvis.reference.record import Record

PLANE = ["--plane", "1.5,0.5,0.45:0.1,0.2,1", "--size", "60x40", "--device", "reference"]


@pytest.fixture(scope="module")
def records(blocks, tmp_path_factory):
    """A record, and one with a wrong value at column 30, row 20."""
    folder = tmp_path_factory.mktemp("records")
    scene = Scene("wave", Plane((1.5, 0.5, 0.45), (0.1, 0.2, 1.0)), size=(60, 40))
    record = Record.of(render(blocks, scene))
    record.save(folder / "exact.npz")
    field = record.field.copy()
    field[20, 30] += 1.0
    np.savez(folder / "other.npz", **{**vars(record), "field": field})
    return folder / "exact.npz", folder / "other.npz"


def run(*arguments):
    return CliRunner().invoke(compare, list(map(str, arguments)))


def failed(capsys, *arguments):
    """The sentence with which the whole command fails."""
    with pytest.raises(SystemExit) as stopped:
        main(["compare", *map(str, arguments)])
    assert stopped.value.code == 1
    return capsys.readouterr().err


def test_a_report_of_a_scene(block_files, tmp_path):
    done = run(*block_files, *PLANE, "--refinements", "1,0", "-o", tmp_path / "report")
    assert done.exit_code == 0, done.output
    assert re.match(r"Linear elements after 1 refinement: .* 2 refinements would need \d+ kB\.\n$", done.stdout)
    told = json.loads((tmp_path / "report" / "summary.json").read_text())
    assert [rival["level"] for rival in told["baselines"]] == [0, 1, None]
    assert told["conclusion"] == done.stdout.strip()

    # the scene that lies in the report makes it again
    again = run(tmp_path / "report" / "scene.toml", "--device", "reference", "--refinements", "0,1", "--json")
    assert again.exit_code == 0, again.output
    numbers = json.loads(again.stdout)
    assert numbers["baselines"] == told["baselines"]
    assert numbers["picture"] == told["picture"]


@pytest.mark.thorough
def test_several_scenes_have_the_reports_of_each(block_files, tmp_path, capsys):
    """By workers of a scheduler in this very process."""
    distributed = pytest.importorskip("distributed")
    for zoom in (1, 2):
        files = json.dumps(list(map(str, block_files)))
        (tmp_path / f"zoom{zoom}.toml").write_text(f"data = {files}\nzoom = {zoom}\n")
    scenes = [tmp_path / f"zoom{zoom}.toml" for zoom in (2, 1)]

    def reports(folder, *arguments):
        done = run(*arguments, *PLANE, "--size", "12x8", "--refinements", "0", "-o", tmp_path / folder)
        assert done.exit_code == 0, done.output
        every = (path for path in (tmp_path / folder).rglob("*") if path.suffix in (".png", ".json"))
        own = {path.relative_to(tmp_path / folder): path.read_bytes() for path in every if path.name != "times.json"}
        return done.stdout.splitlines(), own

    verdict, alone = reports("alone", scenes[0])
    how = {"dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "localhost:0"}}
    with distributed.LocalCluster(1, processes=False, threads_per_worker=1, **how) as cluster:
        told, files = reports("reports", *scenes, "--scheduler", cluster.scheduler_address)
    assert [told[0], len(told)] == [f"zoom2: {verdict[0]}", 2]
    assert {path.parts[0] for path in files} == {"zoom1", "zoom2"}
    assert {path: files["zoom2" / path] for path in alone} == alone
    scenes[0].write_text("field = 'none'\n")
    assert failed(capsys, *scenes).startswith("elvis: error: zoom2: the scene names no data")


def test_records_are_compared(records, tmp_path):
    exact, other = records
    same = run(exact, exact, "--require", "pixel-exact")
    assert (same.exit_code, same.stdout) == (
        0,
        "Exact: all 2,400 pixels are within every tolerance. The pictures are the same.\n",
    )
    told = json.loads(run(exact, other, "--json").stdout)
    assert told["pixel_exact"] is False
    assert (told["baselines"][0]["worst"]["row"], told["baselines"][0]["worst"]["column"]) == (20, 30)


def test_requirements_determine_the_exit_status(records, tmp_path, capsys):
    said = failed(capsys, *records, "--require", "pixel-exact", "-o", tmp_path / "report")
    assert re.search(r"--require pixel-exact: field value fails at 1 pixel, off by up to .* column 30, row 20", said)
    assert (tmp_path / "report" / "index.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--refinements", "0,many"), "expected numbers from 0 to 10 with commas between them"),
        (("--memory-limit", "much"), "expected bytes such as 500M or 4G"),
        (("--require", "beauty"), "pixel-exact"),
    ],
)
def test_options_are_checked(records, arguments, sentence):
    done = run(*records, *arguments)
    assert done.exit_code == 2
    assert sentence in done.output


def test_a_limit_is_observed(block_files):
    numbers = json.loads(run(*block_files, *PLANE, "--memory-limit", "20k", "--json").stdout)
    assert [rival["skipped"] for rival in numbers["baselines"]] == [None, *3 * ["more than the memory limit"], None]


def test_bad_input_gives_a_one_line_error(records, block_files, tmp_path, capsys):
    exact, other = records
    assert run(exact).exit_code == run(exact, other, exact).exit_code == run(exact, block_files[0]).exit_code == 2
    np.savez(tmp_path / "empty.npz")
    assert "empty.npz: expected the channels" in failed(capsys, exact, tmp_path / "empty.npz")
    (tmp_path / "cut.npz").write_bytes(exact.read_bytes()[:3000])
    assert "cut.npz: expected a record that elvis render writes" in failed(capsys, exact, tmp_path / "cut.npz")
    (tmp_path / "cut.npz").unlink()
    assert "none.npz: there is no such file" in failed(capsys, exact, tmp_path / "none.npz")
    assert "there is no folder" in failed(capsys, exact, other, "-o", tmp_path / "no" / "report")
    assert "nothing was validated" in failed(
        capsys, *block_files, *PLANE, "--refinements", "0", "--require", "pixel-exact"
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty.npz"]


@pytest.mark.thorough
def test_meshes_are_saved_on_request(block_files, tmp_path):
    import trimesh

    # a camera that is fitted to what is seen takes the reference most of the time
    camera = ["--camera", "5,-4,3.5:1.5,0.5,0.5:0,0,1:35", "--size", "20x15"]
    iso = ["--isosurface", "0.2", *camera, "--device", "reference", "--refinements", "1"]
    done = run(*block_files, *iso, "--meshes", "ply,glb", "-o", tmp_path / "report")
    assert done.exit_code == 0, done.output
    names = {path.name for path in (tmp_path / "report" / "meshes").iterdir()}
    assert names == {f"{name}.{end}" for name in ("exact-isosurface-0", "n1-object-0") for end in ("ply", "glb")}
    mesh = trimesh.load_mesh(tmp_path / "report" / "meshes" / "exact-isosurface-0.ply", process=False)
    assert len(mesh.faces) > 100
    told = json.loads((tmp_path / "report" / "summary.json").read_text())
    assert told["baselines"][0]["surfaces"]["wave = 0.2"]["hausdorff"] > 0
    assert run(*block_files, *iso, "--meshes", "stl").exit_code == 2


def test_meshes_round_trip_through_vtk(block_files, blocks, tmp_path):
    vtk_reader = pytest.importorskip("vtkmodules.vtkIOXML")
    from elvis.reference.baseline.linear_drawing import Baseline
    from elvis.reference.baseline.saving import save_mesh
    from elvis.reference.quantities import Quantities

    whole = Baseline.of(Quantities(blocks, ["wave"]), 1).whole
    save_mesh(whole, tmp_path / "whole.vtu")
    reader = vtk_reader.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "whole.vtu"))
    reader.Update()
    found = reader.GetOutput()
    assert (found.GetNumberOfCells(), found.GetNumberOfPoints()) == (len(whole), len(whole.points))
    assert found.GetPointData().GetArray("wave").GetValue(17) == whole.values["wave"][17]
    with pytest.raises(Exception, match="expected a surface, found tetrahedra"):
        save_mesh(whole, tmp_path / "whole.ply")
