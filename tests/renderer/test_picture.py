"""Colours, colour bars, titles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import ImageFont

from elvis import Camera, ColorBar, Contours, CutSurface, Faces, Plane, Scene, SceneError, Style
from elvis.core.base.errors import FormatError
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.scene.figure.picture import AXES, labels, letters_of_axes, notes, picture, sentences, shortest
from elvis.scene.record.palette import NOT_A_NUMBER, STEPS, Palette, automatic_range, is_constant, ticks

FINITE = st.floats(-1e12, 1e12)


@pytest.fixture(scope="module")
def frame(draw, linear):
    return draw(linear(grid(Shape.QUADRILATERAL, 2)), size=(80, 60))


@given(FINITE, st.floats(1e-9, 1e12), st.integers(3, 12))
def test_ticks_are_few_round_numbers(low, span, most):
    span = max(span, 1e-9 * abs(low))
    values = ticks(low, low + span, most)
    assert 1 <= len(values) <= most
    assert min(values) >= low - 1e-6 * span
    assert max(values) <= low + span * (1 + 1e-6)
    assert len(values) >= most / 5 - 1
    if len(values) > 1:
        step = np.diff(values).mean()
        mantissa = step / 10 ** np.floor(np.log10(step) + 1e-9)
        assert min(abs(mantissa - round_one) for round_one in (1, 2, 5, 10)) < 1e-3
        assert np.allclose(np.array(values) / step, np.round(np.array(values) / step), atol=1e-3)


@given(FINITE, st.floats(1e-9, 1e12), st.integers(3, 12))
def test_labels_distinguish_ticks_and_are_near_them(low, span, most):
    span = max(span, 1e-9 * abs(low))
    values = ticks(low, low + span, most)
    texts = labels(values)
    assert len(set(texts)) == len(texts)
    step = values[1] - values[0] if len(values) > 1 else max(abs(values[0]), 1)
    assert all(abs(float(text) - value) < 0.51 * step for text, value in zip(texts, values, strict=True))


@pytest.mark.parametrize(
    ("low", "high", "texts"),
    [
        (0.0, 1.0, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (-1.0, 1.0, ["-1.0", "-0.5", "0.0", "0.5", "1.0"]),
        (0.0, 35000.0, ["0", "10000", "20000", "30000"]),
        (1e-9, 5e-9, ["1e-09", "2e-09", "3e-09", "4e-09", "5e-09"]),
        (101325.0, 101326.0, ["101325.0", "101325.2", "101325.4", "101325.6", "101325.8", "101326.0"]),
    ],
)
def test_labels_of_usual_ranges(low, high, texts):
    assert labels(ticks(low, high, 6)) == texts


@pytest.mark.parametrize("low", [0.0, -1e-310, 1.0, 1e300, -1e300])
@pytest.mark.parametrize("span", [5e-324, 1e-300, 1e-16, 3e300])
def test_every_range_has_ticks(low, span):
    high = max(low + span, np.nextafter(low, np.inf))
    values = ticks(low, high, 6)
    assert 1 <= len(values) <= 6
    assert len(labels(values)) == len(values)


@given(st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False))
def test_the_shortest_text_of_a_number_is_that_number(value):
    assert float(shortest(value)) == value
    assert len(shortest(value)) <= max(len(repr(value)), 8)


@pytest.mark.parametrize(
    ("contours", "sentence"),
    [
        (Contours(count=4, round=False), "contours of u at -1.8, -0.6, 0.6, 1.8"),
        (
            Contours(count=10, round=False),
            "contours of u at -2.45, -1.91, -1.36, -0.82, -0.27, 0.27, 0.82, 1.36, 1.91, 2.45",
        ),
        (Contours(values=(1 / 3, 0.1, 1.0)), "contours of u at 0.1, 0.3333333333333333, 1"),
        (Contours(count=10), "contours of u at -2.5, -2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2.5"),
        (Contours(count=1, round=False), "contours of u at 0.142857"),
    ],
)
def test_contour_labels_have_the_typed_or_distinguishing_digits(draw, linear, contours, sentence):
    ends = (-3.0, 3.0) if contours.count != 1 else (0.0, 2 / 7)
    frame = draw(linear(grid(Shape.HEXAHEDRON, 1)), objects=(Faces(style=Style(contours=contours)),), range=ends)
    assert notes(frame, 1000, ImageFont.load_default(10)) == [sentence]


def test_colours_traverse_the_table_in_equal_steps():
    palette = Palette.of_name("viridis", 2.0, 4.0)
    assert palette.table.shape == (STEPS, 3)
    middles = 2.0 + (np.arange(STEPS) + 0.5) * 2 / STEPS
    assert np.array_equal(palette.colors(middles), palette.table)
    ends = palette.colors(np.array([2.0, 4.0, -1e300, 1e300]))
    assert np.array_equal(ends, palette.table[[0, -1, 0, -1]])
    assert (palette.colors(np.array([np.nan, np.inf, -np.inf])) == NOT_A_NUMBER).all()
    assert not (palette.table == NOT_A_NUMBER).all(axis=1).any()


def test_unknown_colour_maps_are_rejected():
    with pytest.raises(
        SceneError, match=r"colour map 'rainbowish' \(perhaps rainbow\): expected an \.xml file or a name of"
    ):
        Palette.of_name("rainbowish", 0, 1)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, np.nan, -3.0, np.inf], (-3.0, 1.0)),
        ([np.nan, -np.inf], (0.0, 1.0)),
        ([], (0.0, 1.0)),
        ([5.0, 5.0], (2.5, 7.5)),
        ([-2.0, -2.0 - 1e-15], (-3.0, -1.0)),
        ([0.0], (-1.0, 1.0)),
        ([1.0, 1.0 + 1e-12], (1.0, 1.0 + 1e-12)),
    ],
)
def test_the_automatic_range(values, expected):
    assert automatic_range(np.array(values)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("palette", "values", "expected"),
    [
        ("RdBu_r", [-1.0, 3.0], (-3.0, 3.0)),
        ("elvis:diverging", [-4.0, 3.0], (-4.0, 4.0)),
        ("coolwarm", [0.5, 3.0], (0.5, 3.0)),
        ("viridis", [-1.0, 3.0], (-1.0, 3.0)),
        ("elvis:rainbow", [-1.0, 3.0], (-1.0, 3.0)),
    ],
)
def test_zero_is_the_middle_of_a_diverging_map(palette, values, expected):
    assert automatic_range(np.array(values), palette) == expected


def test_the_plain_picture_is_the_colours(frame):
    image = picture(frame, plain=True)
    assert image.size == (80, 60)
    assert np.array_equal(np.asarray(image), np.rint(frame.color * 255).astype(np.uint8))
    assert (np.asarray(image)[~frame.seen] == 255).all()


def test_the_framed_picture_contains_the_plain_one_a_colour_bar_and_text(frame):
    plain, framed = np.asarray(picture(frame, plain=True)), np.asarray(picture(frame))
    assert framed.shape[0] > 60
    assert framed.shape[1] > 80
    corner = [
        (y, x)
        for y in range(framed.shape[0] - 59)
        for x in range(framed.shape[1] - 79)
        if np.array_equal(framed[y : y + 60, x : x + 80], plain)
    ]
    assert len(corner) == 1
    top, left = corner[0]

    # to the right: all colours of the map, largest value above; above: the dark letters of the title
    bar = framed[top : top + 60, left + 80 :]
    table = np.rint(frame.palette.table * 255).astype(np.uint8)
    column = next(bar[:, x] for x in range(bar.shape[1]) if (bar[30, x] == table[120:136]).all(axis=1).any())
    assert np.abs(column[2].astype(int) - table[-5]).max() < 15
    assert np.abs(column[-3].astype(int) - table[5]).max() < 15
    assert (framed[:top] < 100).any()


def test_titles_and_numbers_of_any_length_fit(draw, linear):
    dataset = linear(grid(Shape.QUADRILATERAL, 1), name="a field with quite a long name, longer than its picture")
    frame = draw(dataset, size=(20, 20), range=(-1e-300, 123456789.123))
    framed = np.asarray(picture(frame))
    assert (framed[:, -5:] == 255).all()
    assert (framed[-3:] == 255).all()


FIRST = {
    "elvis:blackbody": ((0, 0, 0), (1, 1, 1)),
    "elvis:bluetoyellow": ((0.0392157, 0.0392157, 0.94902), (0.94902, 0.94902, 0.0392157)),
    "elvis:grayscale": ((0, 0, 0), (1, 1, 1)),
    "elvis:rainbow": ((0, 0, 1), (1, 0, 0)),
    "elvis:diverging": ((0.229806, 0.298718, 0.753683), (0.705673, 0.0155562, 0.150233)),
}


@pytest.mark.parametrize("name", FIRST)
def test_colour_maps_of_the_first_elvis(name):
    table = Palette.of_name(name, 0.0, 1.0).table
    assert table.shape == (STEPS, 3)
    assert np.allclose(table[[0, -1]], FIRST[name], atol=1e-5)
    assert np.abs(np.diff(table, axis=0)).max() < 0.03


@pytest.fixture(scope="module")
def solid(draw, linear):
    """A cube with two quantities, contours of one, seen askew."""
    styles = (
        Style(contours=Contours(values=(-1.0, 0.5))),
        Style(quantity="x*y", contours=Contours(count=30, round=False)),
    )
    planes = Plane((0.5, 0.5, 0.5), (0, 0, 1)), Plane((0.5, 0.5, 0.5), (0, 1, 0))
    objects = tuple(map(CutSurface, planes, styles))
    return draw(linear(grid(Shape.HEXAHEDRON, 1)), objects=objects, camera="iso", size=(240, 200))


def test_every_quantity_has_its_colour_bar_and_contours(solid):
    framed = np.asarray(picture(solid)).astype(int)
    assert [legend.title for legend in solid.legends] == ["u", "x*y"]
    assert [len(legend.marks) for legend in solid.legends] == [2, 30]

    # two columns next to the image show the whole map from below to above, but for the contours across
    table = np.rint(solid.palette.table * 255).astype(int)
    beside = framed[:, 10 + 240 + 5 :]
    full = [
        x
        for x in range(beside.shape[1])
        if all((np.abs(beside[:, x] - color).max(axis=1) <= 8).any() for color in table[[20, 60, 100, 160, 220]])
    ]
    runs = np.split(np.array(full), np.flatnonzero(np.diff(full) > 1) + 1)
    assert len(runs) == 2
    assert all(len(run) >= 10 for run in runs)


def test_axes_point_along_the_view(solid, draw, linear):
    """Seen from (1, 1, 1), z goes up and x and y to both sides; 2D data have no axes."""
    plain, framed = np.asarray(picture(solid, plain=True)).astype(int), np.asarray(picture(solid)).astype(int)
    image = framed[30 : 30 + 200, 10 : 10 + 240]
    changed = (plain != image).any(axis=2)
    corner = np.where(changed[..., None], image, 255)[120:]
    assert changed[:120].sum() == 0
    places = []
    for color in AXES:
        near = np.abs(corner - color).max(axis=2) < 60
        assert near.sum() > 10
        places.append(np.argwhere(near).mean(axis=0))
    (_, x), (_, y), (z, between) = places
    assert x < between < y
    assert z < min(places[0][0], places[1][0])
    flat = draw(linear(grid(Shape.QUADRILATERAL, 1)), size=(240, 200))
    framed = np.asarray(picture(flat))
    assert (framed[30 : 30 + 200, 10 : 10 + 240] == np.asarray(picture(flat, plain=True))).all()


@pytest.mark.parametrize("size", [(40, 30), (300, 60), (60, 300), (900, 700)])
def test_legends_fit_at_any_size(draw, linear, size):
    style = Style(contours=Contours(count=12))
    frame = draw(linear(grid(Shape.HEXAHEDRON, 1)), objects=(Faces(style=style),), camera="iso", size=size)
    framed = np.asarray(picture(frame))
    assert (framed[:, -2:] == 255).all()
    assert (framed[-2:] == 255).all()
    assert (framed[:, :2] == 255).all()


def test_numbers_next_to_a_colour_bar_never_overlap(draw, linear):
    """Rows of a bar's ticks, each with its number, lie as far from one another as numbers are high."""
    framed = np.asarray(picture(draw(linear(grid(Shape.QUADRILATERAL, 1)), size=(3, 2), range=(-1.0, 1.0))))
    dark = (framed[26:, 46:] < 120).all(axis=2).any(axis=1)
    numbers = np.flatnonzero(np.diff(dark.astype(int), prepend=0) == 1)
    assert len(numbers) == 3
    assert np.diff(numbers).min() >= 12


