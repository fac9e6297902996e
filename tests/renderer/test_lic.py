"""Line integral convolution against means of the noise along known lines, and against the reference."""

from dataclasses import replace

import numpy as np
import pytest
from made_fields import data

from elvis import (
    Camera,
    Clip,
    CutSurface,
    Faces,
    Glyphs,
    Isosurface,
    Lic,
    MeshLines,
    Plane,
    SceneError,
    Sphere,
    Style,
    render,
)
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, mixed_plane, mixed_volume, ripple
from elvis.renderer.device import persistence
from elvis.scene.cameras.view import View
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.writing import option_words
from elvis.scene.figure.picture import sentences
from elvis.scene.flow.streaks import _covariance, cells, middle, noise, scale_of, spread, toned, tones, weights
from elvis.scene.model.tables import scene_of, table_of


@pytest.fixture(scope="module")
def flat():
    """Bent triangles and quadrilaterals of a square."""
    return data(curved(mixed_plane(0), ripple(0.03), 3), p=lambda p: p[:, 0])


@pytest.fixture(scope="module")
def solid():
    """Flow in curved elements of every shape, with a core and a stagnation point."""
    return data(
        curved(mixed_volume(0), ripple(0.03), 3),
        u=lambda p: 0.5 - p[:, 1] + 0.2 * p[:, 0] ** 2,
        v=lambda p: p[:, 0] - 0.5,
        w=lambda p: p[:, 2] - p[:, 0] * p[:, 1],
    )


#: one grey, from black to white, in which a colour is a tone
GREY = (0.5, 0.5, 0.5)


def grey(velocity=None, opacity=1.0, **keys):
    return Style(color=GREY, opacity=opacity, lit=False, lic=Lic(velocity, contrast=1.0, **keys))


def tone_of(frame):
    """(h, w) the tones of a picture in that grey."""
    return 2.0 * frame.color[..., 0] - 1.0


class Noise:
    """The noise of a view at any place of it and around it."""

    def __init__(self, view, lic, around=60):
        first, shape = cells(view.with_margin(around), lic.width)
        self.lattice, self.first = noise(tuple(first.tolist()), shape), first
        self.origin, self.scale = middle(view), scale_of(lic.width)

    def __call__(self, x, y):
        column, row = ((at - own) * self.scale for at, own in zip((x, y), self.origin, strict=True))
        column, row = column - self.first[0], row - self.first[1]
        i, j = np.floor(column).astype(int), np.floor(row).astype(int)
        a, b = column - i, row - j
        above = (1 - a) * self.lattice[j, i] + a * self.lattice[j, i + 1]
        below = (1 - a) * self.lattice[j + 1, i] + a * self.lattice[j + 1, i + 1]
        return (1 - b) * above + b * below


def means(lic, along):
    """Tones of weighted means of ``along(s)``, an array for an arc length in pixels."""
    step, own = weights(lic.length)
    every = np.concatenate([own[:0:-1], own])
    places = step * np.arange(1 - len(own), len(own))
    mean = sum(weight * along(place) for weight, place in zip(every, places, strict=True)) / every.sum()
    constant = [np.full(1, step * total) for total in (every.sum(), (every**2).sum())]
    return tones(mean.reshape(-1), *constant, lic.width).reshape(mean.shape)


def columns_and_rows(frame):
    return np.meshgrid(np.arange(frame.view.width), np.arange(frame.view.height))


# the noise


