"""Small pictures of many ranks, some of which have no rows, or no elements, are those of one process."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.portions import portions
from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved, ripple
from elvis.core.testing.fields import with_field
from elvis.core.testing.meshes import grid
from elvis.core.testing.played_ranks import played
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.parts.parts import RankPart, what_matters
from elvis.scene import Camera, CutSurface, Faces, MeshLines, Plane, Scene, Style, Transfer, VolumeRendering

TILTED = Plane((0.5, 0.45, 0.52), (0.3, 0.2, 1.0))
#: what is fitted to the data takes a preview at them in each of the ranks: that of the other scenes alone
GIVEN = Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.8)
SCENES = {
    "plane": Scene(plane=TILTED),
    "faces and a plane": Scene(
        objects=(Faces(("all",), Style(opacity=0.4, mesh_lines=MeshLines())), CutSurface(TILTED))
    ),
    "volume": Scene(objects=(VolumeRendering(Transfer((0.0, 1.0), (0.0, 3.0))),), camera=GIVEN),
}


@pytest.fixture(scope="module")
def bent():
    """Six curved tetrahedra."""
    whole = curved(grid(Shape.TETRAHEDRON, 1), ripple(0.05), 3)
    return with_field(whole, lambda p: 0.5 + 0.5 * np.sin(2.0 * p[:, 0] + p[:, 1]) * np.cos(3.0 * p[:, 2] - p[:, 0]), 3)


def noted(frame, folder):
    """The bytes of a frame's picture and record, and what is counted."""
    for name in ("a.png", "a.npz"):
        frame.save(folder / name)
    counted = {key: value for key, value in frame.stats.items() if key not in ("bytes", "seconds")}
    return (folder / "a.png").read_bytes(), (folder / "a.npz").read_bytes(), counted


@pytest.mark.sampled
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_some_ranks_have_no_rows(bent, name, whole, tmp_path):
    """Eight ranks, two rows of tiles, six elements; ``whole``: each has all elements."""
    scene = replace(SCENES[name], field="u", size=(40, 12))
    with Pictures(bent, "vulkan") as pictures:
        expected = noted(pictures.draw(scene), tmp_path)

    def draw(ranks):
        ids = bent.mesh.domain_ids()
        part = portions(bent, [ids[number : number + 1] for number in range(8)])[ranks.rank]
        own = bent if whole else RankPart(what_matters(part, [scene]), ranks, {}, bent.mesh.corners)
        with Pictures(own, "vulkan", ranks=ranks) as pictures:
            return pictures.draw(scene)

    assert noted(played(8, draw)[0], tmp_path) == expected