def test_axes_do_not_cover_the_data(draw, linear):
    """They stand in a corner where nothing is seen, at the lower left if they can; else a pale disc lies under them."""
    data = linear(grid(Shape.HEXAHEDRON, 1))

    def framed(eye, at, height):
        frame = draw(data, objects=(Faces(),), camera=Camera(eye, at, height=height), size=(240, 200))
        image = np.asarray(picture(frame))[30 : 30 + 200, 10 : 10 + 240]
        return frame.seen, (image != np.asarray(picture(frame, plain=True))).any(axis=2)

    seen, axes = framed((3.0, 2.5, 2.0), (0.5, 0.5, 0.5), 2.5)
    assert axes[130:, :70].any()
    assert not axes[seen].any()
    seen, axes = framed((3.2, 2.9, 2.5), (0.7, 0.9, 1.0), 2.2)
    assert seen[130:, :70].any()
    assert axes.any()
    assert not axes[seen].any()
    seen, axes = framed((3.0, 2.5, 2.0), (0.5, 0.5, 0.5), 0.2)
    assert seen.all()
    assert axes[130:, :70].mean() > 0.7


def test_legends_name_files_without_their_folders(draw, linear, tmp_path):
    import trimesh

    trimesh.creation.box((0.4, 0.4, 0.4)).export(tmp_path / "box.stl")
    data, field = linear(grid(Shape.QUADRILATERAL, 1)), f"distance('{tmp_path / 'box.stl'}')"
    assert [legend.title for legend in draw(data, field=field, size=(30, 20)).legends] == ["distance('box.stl')"]


