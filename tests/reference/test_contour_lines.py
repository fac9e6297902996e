"""Contours of the reference: the coverage that it calls certain, against curves in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from warps import bent_plane

from elvis import Camera, Clip, Contours, CutSurface, Faces, Plane, Scene, Status, Style
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.reference.picture import render
from elvis.reference.scenes.contour_search import LineSegments, Place, _shares, _solve, _whole_where_unsolved
from elvis.reference.scenes.equations import Linear
from elvis.renderer.asking.completing import completed

SIZE = (48, 40)
PLANE = Plane((0.5, 0.5, 0.52), (0.0, 0.0, 1.0))
CENTER = (0.47, 0.52)
CAMERAS = {
    "straight on": Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=1.2),
    "perspective": Camera((1.1, -0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), fov=40.0),
}


def circles(points):
    return ((points[..., :2] - CENTER) ** 2).sum(axis=-1)


def drawn(data, camera, shown=None, clip=(), quantity=None, values=(0.04, 0.09), width=2.0):
    """The frame, and how much its contours cover of each pixel."""
    contours = Contours(values, width=width, quantity=quantity, color=(0.0, 0.0, 0.0))
    style = Style(color=(1.0, 1.0, 1.0), lit=False, contours=contours)
    item = shown(style) if shown else CutSurface(PLANE, style)
    scene = Scene("u", objects=(item,), camera=camera, size=SIZE, clip=clip)
    frame = render(data, completed(data, scene))
    return frame, 1.0 - frame.color[..., 0]


def distance(view, radii, height):
    """(h, w) pixels from each pixel's centre to the nearest of some circles, by many points of these."""
    angle = np.linspace(0, 2 * np.pi, 4000)
    best = np.full((view.height, view.width), np.inf)
    rows, columns = np.indices(best.shape)
    for radius in radii:
        x, y = (CENTER[k] + radius * some(angle) for k, some in enumerate((np.cos, np.sin)))
        placed = np.stack([x, y, np.full_like(x, height), np.ones_like(x)]).T @ view.to_pixel.T
        seen = placed[:, :2] / placed[:, 2:]
        for first in range(0, len(seen), 400):
            across, down = (seen[first : first + 400, k] - some[..., None] for k, some in enumerate((columns, rows)))
            best = np.minimum(best, np.hypot(across, down).min(axis=2))
    return best


@pytest.mark.sampled
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize(("shape", "bent"), [(Shape.TETRAHEDRON, False), (Shape.PYRAMID, False), (Shape.PRISM, True)])
def test_certain_pixels_are_right(shape, bent, camera):
    mesh = curved(grid(shape, 2), bent_plane, 3) if bent else grid(shape, 2)
    frame, coverage = drawn(with_field(mesh, circles, 5 if bent else 3), CAMERAS[camera])
    expected = np.clip(1.5 - distance(frame.view, (0.2, 0.3), 0.52), 0.0, 1.0)
    certain = (frame.line_status == Status.CERTAIN) & frame.seen
    assert np.abs(coverage - expected)[certain].max() < 0.01
    assert (certain & (expected > 0.1)).sum() > 150
    assert certain.sum() > 0.97 * frame.seen.sum()
    counts = frame.stats["contours"]
    assert counts["certain"] >= certain.sum()
    assert sum(counts.values()) == frame.seen.sum()


@pytest.mark.parametrize(
    ("quantity", "value", "radii"),
    [
        ("1/(u-0.0625)", 0.0, ()),
        ("u/(u-0.0625)", -1.8, (np.sqrt(1.8 * 0.0625 / 2.8),)),
        ("sqrt(u-0.04)", 0.1, (np.sqrt(0.05),)),
        ("sign(u-0.05)", 0.5, ()),
        ("max(u,0.05)-abs(x-5)*0", 0.08, (np.sqrt(0.08),)),
    ],
)
def test_poles_jumps_and_borders_of_domains_have_no_lines(quantity, value, radii):
    data = with_field(grid(Shape.QUADRILATERAL, 2), circles, 3)
    camera = CAMERAS["straight on"]
    frame, coverage = drawn(data, camera, lambda style: Faces(style=style), quantity=quantity, values=(value,))
    expected = np.clip(1.5 - distance(frame.view, radii, 0.0), 0.0, 1.0)
    certain = (frame.line_status == Status.CERTAIN) & frame.seen
    assert np.abs(coverage - expected)[certain].max() < 0.01
    assert certain.sum() > 0.95 * frame.seen.sum()


