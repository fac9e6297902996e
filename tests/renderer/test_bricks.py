"""Films of data that are examined brick by brick; single pictures are in ``test_parts.py``."""

import numpy as np
from click.testing import CliRunner

from elvis import write
from elvis.core.portions import Portion
from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved, ripple
from elvis.core.testing.fields import with_field
from elvis.core.testing.meshes import grid
from elvis.plugins.command.command import elvis
from elvis.renderer.parts.bricks import Bricks, InMemory
from elvis.scene import Plane, Scene


def test_animations_read_bricks_of_files(tmp_path, monkeypatch):
    """The whole never; frames are those without a limit."""
    bent = with_field(
        curved(grid(Shape.TETRAHEDRON, 3), ripple(0.05), 3), lambda points: np.sin(3.0 * points).sum(1), 4
    )
    files = [str(path) for path in write(bent, tmp_path / "a.xml", mesh_format="hdf5", field_format="hdf5")]
    command = ["animate", *files[:1], str(tmp_path / "a.fld"), "--field", "u", "--plane", "0.5,0.45,0.52:0.3,0.2,1"]
    command += [
        "--size",
        "48x36",
        "--frames",
        "3",
        "--key",
        "plane.point=[0.5,0.45,0.52]:[0.5,0.45,0.3]",
        "--workers",
        "1",
    ]
    frames = []
    for number, more in enumerate(([], ["--memory", str(int(2.9 * Portion.whole(bent).bytes))])):
        folder = tmp_path / str(number)
        folder.mkdir()
        result = CliRunner().invoke(elvis, [*command, *more, "-o", str(folder)], standalone_mode=False)
        assert result.exit_code == 0, (result.exception, result.output)
        frames.append([path.read_bytes() for path in sorted(folder.glob("*.png"))])
        monkeypatch.setattr("elvis.renderer.parts.bricks.ELEMENTS", 4)
        monkeypatch.setattr("elvis.plugins.data.data.dataset_of", None)
    assert len(frames[0]) == 3
    assert frames[0] == frames[1]


def test_folded_elements_of_hidden_bricks_are_reported(monkeypatch):
    monkeypatch.setattr("elvis.renderer.parts.bricks.ELEMENTS", 1)

    def fold(points):
        return points + (points[:, :1] > 0.7) * np.sin(20 * points[:, [1, 0, 2]])

    folded = with_field(curved(grid(Shape.HEXAHEDRON, 3), fold, 4), lambda points: points[:, 0], 2)
    scene = Scene(field="u", plane=Plane((0.1, 0.5, 0.5), (1.0, 0.0, 0.0)), memory=3.9 * Portion.whole(folded).bytes)
    bricks = Bricks(InMemory(folded), lambda: folded)
    for _ in range(2):
        shown = bricks.elements(scene)
        assert len(shown.mesh.domain_ids()) < len(folded.mesh.domain_ids())
        assert any("inverted or folded" in remark for remark in shown.remarks)