def test_titles_are_the_scenes(draw, linear):
    data = linear(grid(Shape.QUADRILATERAL, 1))
    titles = ("", None, "A long title of this picture")
    none, usual, long = (np.asarray(picture(draw(data, size=(200, 100), title=title))) for title in titles)
    assert len(none) < len(usual) == len(long)
    assert 0 < (usual[:25] < 100).sum() < (long[:25] < 100).sum()


def test_titles_wrap_within_the_picture(draw, linear):
    data = linear(grid(Shape.QUADRILATERAL, 1))
    words = "several words of a title " * 400
    sizes = [
        picture(draw(data, size=(200, 100), title=title)).size for title in ("short", words[:60], words, "x" * 9000)
    ]
    assert len({width for width, _ in sizes}) == 1
    heights = [height for _, height in sizes]
    assert heights[0] == heights[3] < heights[1] < heights[2] < heights[0] + 100


def test_long_names_of_fields_fit_above_bars_and_in_notes(draw, linear):
    name = "f" * 900
    data = linear(grid(Shape.HEXAHEDRON, 1), name=name)
    planes = [CutSurface(Plane((0.5, 0.5, 0.5), (0, 0, 1)), Style(quantity=own)) for own in (name, "x")]
    framed = picture(draw(data, objects=planes, size=(200, 100)))
    assert framed.width < 1000
    assert framed.height < 400


