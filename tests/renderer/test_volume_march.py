"""Light along rays of volumes, surfaces and regions that hide volumes, against sums over many small steps."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT, TILE, SEGMENTS = 48, 64, 3
STEPS = 4000
FOUND = {
    **dict.fromkeys(["listed", "near", "far"], 1),
    "color": 3,
    **dict.fromkeys(["through", "clear", "error", "length", "undefined", "counted", "marks", "alpha", "coverage"], 1),
}
VALUES = np.array([-0.6, -0.1, 0.2, 0.7])
DENSITIES = np.array([0.0, 1.5, 0.3, 0.0])
COLORS = np.array([[1.0, 0.2, 0.0], [0.1, 0.9, 0.3], [0.5, 0.5, 1.0], [0.0, 0.3, 0.8]])
BINOMIALS = np.array([1, 3, 3, 1])


class Rays:
    """Three segments each, some of which overlap or are not numbers; two surfaces, two depths that hide or show."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        starts = np.sort(some(1, 4, SEGMENTS), axis=1)
        self.first, self.last = starts, starts + some(0.2, 1.0, SEGMENTS)
        self.last = np.maximum.accumulate(self.last, axis=1)
        self.nets = some(-1, 1, SEGMENTS, 4)
        self.nets[5, 1, 2] = np.nan
        # outside of all densities
        self.nets[6:9] = 0.8 + 0.1 * self.nets[6:9]
        self.off = rng.choice([0.0, 1e-3], (COUNT, 1)) * np.ones(SEGMENTS)
        self.nets[8] = 0.7 + 0.05 * np.abs(some(0, 1, SEGMENTS, 4)[8])
        self.nets[8, :, 0] = 0.7
        self.off[6], self.off[7], self.off[8] = 0.0, 0.3, 1e-6
        self.surfaces = some(0.5, 6, 2)
        self.surfaces[::3] = np.inf
        self.paints = np.concatenate([some(0, 0.5, 2, 3), some(0.2, 1.0, 2, 1)], axis=2)
        self.stops, self.hides = (
            np.sort(some(1, 5, 2), axis=1),
            np.array([[1, -1], [-1, 1], [0, 0]])[np.arange(COUNT) % 3],
        )
        self.hidden = np.array([0, 1, 0])[np.arange(COUNT) % 3]
        self.scale, self.allowed = some(0.5, 3), 10.0 ** some(-8, -2)
        self.allowed[8] = 1e-3

    def lists(self):
        """Arrays of the kernel: entry k of a pixel at TILE (4 n + k) + lane, in another order than by depth."""
        slots = np.arange(COUNT)[:, None] * 4 * TILE + np.arange(SEGMENTS) * TILE + (np.arange(COUNT) % TILE)[:, None]
        order = np.array([2, 0, 1])
        return slots, order

    def field(self, k, number, z):
        t = (z - self.first[k, number]) / (self.last[k, number] - self.first[k, number])
        powers = np.arange(4)
        return (BINOMIALS * self.nets[k, number] * t[:, None] ** powers * (1 - t[:, None]) ** (3 - powers)).sum(axis=1)

    def light(self, k, shift=0.0):
        """Colour, transmitted parts in all and by volumes, and length, with the quantity moved by a shift."""
        ends = np.unique(np.concatenate([self.first[k], self.last[k], self.surfaces[k], self.stops[k]]))
        ends = ends[np.isfinite(ends)]
        color, through, clear, length = np.zeros(3), 1.0, 1.0, 0.0
        surfaces = sorted(zip(self.surfaces[k], self.paints[k], strict=True), key=lambda own: own[0])
        for low, high in zip(ends, [*ends[1:], ends[-1]], strict=True):
            for depth, paint in surfaces:
                if depth == low:
                    color, through = color + through * paint[:3], through * (1 - paint[3])
            middle = 0.5 * (low + high)
            hides = self.hidden[k] + self.hides[k][self.stops[k] < middle].sum()
            owners = [n for n in range(SEGMENTS) if self.first[k, n] < middle < self.last[k, n]]
            owners = [n for n in owners if np.isfinite(self.nets[k, n]).all()]
            if hides or not owners or high == low:
                continue
            width = self.scale[k] * (high - low) / STEPS
            field = self.field(k, owners[0], low + (np.arange(STEPS) + 0.5) / STEPS * (high - low)) + shift
            optical = width * np.interp(field, VALUES, DENSITIES)
            behind = np.exp(-np.cumsum(optical))
            seen = np.concatenate([[1.0], behind[:-1]]) * -np.expm1(-optical)
            shades = np.stack([np.interp(field, VALUES, own) for own in COLORS.T], axis=1)
            color = color + through * (seen[:, None] * shades).sum(axis=0)
            through, clear = through * behind[-1], clear * behind[-1]
            length += self.scale[k] * (high - low)
        return color, through, clear, length


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(17))


