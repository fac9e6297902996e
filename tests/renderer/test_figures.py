"""Figures: exact pixels with curves, axes and bars around them."""

import base64
import re
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from click import BadParameter
from matplotlib.text import Annotation
from PIL import Image
from warps import bent_plane

from elvis import (
    Camera,
    Caption,
    Contours,
    Faces,
    Glyphs,
    Isosurface,
    MeshLines,
    SceneError,
    Streamlines,
    Style,
    render,
)
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, one_element
from elvis.scene import ColorBar, Scene
from elvis.scene.commandline import parameters
from elvis.scene.commandline.composing import in_one_range
from elvis.scene.figure.broken_lines import broken_lines
from elvis.scene.figure.figure import Page, save_figure
from elvis.scene.figure.picture import AXES, page
from elvis.scene.figure.rulers import aligned, box_edges, scale_bar, sides
from elvis.scene.figure.saving import save_panels
from elvis.scene.record.palette import NOT_A_NUMBER, Palette
from elvis.scene.record.strokes import SAME, STRAIGHT, borders, chain, simplify

#: pixels that contours may be displaced by
CLOSE = 0.02
BOTH = Style(contours=Contours(values=(0.4, 0.9, 1.7)), mesh_lines=MeshLines())


@pytest.fixture(scope="module")
def plane(linear):
    return linear(curved(grid(Shape.QUADRILATERAL, 3), bent_plane, 3))


@pytest.fixture(scope="module")
def traced(draw, plane):
    return draw(plane, size=(90, 80), objects=(Faces(style=BOTH),), outputs=("a.svg",), axes=True)


def test_arrows_of_figures_are_those_of_pictures(draw, linear):
    """In the same corner, which is not the lower left one if this shows data, and of about the same size."""
    camera = Camera((3.0, -2.0, 2.0), (0.9, 0.9, 0.8), height=1.6)
    frame = draw(linear(grid(Shape.HEXAHEDRON, 1)), size=(300, 240), camera=camera)
    content = BytesIO()
    layout = save_figure([frame], content, ".png")
    shown = (page(frame).layout.corner, page(frame).rows(0, page(frame).height)), (layout.corner, Image.open(content))
    places = []
    for corner, image in shown:
        away = np.abs(np.asarray(image)[:, :, :3].astype(int) - AXES[0]).max(axis=2)
        places.append(np.argwhere(away < 60)[:, ::-1] - corner)
    assert 0.5 < len(places[1]) / len(places[0]) < 2
    middles = [place.mean(axis=0) for place in places]
    assert np.abs(middles[1] - middles[0]).max() < 4
    assert middles[0][0] > 150


def test_texts_point_at_places_and_images_lie_in_the_corner(draw, linear, tmp_path):
    """A parallel view of the unit square by 100 pixels: x = 0.75 is at 74.5, as pixel centres are whole."""
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "logo.png")
    tip = parameters.caption("0.75,0.25,0@0.1,-0.2:tip: $x$")
    assert tip == Caption("tip: $x$", (0.75, 0.25, 0.0), (0.1, -0.2))
    texts = (tip, Caption("far", (9.0, 0.0, 0.0)))
    camera = Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.0)
    shown = {"texts": texts, "image": str(tmp_path / "logo.png"), "size": (100, 100), "camera": camera}
    frame = draw(linear(grid(Shape.HEXAHEDRON, 1)), **shown)
    axes = Page([frame], plain=False).panels[0].axes
    (found,) = [each for each in axes.texts if isinstance(each, Annotation) and each.get_text()]
    assert found.get_text() == "tip: $x$"
    assert found.xy == pytest.approx((74.5, 74.5))
    assert found.get_position() == pytest.approx((84.5, 94.5))
    content = BytesIO()
    corner = save_figure([frame], content, ".png").corner
    pixels = np.asarray(Image.open(content).convert("RGB"))
    assert pixels[corner[1] + 8, corner[0] + 90].tolist() == [255, 0, 0]
    (tmp_path / "logo.png").write_text("nothing")
    with pytest.raises(SceneError, match="image: expected an image file"):
        save_figure([frame], BytesIO(), ".png")


def ground(frame, line):
    """Places on the ground (n, 3) under columns and rows."""
    origins, ways = frame.view.rays(*np.asarray(line, float).T)
    return origins - (origins[:, 2:] / ways[:, 2:]) * ways


