"""Pictures of distances and jumps by ranks, which have parts of the data, are those of one process, to the byte."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset
from elvis.core.portions import along_curve, portions
from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved, ripple
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid
from elvis.core.testing.played_ranks import played
from elvis.plugins.fourier import FourierBox, write_box
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.asking.completing import located
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.parts.bricks import Bricks, InMemory
from elvis.renderer.parts.parts import RankPart, of_ranks
from elvis.scene import Camera, Clip, CutSurface, Faces, Implicit, Isosurface, Plane, Scene
from elvis.scene.model.errors import SceneError
from elvis.scene.model.surfaces import Middle

GIVEN = Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.8)
TILTED = Plane((0.5, 0.45, 0.52), (0.3, 0.2, 1.0))
SCENES = {
    "plane of distances": Scene(field="distance(all)", plane=TILTED),
    "isosurface of distances": Scene(field="u", objects=(Isosurface((-0.2,), "distance(boundary)"),), camera="iso"),
    "level of distances": Scene(
        field="jump(u)", objects=(CutSurface(Implicit("distance(all) + 0.1*u + 0.2")),), camera=GIVEN
    ),
    "faces with jumps": Scene(field="jump(u)", objects=(Faces(("all",)),), camera="iso", range="all"),
}


@pytest.fixture(scope="module")
def straight():
    """48 straight tetrahedra with a field that jumps."""
    dataset, random = Dataset(grid(Shape.TETRAHEDRON, 2)), np.random.default_rng(0)
    return Dataset(dataset.mesh, (approximated(dataset, "u", lambda p: p[:, 0] + 0.1 * random.random(len(p)), 3),))


@pytest.fixture(scope="module")
def bent():
    """The same, curved ones."""
    dataset, random = Dataset(curved(grid(Shape.TETRAHEDRON, 2), ripple(0.05), 3)), np.random.default_rng(0)
    return Dataset(dataset.mesh, (approximated(dataset, "u", lambda p: p[:, 0] + 0.1 * random.random(len(p)), 3),))


def noted(frame, folder):
    """The bytes of a frame's picture and record, and what is told of pixels."""
    for name in ("a.png", "a.npz"):
        frame.save(folder / name)
    return (folder / "a.png").read_bytes(), (folder / "a.npz").read_bytes(), frame.counts(), frame.remarks


def by_ranks(dataset, scene, size):
    """What several ranks draw, each of a part, and how many elements each has."""
    parts = along_curve(dataset, size)

    def draw(ranks):
        own = of_ranks({None: portions(dataset, parts)[ranks.rank]}, {None: [scene]}, ranks)[None]
        assert isinstance(own, RankPart)
        with Pictures(own, "vulkan", ranks=ranks) as pictures:
            return pictures.draw(scene), len(own.dataset.mesh.domain_ids())

    return played(size, draw)


def test_planes_of_ranks_go_through_the_middle_of_the_whole(bent, tmp_path):
    scene = Scene("u", objects=(CutSurface(Middle("y")),), clip=(Clip(Middle("x")),), size=(24, 20))
    with Pictures(bent, "vulkan") as pictures:
        frame = pictures.draw(scene)
    middle = tuple(bent.mesh.corners.mean(axis=0).tolist())
    assert frame.scene.objects[0].surface == Plane(middle, (0.0, 1.0, 0.0))
    assert noted(by_ranks(bent, scene, 2)[0][0], tmp_path) == noted(frame, tmp_path)


@pytest.mark.thorough
@pytest.mark.sampled(least=2, free=("name", "size"))
@pytest.mark.parametrize("size", [2, 3, 8])
@pytest.mark.parametrize("name", SCENES)
def test_pictures_of_distances_and_jumps_in_parts(request, name, size, tmp_path):
    """Isosurfaces of distances to curved boundaries take long: to straight ones."""
    dataset = request.getfixturevalue("bent" if "plane" in name or "faces" in name else "straight")
    scene = replace(SCENES[name], size=(48, 60))
    with Pictures(dataset, "vulkan") as pictures:
        expected = noted(pictures.draw(scene), tmp_path)
    drawn = by_ranks(dataset, scene, size)
    assert noted(drawn[0][0], tmp_path) == expected
    assert max(count for _, count in drawn) < 48


def test_bricks_have_no_surroundings(bent):
    """One process that looks at one brick after another says that all elements count."""
    scene = Scene(field="jump(u)", plane=TILTED, size=(48, 36), memory=1e5)
    with Pictures(Bricks(InMemory(bent), lambda: bent)) as pictures, pytest.raises(SceneError, match="all elements"):
        pictures.draw(scene)


def test_planes_go_through_the_middle_of_the_elements_of_plugins(tmp_path):
    amplitudes = np.ones((2, 2, 2))
    high = np.array([1.0, 2.0, 4.0])
    write_box(tmp_path / "box.npz", np.zeros(3), high, ("fourier", "legendre", "legendre"), {"u": amplitudes})
    box = PluginData("fourier", FourierBox([tmp_path / "box.npz"]))
    (cut,) = located(Scene("u", objects=(CutSurface(Middle("z")),)), box, None).objects
    assert cut.surface.normal == (0.0, 0.0, 1.0)
    # boxes of elements are rounded outwards, to 32 bits
    assert cut.surface.point == pytest.approx(high / 2, rel=1e-6)