def test_unproved_pixels_are_ambiguous():
    """Touching lines, surfaces that aren't plane, derivatives, the borders of clips."""
    data = with_field(grid(Shape.HEXAHEDRON, 2), lambda points: (points[..., 1] - 0.4) ** 2, 3)
    camera = CAMERAS["straight on"]
    frame, _ = drawn(data, camera, values=(0.0,))
    rows = np.abs(frame.position[..., 1] - 0.4) < 0.01
    assert (frame.line_status[rows & frame.seen] == Status.AMBIGUOUS).all()
    assert (frame.line_status[np.abs(frame.position[..., 1] - 0.4) > 0.1] == Status.CERTAIN).all()
    for options in ({"shown": lambda style: Faces(style=style)}, {"quantity": "d(u,y)"}):
        frame, _ = drawn(data, camera, values=(0.1,), **options)
        assert (frame.line_status[frame.seen] == Status.AMBIGUOUS).all()
    clip = Clip(Plane((0.5, 0.5, 0.5), (1.0, 0.0, 0.0)))
    frame, _ = drawn(data, camera, values=(0.01,), clip=(clip,))
    ends = frame.seen & ~(np.roll(frame.seen, 1, axis=1) & np.roll(frame.seen, -1, axis=1))
    assert ends.any()
    assert (frame.line_status[ends] == Status.AMBIGUOUS).all()
    assert (frame.line_status[frame.seen] == Status.CERTAIN).any()


def test_places_of_boxes_in_the_picture_are_off_by_no_more_than_is_stated():
    """q = N / W with both linear but for their rests: at corners of boxes, and along ways from points in them."""
    rng = np.random.default_rng(6)
    count, d = 400, 3
    corners = rng.choice([-1.0, 1.0], (40, count, d))
    off, sides = rng.choice([-1.0, 1.0], (40, 3, count)), rng.choice([-1, 1], (40, count, 2))
    part = rng.uniform(-1, 1, (40, count))
    lifted = [Linear(np.zeros(count), rng.normal(size=(count, d)), rng.uniform(0, 0.1, count)) for _ in range(2)]
    slope, rest = rng.uniform(-0.1, 0.1, (count, d)), rng.uniform(0, 0.01, count)
    over = Linear(rng.uniform(0.8, 2, count), slope, rest)
    place = Place(np.zeros((count, 2)), (lifted[0], lifted[1]), over, np.ones(count, bool))

    def at(points, number):
        columns, rows, weight = (
            own.value + (own.gradient * points).sum(axis=1) + error * own.rest
            for own, error in zip((*lifted, over), off[number], strict=True)
        )
        return np.stack([columns / weight, rows / weight], axis=1)

    middle, steps, bound = place.around
    base, way = rng.uniform(-0.2, 0.2, (count, d)), rng.uniform(-1, 1, (count, d))
    half = rng.uniform(0.1, 0.3, count)
    aside = rng.uniform(-0.05, 0.05, (count, d, 2))
    begin, step, deviation = place.along(base, way, half, aside)
    shares, ways = [], []
    for number, x in enumerate(corners):
        away = np.abs(at(x, number) - middle - np.einsum("kai,ki->ka", steps, x))
        assert (away <= bound * (1 + 1e-12)).all()
        shares.append(away / bound)
        t = part[number] * half
        x = base + t[:, None] * way + np.einsum("kim,km->ki", aside, sides[number])
        away = np.abs(at(x, number) - begin - t[:, None] * step)
        assert (away <= deviation * (1 + 1e-12)).all()
        ways.append(away / deviation)
    assert np.max(shares) > 0.7
    assert np.max(ways) > 0.7