def test_the_field_has_its_level_on_contours(traced):
    pixel = np.linalg.norm(traced.view.column)
    found = {stroke.value: stroke for stroke in traced.drawing.strokes if stroke.value is not None}
    assert set(found) == {0.4, 0.9, 1.7}
    for value, stroke in found.items():
        places = ground(traced, np.concatenate(stroke.lines))
        off = np.abs(places @ [1.0, 2.0, -3.0] - value) / np.sqrt(5) / pixel
        assert off.max() < CLOSE


def test_the_pixels_under_curves_have_no_lines(traced, draw, plane):
    assert np.array_equal(traced.rgb, draw(plane, size=(90, 80), objects=(Faces(),)).rgb)


def test_borders_of_elements_are_found_between_pixels(draw, linear):
    frame = draw(linear(grid(Shape.QUADRILATERAL, 3)), size=(100, 90), objects=(Faces(style=BOTH),), outputs=("a.pdf",))
    (stroke,) = [stroke for stroke in frame.drawing.strokes if stroke.value is None]
    places = ground(frame, np.concatenate(stroke.lines))[:, :2]
    off = np.abs(places[:, None] - np.arange(4)[:, None] / 3).min(axis=1).min(axis=1)
    corners = np.abs(places - 0.5).min(axis=1) > 0.49
    pixel = np.linalg.norm(frame.view.column)
    assert off[~corners].max() < 0.3 * pixel
    assert off.max() < 0.6 * pixel
    inner = np.array([[x, y] for x in (1 / 3, 2 / 3) for y in (1 / 3, 2 / 3)])
    assert np.linalg.norm(places[:, None] - inner, axis=2).min(axis=0).max() < 0.01 * pixel


def test_a_slanted_border_is_straight():
    """Distances on both sides of a line, as the renderer tells them, give that line back, also at the edge of all."""
    normal, offset = np.array([0.6, 0.8]), 21.3
    columns, rows = np.meshgrid(np.arange(30.0), np.arange(30.0))
    height = columns * normal[0] + rows * normal[1] - offset
    for beyond in (1, -1):
        owner = np.where(height < 0, 0, beyond)
        starts, ends, _ = borders(
            owner, np.where(owner >= 0, np.abs(height), np.inf), np.ones_like(height), np.zeros(2, int)
        )
        places = np.concatenate([starts, ends])
        places = places[(places > 1.0).all(axis=1) & (places < 28.0).all(axis=1)]
        assert len(places) > 40
        assert np.abs(places @ normal - offset).max() < 1e-9


def test_short_lines_become_long_ones():
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = 20 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    order = np.random.default_rng(3).permutation(199)
    shaken = np.random.default_rng(4).uniform(-0.1 * SAME, 0.1 * SAME, (2, 199, 2))
    starts, ends = circle[:-1][order] + shaken[0], circle[1:][order] + shaken[1]
    (line,) = chain(starts, ends)
    assert np.allclose(line[0], line[-1])
    assert np.abs(np.linalg.norm(line, axis=1) - 20).max() < SAME
    (dot,) = chain(np.array([[3.0, 4.0]]), np.array([[3.0, 4.0]]))
    assert np.array_equal(dot, [[3.0, 4.0]])
    assert len(chain(np.zeros((3, 2)), np.array([[1.0, 0], [0, 1], [-1, -1]]))) == 3


def test_simplified_curves_stay_in_place():
    along = np.linspace(0, 60, 2000)
    curve = np.stack([along, 5 * np.sin(0.2 * along)], axis=1)
    fewer = simplify(curve)
    assert len(fewer) < len(curve) / 4
    assert np.abs(np.interp(along, *fewer.T) - curve[:, 1]).max() < 2 * STRAIGHT


def images_of(text):
    """The pictures that an SVG holds."""
    found = re.findall(r'xlink:href="data:image/png;base64,([^"]*)"', text.replace("\n", ""))
    return [np.asarray(Image.open(BytesIO(base64.b64decode(one))).convert("RGB")) for one in found]