@pytest.fixture(scope="module")
def found(functions, rays):
    kernel = functions("volume_march")
    slots, order = rays.lists()
    room = 4 * TILE * COUNT
    segments, medium, composition = (
        kernel.records(*own) for own in (("segments", room), ("medium", 1), ("composition", 1))
    )
    fields, ranks = np.zeros((room, 4)), np.zeros(room, np.uint32)
    for k in range(SEGMENTS):
        # the k-th by depth is stored as entry order[k]
        entry = slots[:, order[k]]
        segments["first"][entry], segments["last"][entry] = rays.first[:, k], rays.last[:, k]
        segments["off"][entry], fields[entry] = rays.off[:, k], rays.nets[:, k]
        ranks[slots[:, k]] = order[k]
    counts = np.zeros(TILE * COUNT, np.uint32)
    counts[TILE * np.arange(COUNT) + np.arange(COUNT) % TILE] = SEGMENTS
    medium["count"], medium["densest"] = len(VALUES), DENSITIES.max()
    slopes = np.abs(np.diff(DENSITIES) / np.diff(VALUES)), np.abs(np.diff(COLORS, axis=0)).max(axis=1) / np.diff(VALUES)
    medium["steepest"] = max(slopes[0].max(), slopes[1].max() * DENSITIES.max())
    stops = kernel.records("stops", 2 * COUNT)
    stops["depth"], stops["hides"] = rays.stops.reshape(-1), rays.hides.reshape(-1)
    composition["count"], composition["pixels"] = 2, COUNT
    given = {
        "segments": segments,
        "fields": fields,
        "ranks": ranks,
        "counts": counts,
        "medium": medium,
        "values": VALUES,
        "densities": DENSITIES,
        "colors": COLORS,
        "stops": stops,
        "hidden": rays.hidden.astype(np.int32),
        "composition": composition,
        "fragment_depths": np.ascontiguousarray(rays.surfaces.T),
        "fragment_colors": np.ascontiguousarray(rays.paints.swapaxes(0, 1)),
        "ray_integrals": kernel.records("ray_integrals", COUNT),
        "tally": np.zeros(2 * COUNT, np.uint32),
    }
    rows = rows_of(COUNT, [rays.scale, rays.allowed, rays.allowed])
    (found,) = parted(kernel(rows, width_of([FOUND]), **given), [FOUND])
    return found


def test_light_is_that_of_all_small_steps(rays, found):
    """Emission and absorption between surfaces, in order of depth; each within the error that is stated."""
    for k in range(COUNT):
        color, through, clear, length = rays.light(k)
        opaque = min(1e-6, 0.1 * rays.allowed[k])
        assert np.abs(found["color"][k] - color).max() <= found["error"][k] + opaque + 2e-6
        if through > rays.allowed[k]:
            assert found["through"][k] == pytest.approx(through, rel=1e-5, abs=0)
            assert found["clear"][k] == pytest.approx(clear, rel=1e-5, abs=0)
            assert found["length"][k] == pytest.approx(length, rel=1e-9, abs=1e-12)
        assert found["alpha"][k] == 1 - found["through"][k]
        assert found["coverage"][k] == 1 - found["clear"][k]
    exact = (rays.off[:, 0] == 0) & (found["clear"] > 0)
    assert (found["error"] <= rays.allowed * (1 + 1e-9))[exact].all()
    assert (found["error"] > 1e-3 * rays.allowed)[exact].sum() > 5


def test_errors_of_quantities_move_light_by_what_is_stated(rays, found):
    shares = []
    for k in np.flatnonzero((rays.off[:, 0] == 1e-3) & (rays.allowed < 1e-4)):
        for shift in (-1e-3, 1e-3):
            color = rays.light(k, shift)[0]
            away = np.abs(found["color"][k] - color).max()
            assert away <= found["error"][k] + 2e-6
            shares.append(away / found["error"][k])
    assert len(shares) > 5
    assert max(shares) > 0.1


def test_segments_are_counted_and_pixels_marked(rays, found):
    """Those that aren't numbers; rays with a larger error than allowed, and without light with more than is visible."""
    assert (found["listed"] == SEGMENTS).all()
    assert (found["counted"] == SEGMENTS).all()
    assert np.array_equal(found["near"], rays.first[:, 0])
    assert np.array_equal(found["far"], rays.last[:, -1])
    assert np.array_equal(found["undefined"] > 0, np.arange(COUNT) == 5)
    covers = found["coverage"] > 0
    proved = found["error"] <= np.where(covers, rays.allowed, np.minimum(rays.allowed, 1e-9))
    assert np.array_equal(found["marks"], 4 * found["undefined"] + 2 * ~proved + covers)
    assert not covers[6:9].any()
    assert proved[6:9].tolist() == [True, False, False]
    assert found["error"][8] < rays.allowed[8]
    assert 0 < proved.sum() < COUNT