def test_the_noise_is_fixed_to_cells_with_the_stated_variance():
    whole = noise((-40, -30), (400, 500))
    assert np.array_equal(whole[70:90, 45:145], noise((5, 40), (20, 100)))
    large = noise((0, 0), (1000, 1000))
    assert abs(large.mean()) < 2e-3
    # at cells white numbers of variance 1/3 have weights whose squares sum to (3/8)²; between four of them (5/16)²
    assert large.var() == pytest.approx(0.375**2 / 3, rel=0.02)
    between = 0.25 * (large[1:, 1:] + large[1:, :-1] + large[:-1, 1:] + large[:-1, :-1])
    assert between.var() == pytest.approx(0.3125**2 / 3, rel=0.02)
    # the mean over all places: squares of a hat's and these weights' sum, 1/3 in each direction
    assert _covariance()[0] == pytest.approx(1 / 27, rel=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_means_along_lines_have_the_same_contrast_for_every_length(angle):
    view = View.through(CAMERAS["parallel"], (1500, 1500))
    x, y = np.meshgrid(np.arange(10.0, 1490.0, 9.13), np.arange(10.0, 1490.0, 5.37))
    for length, width in ((3.0, 2.0), (40.0, 2.0), (80.0, 4.0)):
        lic = Lic(length=length, width=width)
        own = Noise(view, lic)
        tone = means(lic, lambda s, own=own: own(x + s * np.cos(angle), y + s * np.sin(angle)))
        # of a normal distribution of variance 1, t / sqrt(1 + t²) has the variance 0.3444
        measure = tone / np.sqrt(1 - tone**2)
        assert measure.var() == pytest.approx(1.0, abs=0.07)
        assert tone.var() == pytest.approx(0.344, abs=0.015)


def test_tones_leave_the_mean_of_colours_and_reach_black_and_white():
    colors = np.array([[0.2, 0.5, 0.9]])
    for tone, end in ((-1.0, 0.0), (1.0, 1.0)):
        assert np.array_equal(toned(colors, np.array([tone]), 1.0), np.full((1, 3), end))
        assert np.allclose(toned(colors, np.array([tone]), 0.25), 0.75 * colors + 0.25 * end, atol=1e-15)
    assert np.array_equal(toned(colors, np.array([np.nan]), 1.0), colors)


# known lines


@pytest.mark.parametrize("degrees", [0, 27, 90, 135, 211])
def test_a_uniform_flow_has_means_along_straight_lines(draw, flat, degrees):
    x, y = (np.cos(np.radians(degrees)), np.sin(np.radians(degrees)))
    shown = Faces(style=grey(f"{float(x)!r}+0*x,{float(y)!r}+0*x"))
    frame = draw(flat, field="p", objects=(shown,), size=(70, 60), region=(0.3, 0.65, 0.35, 0.65))
    lic, (i, j) = shown.style.lic, columns_and_rows(frame)
    own = Noise(frame.view, lic)
    assert frame.seen.all()
    # rows run down
    truth = means(lic, lambda s: own(i + s * x, j - s * y))
    assert np.abs(tone_of(frame) - truth).max() < 1e-9
    assert truth.std() > 0.5


def test_a_rotation_has_means_along_circles(draw, flat):
    shown = Faces(style=grey("0.5-y,x-0.5", length=30.0))
    camera = Camera((0.5, 0.5, 1.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=0.6)
    frame = draw(flat, field="p", objects=(shown,), size=(81, 81), camera=camera)
    lic, (i, j) = shown.style.lic, columns_and_rows(frame)
    own = Noise(frame.view, lic)
    radius, start = np.hypot(i - 40, 40 - j), np.arctan2(40 - j, i - 40)

    def along(s):
        turn = start + s / np.maximum(radius, 1.0)
        return own(40 + radius * np.cos(turn), 40 - radius * np.sin(turn))

    off = np.abs(tone_of(frame) - means(lic, along))
    # linear velocities are exact between pixels: what is left is the step of half a pixel
    assert off[radius > 10].max() < 0.06
    assert off[radius > 25].max() < 0.02
    assert off[radius > 25].mean() < 0.002
    # the mean over circles differs from that over spokes
    spokes = means(lic, lambda s: own(40 + (radius + s) * np.cos(start), 40 - (radius + s) * np.sin(start)))
    assert np.abs(tone_of(frame) - spokes)[radius > 10].mean() > 0.3


def test_streaks_have_the_stated_length_and_width(draw, flat):
    shown = Faces(style=grey("1+0*x,0*x"))
    frame = draw(flat, field="p", objects=(shown,), size=(240, 200), region=(0.35, 0.65, 0.4, 0.65))
    tone = tone_of(frame)

    def correlation(columns, rows):
        one, other = tone[rows:, columns:], tone[: tone.shape[0] - rows, : tone.shape[1] - columns]
        return float((one * other).mean() / (tone**2).mean())

    # a raised cosine of length L with itself, L / 4 apart: 0.66; beyond its own length nothing is left
    assert correlation(10, 0) == pytest.approx(0.66, abs=0.08)
    assert abs(correlation(45, 0)) < 0.1
    assert correlation(0, 1) == pytest.approx(0.5, abs=0.12)
    assert abs(correlation(0, 5)) < 0.1


def test_lines_end_where_the_surface_ends(draw):
    square = data(grid(Shape.QUADRILATERAL, 2), p=lambda p: p[:, 0])
    shown = Faces(style=grey("1+0*x,0*x", length=24.0))
    camera = Camera((0.5, 0.5, 1.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.5)
    frame = draw(square, field="p", objects=(shown,), size=(60, 60), camera=camera)
    row = frame.seen[30]
    assert_truncated(frame, shown.style.lic, 30, np.flatnonzero(row)[0], np.flatnonzero(row)[-1])


def assert_truncated(frame, lic, row, first, last):
    """The tones of a row are means along it, from one column to another, where lines end."""
    own = Noise(frame.view, lic)
    step, weighed = weights(lic.length)
    for column in range(first, last + 1):
        place = column + step * np.arange(1 - len(weighed), len(weighed))
        kept = (np.floor(place + 0.5) >= first) & (np.floor(place + 0.5) <= last)
        weight = np.concatenate([weighed[:0:-1], weighed])[kept]
        mean = weight @ own(place[kept], np.full(kept.sum(), float(row))) / weight.sum()
        parts = (np.full(1, total) for total in (mean, step * weight.sum(), step * (weight**2).sum()))
        assert tone_of(frame)[row, column] == pytest.approx(tones(*parts, lic.width)[0], abs=1e-9)


def test_lines_end_where_a_surface_hides_another(draw):
    # two cubes next to one another in the picture, one half a unit nearer to the eye
    cubes = data(grid(Shape.HEXAHEDRON, 2), p=lambda p: p[:, 0])
    ids = []
    for x, z in ((0.25, 0.25), (0.75, 0.75)):
        found = render(cubes, field="p", plane=((x, 0.25, z), (0, 0, 1)), size=(40, 40))
        away = np.abs(found.position[..., :2] - [x, 0.25]).sum(axis=-1)
        ids.append(found.element.ravel()[np.nanargmin(away)])
    shown = Faces(tuple(f"element:{own}" for own in ids), grey("1+0*x,0*x,0*x", length=24.0))
    camera = Camera((0.5, 0.25, 3.0), (0.5, 0.25, 0.0), (0.0, 1.0, 0.0), height=1.25)
    frame = draw(cubes, field="p", objects=(shown,), size=(50, 50), camera=camera)
    depth = frame.depth[25]
    low, high = (np.flatnonzero(np.abs(depth - own) < 0.01) for own in (2.5, 2.0))
    assert min(len(low), len(high)) > 15
    assert low[-1] + 1 == high[0]
    for part in (low, high):
        assert_truncated(frame, shown.style.lic, 25, part[0], part[-1])


# what has no streaks


@pytest.mark.parametrize("velocity", ["0*x,0*x", "sqrt(x-5),0*x", "(x-x)/(y-y),1+0*y"])
def test_pixels_without_motion_have_plain_colours_and_are_counted(flat, velocity):
    shown = Faces(style=Style(lic=Lic(velocity), range=(0.0, 1.0)))
    frame = render(flat, field="p", objects=(shown,), size=(40, 40))
    plain = render(flat, field="p", objects=(replace(shown, style=Style(range=(0.0, 1.0))),), size=(40, 40))
    assert np.array_equal(frame.rgb, plain.rgb)
    assert frame.counts() == plain.counts()
    note = f"streaks along {velocity.replace(',', ', ')}: line integral convolution, a texture of the picture"
    assert sentences(frame, contours=False) == [note]
    told = f"pixels without streaks, because the velocity along the surface is zero: {frame.seen.sum()}"
    assert told in frame.remarks


def test_a_velocity_normal_to_the_surface_gives_no_streaks(solid):
    cut = CutSurface(Plane((0.5, 0.5, 0.4), (0, 0, 1)), grey("0*x,0*x,1+x"))
    frame = render(solid, field="u", objects=(cut,), size=(30, 30))
    assert np.all(tone_of(frame)[frame.seen] == 0.0)


def test_the_record_is_independent_of_streaks(solid):
    cut = CutSurface(Plane((0.5, 0.5, 0.4), (0, 0.2, 1)))
    plain = render(solid, field="u", objects=(cut,), camera="iso", size=(50, 40))
    frame = render(solid, field="u", objects=(replace(cut, style=Style(lic=Lic())),), camera="iso", size=(50, 40))
    for name in ("element", "status"):
        assert np.array_equal(getattr(frame, name), getattr(plain, name))
    for name in ("field", "depth"):
        assert np.abs(getattr(frame, name)[frame.seen] - getattr(plain, name)[frame.seen]).max() < 1e-13
    assert np.abs(frame.color - plain.color)[frame.seen].mean() > 0.05
    assert np.array_equal(frame.color[~frame.seen], plain.color[~frame.seen])


# one picture, however it is made


@pytest.mark.thorough
def test_bands_make_the_same_picture(draw, solid, monkeypatch):
    style = replace(grey(length=20.0), mesh_lines=MeshLines())
    cut = CutSurface(Plane((0.5, 0.5, 0.4), (0, 0.2, 1)), style)
    scene = {"field": "u", "objects": (cut,), "camera": "iso", "size": (60, 50)}
    whole = draw(solid, **scene)
    monkeypatch.setattr(persistence, "BAND", 60 * 7)
    bands = draw(solid, **scene)
    assert np.array_equal(whole.color, bands.color)
    assert tone_of(whole)[whole.seen].std() > 0.5


OBJECTS = {
    "plane": CutSurface(Plane((0.5, 0.5, 0.45), (0.1, 0.2, 1.0))),
    "faces": Faces(),
    "sphere": CutSurface(Sphere((1.0, 0.5, 0.5), 0.4)),
    "isosurface": Isosurface((0.3,), "v+z"),
}
CAMERAS = {
    "perspective": Camera((4.2, -2.7, 2.9), (1.0, 0.5, 0.5), fov=24.0),
    "parallel": Camera((4.2, -2.7, 2.9), (1.0, 0.5, 0.5), height=2.0),
}


def assert_alike(frame, truth):
    """Two devices' streaks: both integrate, so that tones differ where lines part, at edges and where nothing moves."""
    sure = frame.seen & truth.seen
    assert sure.sum() >= 200
    off = np.abs(frame.color - truth.color).max(axis=-1)[sure]
    assert off.mean() < 0.01
    assert np.quantile(off, 0.9) < 0.02


@pytest.mark.sampled(least=3)
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", OBJECTS)
def test_the_reference_draws_the_same(draw, solid, name, camera):
    shown = replace(OBJECTS[name], style=grey(length=20.0))
    scene = {"field": "u", "objects": (shown,), "camera": CAMERAS[camera], "size": (64, 48)}
    assert_alike(*(draw(solid, device, **scene) for device in ("vulkan", "reference")))


PICTURES = {
    "clipped": {"clip": (Clip(Plane((0.9, 0.5, 0.5), (1.0, 0.3, 0.0))),)},
    "samples": {"samples": 2, "size": (80, 60)},
    "through": {"objects": (Faces(style=grey(length=16.0, opacity=0.6)),)},
    "lit": {"objects": (Faces(style=Style(lic=Lic(length=16.0))),), "range": (-0.6, 0.6)},
}


@pytest.mark.thorough
@pytest.mark.sampled(least=2, free=("name",))
@pytest.mark.parametrize("name", PICTURES)
def test_the_reference_matches_on_other_scenes(draw, solid, name):
    scene = {"objects": (Faces(style=grey(length=16.0)),), "size": (64, 48), "camera": CAMERAS["perspective"]}
    scene |= {"field": "u", **PICTURES[name]}
    assert_alike(*(draw(solid, device, **scene) for device in ("vulkan", "reference")))


def test_surfaces_in_space_show_the_part_along_them(draw):
    mesh = grid(Shape.QUADRILATERAL, 3)
    tilted = replace(mesh, space=3, vertices=mesh.vertices + np.outer(mesh.vertices[:, 0], [0, 0, 2.0]))
    shown = Faces(style=grey("0*x,y,1+0*z", length=16.0))
    scene = {"field": "x", "objects": (shown,), "camera": "iso", "size": (70, 60)}
    frame, truth = (render(Dataset(tilted), device=device, **scene) for device in ("auto", "reference"))
    assert_alike(frame, truth)


# what is requested


@pytest.mark.parametrize(
    ("lic", "words"),
    [
        (
            Lic("u,v"),
            "lic: expected a velocity of 3 components, as the data have the coordinates x, y, z, found 2: u, v",
        ),
        (Lic("u,v,q"), "lic: expression 'q': character 1: there is no 'q'"),
    ],
)
def test_invalid_velocities(solid, lic, words):
    with pytest.raises(SceneError, match=words.replace("'", ".")):
        render(solid, field="u", objects=(Faces(style=Style(lic=lic)),), size=(20, 20))


def test_data_without_a_velocity(flat):
    with pytest.raises(SceneError, match=r"lic: the data lack .*; the fields are p"):
        render(flat, field="p", lic=True, size=(20, 20))


def test_lines_and_arrows_have_no_streaks():
    with pytest.raises(SceneError, match="style of glyphs: expected no contours, no mesh lines and no lic, found some"):
        Glyphs(("elements",), style=Style(lic=Lic()))


def test_settings_are_in_bounds():
    with pytest.raises(SceneError, match="length"):
        Lic(length=0.0)
    with pytest.raises(SceneError, match="width"):
        Lic(width=0.5)


def test_scene_files_commands_and_keywords_agree():
    shown = Faces(("wall",), Style(lic=Lic("u,v,w", length=25.0)))
    scene = composed((), {"faces": (shown,)}, ())
    assert scene_of(table_of(scene)) == scene
    words = option_words(scene)
    assert "--lic" in words
    assert "objects[0].style.lic.length=25.0" in words
    bare = composed((), {"lic": Lic(), "faces": (Faces(),), "glyphs": (Glyphs(("elements",)),)}, ())
    assert [item.style.lic for item in bare.objects] == [Lic(), None]
    assert spread(4.0)[1] == pytest.approx(2 * spread(2.0)[1])
