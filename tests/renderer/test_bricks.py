"""Films of data that are looked at brick by brick; single pictures are in ``test_parts.py``."""

import numpy as np
from click.testing import CliRunner

from elvis.core.portions import Portion
from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved, ripple
from elvis.core.testing.fields import with_field
from elvis.core.testing.meshes import grid
from elvis.formats import write
from elvis.plugins.command import elvis


def test_films_read_bricks_of_files(tmp_path, monkeypatch):
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
        monkeypatch.setattr("elvis.renderer.bricks.ELEMENTS", 4)
        monkeypatch.setattr("elvis.plugins.data.dataset_of", None)
    assert len(frames[0]) == 3
    assert frames[0] == frames[1]