def test_external_texts_have_a_maximum_length(linear):
    with pytest.raises(SceneError, match=r"title: expected a text of at most 10000 characters, found 10001"):
        Scene(title="x" * 10_001)
    with pytest.raises(FormatError, match=r"expected a name of at most 1000 characters for a field, found 1001: 'ffff"):
        linear(grid(Shape.QUADRILATERAL, 1), name="f" * 1001)


def test_infinite_bounds_give_no_warning(recwarn):
    assert not is_constant(np.float64(np.inf), np.float64(np.inf))
    assert not recwarn


def test_whole_numbers_have_whole_ticks():
    assert ticks(2, 5, 9, is_whole=True) == [2, 3, 4, 5]
    assert ticks(0, 900, 5, is_whole=True) == [0, 200, 400, 600, 800]
    assert ticks(2, 5, 9) == [2, 2.5, 3, 3.5, 4, 4.5, 5]


@pytest.mark.parametrize(
    ("settings", "notes"),
    [
        ({}, []),
        ({"title": "slope, recovered(u)"}, []),
        ({"title": "slope"}, ["recovered(u) is recovered, not the data"]),
        ({"bar": ColorBar(title="slope")}, ["recovered(u) is recovered, not the data"]),
    ],
)
def test_recovered_quantities_are_declared_under_any_title(draw, linear, settings, notes):
    frame = draw(linear(grid(Shape.QUADRILATERAL, 2)), field="recovered(u)", size=(30, 30), **settings)
    assert sentences(frame, contours=False) == notes


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.1, -0.1])
def test_letters_of_arrows_that_coincide_are_beside_each_other(angle):
    """Seen along a diagonal, x and y lie on one another; the letter z stays where it is."""
    tips = 2.4 * np.array([[-np.cos(angle), np.sin(angle)], [-np.cos(angle), -np.sin(angle)], [0.0, 1.0]])
    letters = letters_of_axes(tips)
    assert np.linalg.norm(letters[0] - letters[1]) == pytest.approx(1.0)
    assert letters[:2].mean(axis=0) == pytest.approx(1.32 * tips[:2].mean(axis=0))
    assert (letters[1] - letters[0]) @ (tips[1] - tips[0]) >= 0.0
    assert np.array_equal(letters[2], 1.32 * tips[2])
