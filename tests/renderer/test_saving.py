"""Files that pictures are saved in: the contract with scripts."""

import resource
from io import BytesIO

import numpy as np
import pytest
from archives import arrays_of
from PIL import Image

from elvis import Camera, Plane, Status
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple
from elvis.scene.figure.picture import picture

SCALARS = {
    "depth": np.float64,
    "field": np.float64,
    "element": np.int64,
    "status": np.int64,
    "uncertainty": np.float64,
}
VECTORS = ("color", "position", "reference", "normal")


@pytest.fixture(scope="module", params=["vulkan", "reference"])
def frame(request, draw, linear):
    dataset = linear(curved(grid(Shape.PRISM, 2), ripple(0.05, seed=1), 3))
    camera = Camera((2.0, -1.0, 1.5), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), fov=40.0)
    return draw(dataset, request.param, plane=Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0)), camera=camera, size=(70, 50))


def test_npz_is_the_exact_record(frame, tmp_path):
    frame.save(tmp_path / "a.npz")
    record = arrays_of(tmp_path / "a.npz")
    assert set(record) == {*SCALARS, *VECTORS}
    for name, dtype in SCALARS.items():
        assert record[name].shape == (50, 70)
        assert record[name].dtype == dtype
    for name in VECTORS:
        assert record[name].shape == (50, 70, 3)
        assert record[name].dtype == np.float64
    for name in record:
        assert np.array_equal(record[name], getattr(frame, name), equal_nan=record[name].dtype == np.float64)


def test_values_of_empty_pixels(frame, tmp_path):
    frame.save(tmp_path / "a.npz")
    record = arrays_of(tmp_path / "a.npz")
    nothing = record["element"] == -1
    assert 0 < nothing.sum() < nothing.size
    assert np.isnan(record["field"][nothing]).all()
    for name in ("position", "reference", "normal"):
        assert np.isnan(record[name][nothing]).all()
        assert np.isfinite(record[name][~nothing]).all()
    assert np.isposinf(record["depth"][nothing]).all()
    assert np.isnan(record["uncertainty"][nothing]).all()
    assert (record["uncertainty"][~nothing] < 1e-13).all()
    assert (record["status"][nothing] == Status.MISS).all()
    assert (record["color"][nothing] == 1).all()
    assert np.isin(record["status"][~nothing], (Status.CERTAIN, Status.AMBIGUOUS)).all()


def test_geometry_of_the_record(frame):
    """Depth is along the view, normals are of unit length and look at the viewer."""
    seen, camera = frame.seen, frame.view.camera
    forward = camera.basis()[2]
    assert np.allclose(frame.depth[seen], (frame.position[seen] - camera.eye) @ forward)
    assert np.allclose(np.linalg.norm(frame.normal[seen], axis=1), 1)
    assert (np.einsum("ni,ni->n", frame.normal[seen], frame.position[seen] - camera.eye) < 0).all()
    assert np.allclose((frame.position[seen] - frame.scene.plane.point) @ frame.normal[seen][0], 0)


def test_exr_has_the_channels_of_the_record(frame, tmp_path):
    import OpenEXR

    frame.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    vectors = [f"{name}.{axis}" for name in ("position", "reference", "normal") for axis in "XYZ"]
    assert set(channels) == {"R", "G", "B", "A", "Z", "field", "element", "status", "uncertainty", *vectors}
    for name, pixels in channels.items():
        assert pixels.shape == (50, 70)
        assert pixels.dtype == (np.uint32 if name in ("element", "status") else np.float32)
    assert np.array_equal(channels["element"].astype(np.int32), frame.element)
    assert np.array_equal(channels["status"], frame.status)
    assert np.array_equal(channels["field"], frame.field.astype(np.float32), equal_nan=True)
    assert np.array_equal(channels["Z"], frame.depth.astype(np.float32))
    assert np.array_equal(channels["A"], frame.seen.astype(np.float32))
    assert np.array_equal(channels["G"], frame.color[..., 1].astype(np.float32))
    for name in vectors:
        expected = getattr(frame, name[:-2])[..., "XYZ".index(name[-1])].astype(np.float32)
        assert np.array_equal(channels[name], expected, equal_nan=True)


@pytest.mark.parametrize("plain", [False, True])
def test_png_is_the_picture(frame, tmp_path, plain):
    frame.save(tmp_path / "a.PNG", plain=plain)
    with Image.open(tmp_path / "a.PNG") as image:
        assert image.mode == "RGB"
        assert (image.size == (70, 50)) == plain
        assert np.array_equal(np.asarray(image), np.asarray(picture(frame, plain=plain)))


@pytest.mark.parametrize("suffix", [".npz", ".exr", ".png"])
def test_the_same_frame_makes_the_same_file(frame, tmp_path, suffix):
    for name in ("a", "b"):
        frame.save(tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("name", ["a.bmp", "a", "a.npz.gz", "nowhere/a.png"])
def test_failed_writes_leave_no_file(frame, tmp_path, name):
    with pytest.raises(ElvisError, match=r"expected a name that ends in \.png|there is no folder"):
        frame.save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_an_interrupted_file_is_removed(frame, tmp_path, monkeypatch):
    """A file that stood there before stays as it was."""
    (tmp_path / "a.npz").write_bytes(b"before")

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(ElvisError, match=r"a\.npz: cannot be written: No space"):
        frame.save(tmp_path / "a.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
    assert (tmp_path / "a.npz").read_bytes() == b"before"


@pytest.mark.parametrize("suffix", [".npz", ".exr", ".png"])
def test_a_full_disk_names_the_file(frame, tmp_path, suffix):
    """A limit on the size of files stands for the disk."""
    path = tmp_path / f"a{suffix}"
    frame.save(path)
    whole = path.stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in (0, 100, whole // 2, whole - 1):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            with pytest.raises(ElvisError, match=rf"a\{suffix}: cannot be written: .*File too large"):
                frame.save(path)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert path.stat().st_size == whole
        assert list(tmp_path.iterdir()) == [path]


def test_a_picture_has_a_repr_and_a_notebook_display(frame):
    counts = frame.counts()
    assert repr(frame) == (
        f"<Frame 70 x 50 of {frame.scene.field}: pixels {counts['certain']} certain, "
        f"{counts['ambiguous']} ambiguous, 0 failed>"
    )
    shown = Image.open(BytesIO(frame._repr_png_()))
    assert shown.size == picture(frame).size
    assert np.array_equal(np.asarray(shown), np.asarray(picture(frame)))