def test_shares_of_a_line_end_where_a_coordinate_leaves_its_room():
    """Coordinates that don't change leave all of it, or nothing."""
    rng = np.random.default_rng(4)
    unseen, base, room = rng.uniform(-1, 1, (60, 3)), rng.uniform(-0.4, 0.4, (60, 3)), rng.uniform(0.2, 0.6, (60, 3))
    unseen[::2, 1] = 0.0
    low, high = _shares(base, unseen, room)
    s = np.linspace(-4, 4, 8001)
    within = (np.abs(s[:, None, None] * unseen - base) <= room).all(axis=2)
    is_any = within.any(axis=0)
    assert (low <= high)[is_any].all()
    assert s[within.argmax(axis=0)][is_any] == pytest.approx(low[is_any], abs=2e-3)
    assert s[::-1][within[::-1].argmax(axis=0)][is_any] == pytest.approx(high[is_any], abs=2e-3)
    assert (high - low < 1e-3)[~is_any].all()
    assert 10 < is_any[::2].sum() < 30


class Lines:
    """Boxes [-1, 1]^d with equations f0 + A t + r = 0, |r| <= rho, and places in the picture."""

    def __init__(self, dimension, bend):
        rng, self.count = np.random.default_rng(dimension), 80
        rows = rng.normal(size=(self.count, dimension - 1, dimension))
        rows[::4, :, 0] = 0.0
        self.equations = [
            Linear(rng.uniform(-0.6, 0.6, self.count), row, rng.uniform(0.02, 0.2, self.count))
            for row in rows.swapaxes(0, 1)
        ]
        self.gradient = rows
        self.value, self.rest = (np.stack([getattr(f, n) for f in self.equations], axis=1) for n in ("value", "rest"))
        steps = np.tile(np.eye(2, dimension), (self.count, 1, 1)) + bend * rng.normal(size=(self.count, 2, dimension))
        nothing = np.zeros(self.count)
        self.lifted = [Linear(nothing, step, bend * rng.uniform(0, 0.1, self.count)) for step in steps.swapaxes(0, 1)]
        slope = 0.1 * bend * rng.normal(size=(self.count, dimension))
        self.over = Linear(np.ones(self.count), slope, 0.2 * bend * rng.uniform(size=self.count))
        self.middle = rng.uniform(-1, 1, (self.count, 2))
        self.place = Place(self.middle, tuple(self.lifted), self.over, np.ones(self.count, bool))
        # zeros are s k - G (f0 + r)
        self.along = np.linalg.svd(rows)[2][:, -1]
        self.along /= np.abs(self.along).max(axis=1, keepdims=True)
        self.inverse = np.linalg.pinv(rows)

    def at(self, points, errors):
        """(m, n, 2) places in the picture, off by parts of their rests."""
        columns, rows, weight = (
            own.value + (own.gradient * points).sum(axis=2) + error * own.rest
            for own, error in zip((*self.lifted, self.over), errors, strict=True)
        )
        return self.middle + np.stack([columns / weight, rows / weight], axis=2)

    def zeros(self, off, points=301):
        """(m, n, d) zeros, which are in boxes or not, if r is a part of its bound."""
        return np.linspace(-4, 4, points)[:, None, None] * self.along - np.einsum(
            "nim,nm->ni", self.inverse, self.value + off * self.rest
        )


def away_from(segment, places):
    """(m, n) distances of places (m, n, 2) from segments, and the parts of these (m, n) at which they are nearest."""
    first, last = segment.ends.swapaxes(0, 1)
    way = last - first
    part = ((places - first) * way).sum(axis=2) / (way**2).sum(axis=1)
    nearest = first + part.clip(0, 1)[..., None] * way
    return np.linalg.norm(places - nearest, axis=2), part


