"""``elvis watch``: which steps have pictures, and what these are called."""

import numpy as np
import pytest

from elvis import Dataset, write
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis
from elvis.plugins.series.following import Following
from elvis.scene.model.errors import SceneError


def watch(*arguments):
    elvis.main(["watch", *map(str, arguments), "--every", "0.05"], prog_name="elvis", standalone_mode=False)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A folder with a mesh, into which one of three steps is written whenever it is examined for the third time."""
    (folder := tmp_path / "run").mkdir()
    mesh = Dataset(grid(Shape.TETRAHEDRON, 1))
    write(mesh, folder / "mesh.xml")
    looks, look = [], Following.look

    def writing(self):
        number, rest = divmod(len(looks), 3)
        looks.append(number)
        if rest == 0 and number < 3:
            field = approximated(mesh, "u", lambda p: number * p[:, 0], 2)
            write(Dataset(mesh.mesh, (field,), 0.5 * number), field_path=folder / f"run_{number + 7}.chk")
        return look(self)

    monkeypatch.setattr(Following, "look", writing)
    return folder


def test_steps_may_have_separate_files(run, tmp_path, capsys):
    """A step in which an isosurface isn't there has no picture, and the run is followed."""
    names = [tmp_path / name for name in ("latest.png", "u_{step:03}.png", "u at {time:.2f}.npz")]
    outputs = [word for name in names for word in ("-o", name)]
    watch(run, "--isosurface", "0.5", "--camera", "iso", "--size", "24x18", "--idle", "1", *outputs)
    files = ["latest.png", "u at 0.50.npz", "u at 1.00.npz", "u_001.png", "u_002.png"]
    assert sorted(path.name for path in tmp_path.iterdir() if path != run) == files
    assert (tmp_path / "latest.png").read_bytes() == (tmp_path / "u_002.png").read_bytes()
    with np.load(tmp_path / "u at 1.00.npz") as record:
        assert np.nanmax(np.abs(record["position"][..., 0] - 0.25)) < 1e-12
    said = capsys.readouterr()
    assert said.out.splitlines()[0].endswith(
        "latest.png, u_001.png, u at 0.50.npz: time 0.5".replace(", ", f", {tmp_path}/")
    )
    assert said.err.count("values of an isosurface: 'u' lies between 0 and 0, found 0.5") == 1


def test_a_run_without_visible_steps_is_a_failure(run, tmp_path):
    with pytest.raises(ElvisError, match=r"no step was drawn in 0\.2 s: values of an isosurface: 'u'.* found 7"):
        watch(run, "--isosurface", "7", "--idle", "0.2", "-o", tmp_path / "u.png")


@pytest.mark.parametrize("name", ["{stop}.png", "{step.png", "{step[0]}.png", "{time:d}.png", "{}.png"])
def test_meaningless_braces_are_reported_at_once(run, tmp_path, name):
    with pytest.raises(SceneError, match=r"outputs: expected a name with \{step\} or \{time\}"):
        watch(run, "-o", tmp_path / name)
