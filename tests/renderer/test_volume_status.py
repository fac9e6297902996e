"""What is known of volumes is told: elements without numbers, inverted ones, ends of segments that are not found."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Isosurface, SceneError, Status
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.connectivity import connected
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, with_field
from elvis.formats.writing import write
from elvis.plugins.command import command
from elvis.renderer.passes.faces.faces import FaceDrawer
from elvis.renderer.passes.volume.rendering import _March
from elvis.scene import Transfer, VolumeRendering
from elvis.scene.cameras.view import View

CAMERA = Camera((3.0, -4.0, 2.5), (0.5, 0.55, 0.55), height=1.9)
SIZE = (36, 30)
VOLUME = VolumeRendering(Transfer((0.0,), (1.0,), ((1.0, 1.0, 1.0),)))


def rising(mesh, modes=2):
    """The field u = z."""
    return with_field(mesh, lambda p: p[:, 2], modes)


def without_numbers(data, count):
    """The dataset, its first elements without values."""
    block = data.fields[0].blocks[0]
    values = np.array(block.coefficients)
    values[:count] = np.nan
    return Dataset(data.mesh, (replace(data.fields[0], blocks=(replace(block, coefficients=values),)),))


def test_nan_elements_are_marked_counted_and_reported(draw):
    data = without_numbers(rising(grid(Shape.TETRAHEDRON, 2)), 6)
    whole, holed = (draw(own, camera=CAMERA, size=SIZE, objects=(VOLUME,)) for own in (rising(data.mesh), data))
    marked = holed.status == Status.AMBIGUOUS
    assert not (whole.status == Status.AMBIGUOUS).any()
    assert 20 < marked.sum() < (whole.status == Status.CERTAIN).sum()
    assert (holed.status[~marked] == whole.status[~marked]).all()
    assert np.array_equal(holed.color[~marked], whole.color[~marked])
    assert holed.stats["volume"]["undefined"] >= marked.sum()
    assert holed.stats["remarks"] == ["elements excluded from a volume because their u is not a number: 6"]
    assert whole.stats["remarks"] == []
    assert whole.stats["volume"]["undefined"] == whole.stats["volume"]["inverted_elements"] == 0


def test_isosurfaces_without_some_elements_are_marked_counted_and_reported(draw):
    """Nothing is certain where an element without numbers may hide the surface; all else is as it was."""
    data = without_numbers(rising(grid(Shape.TETRAHEDRON, 2)), 6)
    level = Isosurface((0.3,))
    whole, holed = (draw(own, camera=CAMERA, size=SIZE, objects=(level,)) for own in (rising(data.mesh), data))
    certain = holed.status == Status.CERTAIN
    assert holed.stats["remarks"] == ["elements excluded from an isosurface because their u is not a number: 6"]
    assert (holed.status == Status.AMBIGUOUS).sum() > 20
    assert (whole.status[certain] == Status.CERTAIN).all()
    assert np.array_equal(holed.element[certain], whole.element[certain])
    assert whole.stats["remarks"] == []


def test_an_isosurface_of_a_constant_is_empty_with_a_reason(draw):
    data = rising(grid(Shape.TETRAHEDRON, 1))
    block = data.fields[0].blocks[0]
    flat = (replace(data.fields[0], blocks=(replace(block, coefficients=0.0 * block.coefficients),)),)
    with pytest.raises(SceneError, match=r"nothing of any object is visible; .* because their u is 0 everywhere"):
        draw(Dataset(data.mesh, flat), camera=CAMERA, size=SIZE, objects=(Isosurface((0.0,)),))


@pytest.mark.parametrize("bent", [False, True])
def test_inverted_elements_are_drawn_and_reported(draw, bent):
    """Two of three tetrahedra wind the other way; in a curved mesh the status is that of `validity`."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    points = (np.array([[0, 0, 0], [1.2, 0, 0], [0, 1.2, 0]])[:, None] + corners).reshape(-1, 3)
    rows = np.array([[0, 1, 2, 3], [5, 4, 6, 7], [9, 8, 10, 11]])
    mesh = connected(points, {Shape.TETRAHEDRON: rows})
    mesh = curved(mesh, lambda p: p + 0.05 * p**2, 3) if bent else mesh
    frame = draw(rising(mesh, 4 if bent else 2), camera="iso", size=SIZE, objects=(VOLUME,))
    assert frame.stats["volume"]["inverted_elements"] == 2
    assert frame.stats["remarks"] == ["inverted elements, wholly or in part, which are still drawn: 2"]
    assert frame.counts()["failed"] == 0
    assert frame.counts()["certain"] > 100


def test_unlocated_points_fail_and_are_reported(draw, monkeypatch):
    """One face of each element is retained from the march, in the right half: these pixels fail, with a remark."""
    data = rising(curved(grid(Shape.TETRAHEDRON, 1), lambda p: p + 0.05 * p[:, ::-1] ** 2, 3), 4)
    found = FaceDrawer.visible_patches

    def fewer(self, *arguments):
        patches, view = found(self, *arguments)
        patches["most"][patches["face"] % 4 == 0, 0] = 17
        return patches, view

    monkeypatch.setattr(FaceDrawer, "visible_patches", fewer)
    frame = draw(data, camera=CAMERA, size=SIZE, objects=(VOLUME,))
    failed = frame.status == Status.FAILED
    assert failed[:, 18:].sum() > 50
    assert not failed[:, :18].any()
    assert frame.stats["volume"]["lost"] >= failed.sum()
    assert frame.stats["remarks"] == [
        f"points along rays in a volume that could not be located: {frame.stats['volume']['lost']}"
    ]