def test_vector_graphics_hold_the_exact_pixels_and_texts(traced, tmp_path):
    traced.save(tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert any(np.array_equal(image, traced.rgb) for image in images_of(text))
    assert ">x</text>" in text
    assert ">u</text>" in text
    traced.save(tmp_path / "b.svg")
    assert (tmp_path / "b.svg").read_text(encoding="utf-8") == text
    traced.save(tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


def holds(page, pixels):
    """Whether a picture is somewhere in a page, pixel by pixel."""
    height, width = pixels.shape[:2]
    first = np.argwhere((page[: page.shape[0] - height + 1, : page.shape[1] - width + 1] == pixels[0, 0]).all(axis=-1))
    return any(np.array_equal(page[y : y + height, x : x + width], pixels) for y, x in first)


@pytest.mark.parametrize("size", [(60, 50), (71, 43)])
def test_pixels_of_a_png_with_axes_are_exact(draw, plane, tmp_path, size):
    frame = draw(plane, size=size, scale_bar=True, bar=ColorBar(position="bottom", unit="m"))
    frame.save(tmp_path / "a.png")
    assert holds(np.asarray(Image.open(tmp_path / "a.png").convert("RGB")), frame.rgb)


@pytest.mark.parametrize("position", [None, "right", "left", "bottom"])
def test_a_layout_states_the_position_of_image_and_colour_bar(draw, plane, tmp_path, position):
    """In figures, and in pictures without: there are the image's pixels, and at the bar's ends those of the map."""
    path = tmp_path / "a.png"
    frame = draw(plane, size=(150, 110), axes=position == "left", bar=position and ColorBar(position=position))
    if position is None:
        frame.save(path)
        layout = page(frame).layout
    else:
        layout = save_figure([frame], path, ".png")
    pixels = np.asarray(Image.open(path).convert("RGB"))
    assert pixels.shape[1::-1] == layout.size
    column, row = layout.corner
    same = (pixels[row : row + 110, column : column + 150] == frame.rgb).all(axis=-1)
    assert same[frame.seen].mean() > 0.9  # axes lie over some
    assert (np.roll(frame.rgb, 1, axis=1) == frame.rgb).all(axis=-1)[frame.seen].mean() < 0.5

    (bar,) = layout.bars
    left, top, width, height = bar.box
    low, high = frame.range
    for share in (0.03, 0.5, 0.97):
        x, y = (0.5, 1 - share) if bar.upright else (share, 0.5)
        column, row = int(left + x * width), int(top + y * height)
        # the middle of the pixel; matplotlib's bands have edges that lie over the next one, by two pixels at most
        part = 1 - (row + 0.5 - top) / height if bar.upright else (column + 0.5 - left) / width
        near = part + np.linspace(-2, 2, 41) / (height if bar.upright else width)
        colors = 255 * frame.palette.colors(low + near * (high - low))
        assert np.abs(pixels[row, column] - colors).max(axis=1).min() < 2
    assert bar.upright == (position != "bottom")


@pytest.mark.parametrize(
    "bar", [ColorBar(scale="log"), ColorBar(scale="symlog", linear=0.5), ColorBar(bands=7, round=False)]
)
def test_colours_match_the_colour_bar(draw, plane, bar):
    frame = draw(
        plane, field="exp(3*u)", size=(60, 50), bar=bar, objects=(Faces(style=Style(contours=Contours(count=1))),)
    )
    plain = draw(plane, field="exp(3*u)", size=(60, 50), bar=bar)
    low, high = plain.range
    palette = Palette.of_name("viridis", low, high).over_range(bar)
    assert np.array_equal(
        plain.rgb[plain.seen], np.rint(255 * palette.colors(plain.field[plain.seen])).astype(np.uint8)
    )
    assert len(np.unique(plain.rgb[plain.seen], axis=0)) == bar.bands or bar.bands is None
    assert (frame.rgb == plain.rgb).all(axis=-1).mean() > 0.8  # but for the line
    assert np.array_equal(
        palette.colors(np.array([np.nan, low, high])), [NOT_A_NUMBER, palette.table[0], palette.table[-1]]
    )


@pytest.mark.parametrize("ends", [(1e-3, 1e4), (-5.0, 100.0), (-2.0, -1.0)])
def test_colours_of_scales_increase_evenly(ends):
    bar = ColorBar(scale="log" if ends[0] > 0 else "symlog", bands=9)
    edges = Palette.of_name("viridis", *ends).over_range(bar).edges
    assert len(edges) == 8
    assert (np.diff([ends[0], *edges, ends[1]]) > 0).all()
    if ends[0] > 0:
        assert np.allclose(np.diff(np.log([ends[0], *edges, ends[1]])), np.log(ends[1] / ends[0]) / 9)


def test_logarithmic_scales_exclude_zero(draw, plane):
    with pytest.raises(SceneError, match=r"above zero, found .* scale=symlog"):
        draw(plane, size=(30, 20), bar=ColorBar(scale="log"), range=(-1.0, 1.0), objects=(Faces(),)).rgb.sum()


def test_one_can_see_through_the_background(draw, linear, tmp_path):
    solid = linear(one_element(Shape.HEXAHEDRON))
    how = {"objects": (Isosurface((0.1,), style=Style(opacity=0.5)),), "domain_outline": False}
    frame = draw(solid, size=(40, 30), background=(1.0, 1.0, 1.0, 0.0), **how, samples=2, camera="+x")
    assert frame.alpha[~frame.seen].min() == 0.0
    inner = frame.seen & np.roll(frame.seen, 1, 0) & np.roll(frame.seen, -1, 0)
    assert np.abs(frame.alpha[inner & (frame.alpha < 0.6)].max() - 0.5) < 1e-9
    frame.save(tmp_path / "a.png", plain=True)
    pixels = np.asarray(Image.open(tmp_path / "a.png"))
    assert pixels.shape == (30, 40, 4)
    assert pixels[~frame.seen & (frame.alpha == 0.0)][:, 3].max() == 0

    # over white it is the picture that an opaque background has
    over = pixels[..., :3] * (pixels[..., 3:] / 255) + 255 - pixels[..., 3:]
    opaque = draw(solid, size=(40, 30), **how, samples=2, camera="+x")
    assert np.abs(over - opaque.rgb).max() <= 2


def test_constant_quantities_have_a_note_instead_of_a_colour_bar(draw, linear):
    solid = linear(one_element(Shape.HEXAHEDRON))
    frame = draw(solid, size=(40, 30), objects=(Isosurface((0.1,)),), camera="+x")
    assert [legend.constant for legend in frame.legends] == [0.1]
    several = draw(solid, size=(40, 30), objects=(Isosurface((0.1, 0.2)),), camera="+x")
    assert [legend.constant for legend in several.legends] == [None]
    assert several.range == (0.1, 0.2)
    constant = render(solid, "3 + 0*u", size=(40, 30))
    assert any("is 3 everywhere in the picture" in remark for remark in constant.stats["remarks"])


def test_rulers_show_coordinates(draw, plane):
    frame = draw(plane, size=(60, 50), axes=True)
    assert aligned(frame.view.camera) == (0, 1)
    page = Page([frame], plain=False)
    drawn = [line.get_xydata().tolist() for line in page.panels[0].axes.lines]
    for axis, ruler in enumerate(sides(frame.view, (5, 5))):
        # ticks of a third of the height of texts
        ends = ruler.places + 0.35 * page.unit * ruler.away
        assert all(list(map(list, tick)) in drawn for tick in zip(ruler.places, ends, strict=True))
        places = ground(frame, ruler.places)[:, axis]
        assert np.allclose(places, [float(text) for text in ruler.texts])
    length, text = scale_bar(frame.view, 20)
    assert np.isclose(length * np.linalg.norm(frame.view.column), float(text))
    assert 8 <= length <= 20


@pytest.mark.parametrize("outputs", [(), ("a.png",)])
def test_edges_of_the_box_are_hidden_behind_the_domain(linear, outputs):
    solid = linear(one_element(Shape.HEXAHEDRON))
    frame = render(solid, Scene("u", size=(60, 50), camera="iso", box=True, objects=(Faces(),), outputs=outputs))
    low, high = frame.box
    assert np.allclose([low, high], [[-1] * 3, [1] * 3])
    hidden = np.array([[low, [high[0], low[1], low[2]]]])[0]
    ends = np.column_stack([hidden, np.ones(2)]) @ frame.view.to_pixel.T
    middle = (ends[:, :2] / ends[:, 2:]).mean(axis=0)
    assert len(box_edges(frame)) >= 9
    assert all(np.abs(line.mean(axis=0) - middle).max() > 1.0 for line in box_edges(frame))


def test_views_in_perspective_have_no_scale_bar(draw, linear, tmp_path):
    frame = draw(linear(one_element(Shape.HEXAHEDRON)), size=(40, 30), camera=Camera((4, 5, 6), (0, 0, 0), fov=40.0))
    with pytest.raises(SceneError, match="parallel view"):
        replace(frame, scene=replace(frame.scene, scale_bar=True)).save(tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_titles_with_broken_mathematics_are_rejected(draw, plane, tmp_path):
    frame = draw(plane, size=(30, 20), title=r"$\nothing$")
    with pytest.raises(SceneError, match="expected mathematics between dollars"):
        frame.save(tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_contours_that_are_points_have_no_labels(draw, plane, tmp_path):
    """As of a value that the field has only where it is greatest."""
    style = Style(contours=Contours(values=(0.5,), labels=True))
    frame = draw(plane, size=(300, 240), objects=(Faces(style=style),), outputs=("a.svg",))
    dots = tuple(replace(own, lines=tuple(line[:1] for line in own.lines)) for own in frame.drawing.strokes)
    replace(frame, drawing=replace(frame.drawing, strokes=dots)).save(tmp_path / "a.svg")
    # next to the bar only
    assert (tmp_path / "a.svg").read_text(encoding="utf-8").count(">0.5</text>") == 1


def test_panels_are_in_rows_with_one_colour_bar(draw, plane, tmp_path):
    frames = [draw(plane, size=(30, 20), panels=(2, 2), range=(0.0, 2.0), title=name) for name in "abc"]
    save_panels(frames, tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert [len(re.findall(f">{name}</text>", text)) for name in "abc"] == [1, 1, 1]
    assert text.count(">u</text>") == 1
    assert sum(np.array_equal(image, frames[0].rgb) for image in images_of(text)) == 3
    save_panels(frames, tmp_path / "a.png")
    assert holds(np.asarray(Image.open(tmp_path / "a.png").convert("RGB")), frames[0].rgb)
    with pytest.raises(SceneError, match=r"found \.npz"):
        save_panels(frames, tmp_path / "a.npz")


def test_ranges_of_panels_cover_all_panels(draw, plane):
    frames = [draw(plane, field=name, size=(30, 20), objects=(Faces(),)) for name in ("u", "u")]
    low, high = in_one_range([frames[0], replace(frames[1], drawing=frames[1].drawing)])
    assert (low, high) == frames[0].range
    assert in_one_range([frames[0], draw(plane, field="2*u", size=(30, 20))]) is None
    assert in_one_range([frames[0], draw(plane, size=(30, 20), range=(0.0, 1.0))]) is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("scale=log,ticks=1 10 100,title=p, in all", ColorBar(scale="log", ticks=(1, 10, 100), title="p, in all")),
        ("bands=8, unit=m/s, position=left", ColorBar(bands=8, unit="m/s", position="left")),
    ],
)
def test_a_colour_bar_on_the_command_line(text, expected):
    assert parameters.bar(text) == expected


@pytest.mark.parametrize("text", ["scale=cubic", "bands=two", "colour=red", "log", "bands=1"])
def test_an_invalid_colour_bar(text):
    with pytest.raises((SceneError, BadParameter)):
        parameters.bar(text)


def test_only_backgrounds_have_opacity():
    assert parameters.background("#ffffff00") == (1, 1, 1, 0)
    assert parameters.background("1,1,1,0.5") == (1, 1, 1, 0.5)
    assert parameters.background("transparent")[3] == 0
    with pytest.raises(SceneError, match="without opacity"):
        parameters.color("#ffffff00")


def test_a_region_is_the_extent_of_the_picture(draw, plane):
    frame = draw(plane, region=(0.2, 0.6, 0.2, 0.4))
    corner = ground(frame, [[-0.5, frame.view.height - 0.5], [frame.view.width - 0.5, -0.5]])
    assert np.allclose(corner[:, :2], [[0.2, 0.2], [0.6, 0.4]], atol=1e-3)
    assert frame.seen.all()


def test_lines_and_glyphs_lie_in_a_region_and_2d_data_are_seen_from_above(draw):
    bare = Dataset(mixed_plane(0))
    dataset = Dataset(bare.mesh, tuple(approximated(bare, name, lambda p: 1 + 0 * p[:, 0], 2) for name in "uv"))
    line, arrow = Streamlines(("point:0.3,0.1",), width=2.0), Glyphs(("point:0.6,0.6",), length=0.1)
    shown = {"field": "u", "objects": (Faces(), line, arrow), "size": (60, 30)}
    frame = draw(dataset, **shown, region=(0.2, 1.2, 0.1, 0.6))
    corner = ground(frame, [[-0.5, 29.5], [59.5, -0.5]])
    assert np.allclose(corner[:, :2], [[0.2, 0.1], [1.2, 0.6]], atol=1e-3)
    assert frame.seen.all()
    whole = draw(dataset, **shown)
    right, up, forward = whole.view.camera.basis()
    assert np.allclose([right, up, forward], [[1, 0, 0], [0, 1, 0], [0, 0, -1]])


def test_zoom_preserves_the_centre(draw, plane):
    near, far = draw(plane, size=(60, 50), zoom=2.0).view, draw(plane, size=(60, 50)).view
    assert np.isclose(near.camera.height, 0.5 * far.camera.height)
    assert np.allclose(near.camera.at, far.camera.at)


@pytest.mark.parametrize("region", [(0.5, 0.2, 0.0, 1.0), (0.0, 1.0, 1.0, 1.0)])
def test_a_region_ascends(region):
    with pytest.raises(SceneError, match="region: expected x0 < x1"):
        Scene(region=region)


def test_a_region_is_of_planes(draw, linear):
    with pytest.raises(SceneError, match="region: expected 2D data or a single plane"):
        draw(linear(one_element(Shape.HEXAHEDRON)), size=(30, 20), region=(0, 1, 0, 1), objects=(Faces(),))


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -2)])
def test_a_camera_that_looks_along_up_gets_another_up_direction(up):
    right, upward, _ = Camera((0, 0, 5), (0, 0, 0), up).basis()
    assert np.allclose([right, upward], [[1, 0, 0], [0, 1, 0]])
    assert np.allclose(Camera((0, 5, 0), (0, 0, 0), (0, 1, 0)).basis()[1], [0, 0, 1])


