"""What the paper on the first ElVis claims and its last code lost (docs/parity.md), where no other test shows it."""

import re
from pathlib import Path

import numpy as np
import pytest

from elvis import (
    Camera,
    Contours,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    Plane,
    Sphere,
    Style,
    Transfer,
    VolumeRendering,
)
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, with_field
from elvis.scene.model.objects import CutSurface as Cut

PAGE = Path(__file__).resolve().parents[2] / "docs" / "parity.md"
CENTER = np.array([0.5, 0.5, 0.5])


def ball(x):
    return ((x - CENTER) ** 2).sum(axis=1)


@pytest.fixture(scope="module")
def cube():
    """The unit cube with u = |x - c|^2."""
    mesh = grid(Shape.TETRAHEDRON, 2)
    return with_field(mesh, ball)


def test_surfaces_isosurfaces_and_volume_share_one_depth(draw, cube):
    """Occlusion: each pixel shows what is nearest of the single pictures; volumes add nothing behind those."""
    camera = Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0)
    plane = CutSurface(Plane((0.5, 0.5, 0.5), (1.0, 0.2, 0.4)), Style(color=(1.0, 0.0, 0.0), lit=False))
    level = Isosurface((0.09,), style=Style(color=(0.0, 0.0, 1.0), lit=False))
    options = {"camera": camera, "size": (60, 50)}
    one, other, both = (draw(cube, objects=shown, **options) for shown in ((plane,), (level,), (plane, level)))
    depth = np.fmin(np.where(one.seen, one.depth, np.inf), np.where(other.seen, other.depth, np.inf))
    assert np.array_equal(np.where(both.seen, both.depth, np.inf), depth)
    assert (one.seen & other.seen & (one.depth < other.depth)).sum() > 20
    assert (one.seen & other.seen & (one.depth > other.depth)).sum() > 20
    nearer = one.seen & (one.depth <= np.where(other.seen, other.depth, np.inf))
    assert np.array_equal(both.color[..., 0] > both.color[..., 2], nearer)

    # green volume: what is seen is dimmed by the volume before it alone, never by that behind
    volume = VolumeRendering(Transfer((-9.0, 9.0), (0.7, 0.7), ((0.0, 1.0, 0.0),) * 2), error=1e-6)
    dim = draw(cube, objects=(plane, level, volume), **options)
    whole = draw(cube, objects=(volume,), **options)
    assert (dim.color[..., 1] <= whole.color[..., 1] + 1e-5)[both.seen].all()
    front = both.seen & (both.depth < np.nanmin(both.depth[both.seen]) + 0.05)
    assert (dim.color[front][:, 1] < 0.5).all()


@pytest.mark.parametrize("away", [3.0, 1e3, 1e5])
def test_rays_are_exact_from_afar(draw, cube, away):
    """Hits of rays are those of the closed form to 1e-10 of the data's size, however far the eye is."""
    direction = np.array([0.62, -0.55, 0.56])
    angle = float(np.rad2deg(2 * np.arctan(0.9 / away)))
    camera = Camera(tuple(CENTER + away * direction), tuple(CENTER), fov=angle)
    objects = {
        "faces": (Faces(), lambda x: np.abs(np.abs(x - 0.5).max(axis=1) - 0.5)),
        "sphere": (CutSurface(Sphere(tuple(CENTER), 0.3)), lambda x: np.abs(np.linalg.norm(x - CENTER, axis=1) - 0.3)),
        "isosurface": (Isosurface((0.09,)), lambda x: np.abs(np.linalg.norm(x - CENTER, axis=1) - 0.3)),
    }
    for shown, off in objects.values():
        frame = draw(cube, objects=(shown,), camera=camera, size=(40, 40))
        assert frame.seen.sum() > 100
        assert off(frame.position[frame.seen]).max() < 1e-10 * np.sqrt(3)


def test_values_of_any_size_have_contours(draw):
    """The first ElVis took values above 5000 for no values: pressures in pascal had no contours."""
    mesh, pictures = grid(Shape.QUADRILATERAL, 2), []
    for factor in (1.0, 1e5, 1e-9):
        field = approximated(Dataset(mesh), "p", lambda x, f=factor: f * (1 + x[:, 0] * x[:, 1]), modes=4)
        style = Style(contours=Contours(count=5))
        shown = (Cut(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), style),)
        pictures.append(draw(Dataset(mesh, (field,)), objects=shown, size=(60, 50), range=(factor, 2 * factor)).color)
    assert (pictures[0].max(axis=2) < 0.2).sum() > 100
    assert np.abs(pictures[1] - pictures[0]).max() < 1e-6
    assert np.abs(pictures[2] - pictures[0]).max() < 1e-6


def test_the_page_names_tests_that_exist():
    """Each row of docs/parity.md names tests; these are in the files that it says."""
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", PAGE.read_text())
    assert len(named) > 40
    for file, test in named:
        text = (PAGE.parents[1] / file).read_text()
        assert not test or f"def {test}(" in text, f"{file}::{test}"


def test_every_row_of_the_page_has_a_test_or_is_marked_untested():
    rows = [row for row in PAGE.read_text().splitlines() if row.startswith("| ") and not row.startswith("| ---")]
    without = [row for row in rows if "`tests/" not in row and not re.search(r"\| (shown by|not there)", row)]
    assert [row.split("|")[1].strip() for row in without] == ["The paper says", "Capability"]