def test_the_time_limit_ends_a_march(draw, monkeypatch):
    """Before its first band, not only after the picture."""
    bands = []
    monkeypatch.setattr(_March, "band", lambda *some: bands.append(some))
    data = rising(grid(Shape.TETRAHEDRON, 2))
    with pytest.raises(SceneError, match=r"exceeded the time limit of .*: no file is written"):
        draw(data, camera=CAMERA, size=SIZE, objects=(VOLUME,), timeout=1e-9)
    assert not bands


@pytest.mark.parametrize(
    ("asked", "status", "sentence"),
    [
        (("--volume", "0:1,-1:4"), 2, "values of a transfer function: expected ascending finite numbers"),
        (("--volume", ","), 2, "expected 2 numbers"),
        (("--volume", "0:1,1:-4"), 2, "densities of a transfer function: expected a finite number of 0 or more"),
        (("--volume", "0:1e308,1:1e308"), 1, "densities of a volume: 1e+308 overflows"),
        (("--volume", "0:1,1:2", "--timeout", "1e-6"), 1, "the picture exceeded the time limit of 1e-06 s"),
    ],
)
def test_bad_volumes_give_a_one_line_error_and_no_file(renderer, tmp_path, capfd, asked, status, sentence):
    renderer("vulkan")
    files = [tmp_path / "cube.xml", tmp_path / "cube.fld"]
    write(rising(grid(Shape.TETRAHEDRON, 1)), *files)
    with pytest.raises(SystemExit) as ended:
        command.main(["render", *map(str, files), *asked, "--size", "20x16", "-o", str(tmp_path / "a.png")])
    said = capfd.readouterr().err
    assert (ended.value.code, said.count("\n")) == (status, 1)
    assert sentence in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cube.fld", "cube.xml"]


def test_volume_integrals_converge_with_the_requested_error(integrate):
    """Density 400 z^2, as much red as z^2, from above: D(z) = 400 (1 - z^3) / 3, C the integral of 400 z^4 exp(-D).

    Light comes from a layer a hundredth thick.  Asked for, estimated, wrong: the table falls.
    """
    view = View.through(Camera((0.47, 0.53, 5.0), (0.47, 0.53, 0.0), (0.0, 1.0, 0.0), height=0.9), (4, 4))
    mesh = grid(Shape.TETRAHEDRON, 1)
    data = with_field(mesh, lambda p: p[:, 2] ** 2)
    transfer = Transfer((0.0, 1.0), (0.0, 400.0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    nodes, weights = np.polynomial.legendre.leggauss(60)
    z = np.concatenate([end + 0.05 * (nodes + 1) for end in np.arange(10) / 10])
    exact = np.tile(0.05 * weights, 10) @ (400 * z**4 * np.exp(-400 * (1 - z**3) / 3))
    asked, errors, estimates = 10.0 ** -np.arange(1, 11), [], []
    for error in asked:
        light = integrate(data, view, transfer, error=error)
        errors.append(np.abs(light.color[:, 0] - exact).max())
        estimates.append(light.error.max())
    assert (np.array(estimates) <= asked).all()
    assert (np.array(errors) <= np.maximum(asked, 1e-13)).all()
    order = np.log10(errors[0] / errors[-1]) / 9
    assert order > 0.8, f"errors {errors} for 1e-1 to 1e-10"


@pytest.mark.parametrize(
    ("text", "shape", "width"),
    [("max(w-abs(x-0.37),0)", Shape.PYRAMID, 0.001), ("sign(w-abs(u-0.37))", Shape.HEXAHEDRON, 0.005)],
)
def test_kinks_and_jumps_between_samples_are_found(draw, text, shape, width):
    """A tent, or a slab, of a half-width: every ray in the direction of x has the optical depth 1."""
    mesh = Dataset(grid(shape, 1))
    parts = {"u": lambda p: p[:, 0], "w": lambda p: np.full(len(p), width)}
    data = Dataset(mesh.mesh, tuple(approximated(mesh, name, part, 2) for name, part in parts.items()))
    ends, density = ((0.0, width), 1.0 / width) if "max" in text else ((-1.0, 1.0), 0.5 / width)
    volume = VolumeRendering(Transfer(ends, (0.0, density), ((1.0, 1.0, 1.0),) * 2), text)
    view = Camera((3.0, 0.5, 0.5), (0.5, 0.5, 0.5), height=0.9)
    frame = draw(data, objects=(volume,), camera=view, size=(6, 6), background=(0.0, 0.0, 0.0))
    assert (frame.status == Status.CERTAIN).all()
    assert np.abs(frame.color + np.expm1(-1.0)).max() < 1e-3


def test_pixels_without_proof_are_ambiguous(draw):
    """Of second derivatives nothing is known between samples."""
    data = rising(curved(grid(Shape.HEXAHEDRON, 1), lambda p: p + 0.05 * p[:, ::-1] ** 2, 3), 4)
    volume = VolumeRendering(Transfer((-1.0, 1.0), (0.0, 1.0), ((1.0, 1.0, 1.0),) * 2), "laplacian(u)")
    frame = draw(data, objects=(volume,), camera=CAMERA, size=(12, 10))
    assert (frame.status == Status.AMBIGUOUS).sum() > 10
    assert not (frame.status == Status.CERTAIN).any()