def test_long_texts_never_widen_a_figure(plane):
    """Titles, units, texts and names break at spaces outside mathematics, and end with an ellipsis."""
    settings = {"size": (100, 60), "device": "reference", "axes": True}
    usual = page_size(render(plane, bar=ColorBar(title="a"), **settings))
    for text, position in (("W" * 9_000, "right"), ("$x^2$ in m " * 40, "bottom"), ("\n" * 9_000, "right")):
        bar = ColorBar(title=text, unit=text, position=position)
        texts = (Caption(text, (0.5, 0.5, 0.0)),)
        width, height = page_size(render(plane, title=text, bar=bar, texts=texts, **settings))
        assert width < usual[0] + 250
        assert height < usual[1] + 400


def page_size(frame):
    """Width and height of a figure in pixels."""
    content = BytesIO()
    save_figure([frame], content, ".png")
    return Image.open(content).size


def test_texts_that_fit_are_unchanged(plane):
    figure = Page([render(plane, size=(200, 100), device="reference", axes=True)], plain=True)
    for text in ("two  words\nof $x y$", "$a b$ c"):
        assert broken_lines(text, 1000, figure.measure(), 10) == text
    first, second = broken_lines(f"$a b$ {'c' * 400}", 200, figure.measure(), 10).splitlines()
    assert first == "$a b$"
    assert re.fullmatch("c+…", second)


def test_long_mathematics_is_an_error(plane):
    with pytest.raises(SceneError, match="at most 1000 characters of text with mathematics, found 9002"):
        save_figure([render(plane, title=f"${'x' * 9_000}$", size=(30, 20), device="reference")], BytesIO(), ".png")


@pytest.mark.parametrize("name", [r"$\foo{$", "a$b$"])
def test_names_of_fields_are_no_mathematics(name, linear):
    data = linear(grid(Shape.QUADRILATERAL, 1), name=name)
    for unit in ("$m^2$", "m"):
        content = BytesIO()
        save_figure([render(data, size=(60, 50), device="reference", bar=ColorBar(unit=unit))], content, ".svg")
    assert f">{name} [m]<" in content.getvalue().decode()


def test_mathematics_in_units_is_checked(plane):
    frame = render(plane, size=(60, 50), device="reference", bar=ColorBar(unit=r"$\foo$"))
    with pytest.raises(SceneError, match="title: expected mathematics between dollars"):
        save_figure([frame], BytesIO(), ".png")