@pytest.mark.parametrize("bend", [0.0, 1.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_zeros_in_boxes_are_within_radii_of_their_segments(dimension, bend):
    lines = Lines(dimension, bend)
    segment, solved, there = _solve(lines.equations, lines.place)
    rng, parts, reached = np.random.default_rng(5), [], []
    for _ in range(20):
        t = lines.zeros(rng.choice([-1.0, 1.0], lines.rest.shape))
        is_inside = (np.abs(t) <= 1).all(axis=2)
        assert there[is_inside.any(axis=0)].all()
        away, part = away_from(segment, lines.at(t, rng.choice([-1.0, 1.0], (3, lines.count))))
        assert (away <= segment.radius * (1 + 1e-9))[is_inside].all()
        parts.append(np.where(is_inside, away, 0.0).max(axis=0) / segment.radius)
        reached.append(np.where(is_inside, part, 0.5))
    assert np.max(parts) > 0.5
    assert np.min(reached) < 0.05
    assert np.max(reached) > 0.95
    assert 0 < there.sum() < lines.count
    around = np.einsum("nim,nm->ni", np.abs(lines.inverse), lines.rest)
    assert np.array_equal(solved, (around < 1 / 64).all(axis=1))


@pytest.mark.parametrize("dimension", [2, 3])
def test_segments_end_where_zeros_may_leave_their_box_and_are_sure_where_none_does(dimension):
    """Places are the first two coordinates, so that ends and radii have closed forms."""
    lines = Lines(dimension, 0.0)
    segment, _, there = _solve(lines.equations, lines.place)
    middle = lines.zeros(0.0, 4001)
    around = np.einsum("nim,nm->ni", np.abs(lines.inverse), lines.rest)
    radius = np.linalg.norm((np.abs(lines.inverse) * lines.rest[:, None])[:, :2].sum(axis=2), axis=1)
    assert segment.radius == pytest.approx(radius, rel=1e-12)
    for found, room in ((segment.ends, 1 + around), (segment.sure, 1 - around)):
        is_inside = (np.abs(middle) <= room).all(axis=2)
        is_any = is_inside.sum(axis=0) > 5
        assert there[is_any].all()
        number, last = np.arange(lines.count), len(middle) - 1 - is_inside[::-1].argmax(axis=0)
        ends = np.stack([middle[is_inside.argmax(axis=0), number, :2], middle[last, number, :2]], axis=1)
        ends = ends + lines.middle[:, None]
        found, ends = (np.take_along_axis(own, own[:, :, :1].argsort(axis=1), axis=1) for own in (found, ends))
        assert found[is_any] == pytest.approx(ends[is_any], abs=4e-3)
        assert is_any.sum() > 10
    is_none = ~is_inside.any(axis=0)
    assert np.isnan(segment.sure[is_none]).mean() > 0.8

    # nothing is known with an unbounded equation, and of boxes that aren't in front of the eye
    last = lines.equations[-1]
    unbounded = Linear(last.value, last.gradient, np.full(lines.count, np.inf))
    behind = replace(lines.place, before=np.zeros(lines.count, bool))
    for equations, place in (([*lines.equations[:-1], unbounded], lines.place), (lines.equations, behind)):
        _, is_solved, may_be = _solve(equations, place)
        assert not is_solved.any()
        assert may_be.all()


def test_boxes_without_a_direction_are_drawn_whole():
    """Segments are replaced if their radius isn't smaller than half the box; all places of boxes are within theirs."""
    lines = Lines(2, 1.0)
    segment, _, _ = _solve(lines.equations, lines.place)
    _, step, rest = lines.place.around
    lengths = np.linalg.norm(step, axis=1)
    limit = lengths.sum(axis=1) + np.linalg.norm(rest, axis=1)
    solved = np.arange(lines.count) % 3 > 0
    close = np.where(np.arange(lines.count) % 2 == 0, 0.99, 1.01) * limit
    given = LineSegments(segment.ends, segment.sure, close)
    found, whole = _whole_where_unsolved(given, solved, lines.place)
    assert np.array_equal(whole, ~(solved & (close < limit)))
    assert np.isnan(found.sure[whole]).all()
    for name in ("ends", "sure", "radius"):
        assert np.array_equal(getattr(found, name)[~whole], getattr(given, name)[~whole], equal_nan=True)
    shorter = lengths.min(axis=1) + np.linalg.norm(rest, axis=1)
    assert found.radius[whole] == pytest.approx(shorter[whole], rel=1e-12)
    rng = np.random.default_rng(7)
    t = rng.choice([-1.0, 1.0], (60, lines.count, 2))
    away, _ = away_from(found, lines.at(t, rng.choice([-1.0, 1.0], (3, 60, lines.count))))
    assert (away <= found.radius * (1 + 1e-12))[:, whole].all()
    assert (away / found.radius)[:, whole].max() > 0.5
