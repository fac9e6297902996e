"""Bounds that iso_follow states of sub-elements: against their largest values in NumPy, and along rays."""

from itertools import product

import numpy as np
import pytest
from kernel_functions import parted, width_of
from numpy.polynomial import chebyshev
from sub_elements import COUNT, LEBESGUE, ORDER, POWERS, SUMMED, SubElements, outside_of, terms_at

from elvis.core.polynomials.chebyshev_nodes import series
from elvis.renderer.passes.isosurface.enclosing import AXES, BOXES, tails

#: room around sub-elements, and extents that are tried, as in the kernel
ROOM, REACHES = 1e-3, (2.1, 2.5, 3.0, 4.0)


FIELDS = {"map": 3, "bends": 3, "curls": 3, "field": 1, "steep": 1, "pure": 3, "mixed": 3, "half_hessian": 1}
BENEFITS = {"gain": 3, "straight": 3, "profit": 3}
REMAINDER = {**FIELDS, **BENEFITS}
FOLLOWED = {
    "follows": 1,
    "effort": 1,
    "extent": 1,
    "remainder": 1,
    "steepest": 1,
    "stretch": 1,
    "curvature": 1,
    "half_hessian": 1,
    "noise": 1,
    "derivative_error": 1,
    "worth": 3,
    "direction": 3,
}
FOUND = [
    REMAINDER,
    REMAINDER,
    {"misfit": 4},
    REMAINDER,
    {"deviation": 3, "around": 3, "extent": 1, "worth": 3, "shift": 3},
    FOLLOWED,
    {"within": 1, "beyond": 1, "taylor": 1, "outcome": 1, "spread": 2, "first": 2, "last": 2, "aside": 2},
]
#: first and last column and row of the picture, and of those of its pixels that are drawn
PICTURE, DRAWN = np.array([[2, 1], [60, 50]]), np.array([[5, 3], [44, 32]])


def remainder_of(cases, c):
    """The largest values on [-c, c]^3 of nonlinear parts of map and field, and of their derivatives: at a corner."""
    bent, field = np.abs(cases.steps()), cases.series[..., 3]
    world = np.einsum("ni,nij->nj", cases.gradient, cases.inverse)
    nonlinear = np.abs(field - np.einsum("ntj,nj->nt", cases.series[..., :3], world))
    bent[:, ORDER < 2], nonlinear[:, ORDER < 2] = 0.0, 0.0
    eye = np.eye(3, dtype=int)
    at, first = terms_at(c, (0, 0, 0)), np.stack([terms_at(c, eye[k]) for k in range(3)], axis=-1)
    second = np.stack([terms_at(c, 2 * eye[k]) for k in range(3)], axis=-1)
    cross = np.stack([terms_at(c, 1 - eye[k]) for k in range(3)], axis=-1)
    total = second.sum(axis=-1) + 2 * cross.sum(axis=-1)
    beside = np.stack([np.maximum(bent[..., k - 2], bent[..., k - 1]) for k in range(3)], axis=-1)
    pure, mixed = (np.einsum("ntk,nt->nk", some, nonlinear) for some in (second, cross))
    return {
        "map": np.einsum("nt,ntk->nk", at, bent),
        "bends": np.einsum("nt,ntk->nk", first.sum(axis=-1), bent),
        "curls": np.einsum("nt,ntk->nk", total, bent),
        "field": (at * nonlinear).sum(axis=1),
        "steep": (first.sum(axis=-1) * nonlinear).sum(axis=1),
        "pure": pure,
        "mixed": mixed,
        "half_hessian": pure.sum(axis=1) / 2 + mixed.sum(axis=1),
        "gain": np.einsum("ntk,nt->nk", first, bent.max(axis=-1)),
        "straight": np.einsum("ntk,ntk->nk", first, beside) + np.einsum("ntk,ntk->nk", second, bent),
        "profit": np.einsum("ntk,nt->nk", first, nonlinear),
    }


def with_errors(remainder, shift, error, once, twice, across):
    """With differences of the map and the field, whose derivatives are at most so many times as large."""
    once, twice, across = (np.broadcast_to(np.asarray(each, float), shift.shape) for each in (once, twice, across))
    error = error[:, None]
    found = dict(remainder)
    found["map"] = remainder["map"] + shift
    found["bends"] = remainder["bends"] + once.sum(axis=1, keepdims=True) * shift
    found["curls"] = remainder["curls"] + (twice + 2 * across).sum(axis=1, keepdims=True) * shift
    found["steep"] = remainder["steep"] + (once * error).sum(axis=1)
    found["pure"], found["mixed"] = remainder["pure"] + twice * error, remainder["mixed"] + across * error
    found["half_hessian"] = found["pure"].sum(axis=1) / 2 + found["mixed"].sum(axis=1)
    return found


def with_misfit(remainder, misfit):
    """With values, first, pure and mixed second derivatives (n, 4) of a difference of the field, in each direction."""
    value, first, pure, mixed = misfit.T
    found = dict(remainder)
    found["field"], found["steep"] = remainder["field"] + value, remainder["steep"] + 3 * first
    found["pure"], found["mixed"] = remainder["pure"] + pure[:, None], remainder["mixed"] + mixed[:, None]
    found["half_hessian"] = remainder["half_hessian"] + 1.5 * pure + 3 * mixed
    return found


def misfit_of(spread, c):
    """(n, 4) on the smallest known box, by the ellipse on which the second derivatives have the smallest bound."""
    known = tails(2)
    boxes = np.searchsorted(BOXES, c)
    found = np.full((len(c), 4), np.inf)
    for k, box in enumerate(boxes):
        if box < len(BOXES):
            found[k] = spread[k] * known[1 + np.argmin(known[1:, box, 2]), box]
    return np.where(spread[:, None] > 0, found, 0.0)


def check_equal(found, expected, names, rounding=1e-12):
    for name in names:
        assert found[name] == pytest.approx(expected[name], rel=rounding, abs=1e-13), name


@pytest.fixture(scope="module")
def follow(functions):
    kernel = functions("iso_follow", "export static const bool analytic = true;")
    given = {"axes": np.array(AXES), "box_sizes": np.array(BOXES), "tails": tails(2)}

    def follow(cases, looks=None):
        """All that follows for sub-elements or, given where they are seen, only that."""
        places = Looks(np.random.default_rng(20)) if looks is None else looks
        rows = np.hstack([cases.rows(), places.rows()])
        *groups, looked = parted(kernel(rows, width_of(FOUND), **given), FOUND)
        return groups if looks is None else looked

    return follow


class Looks:
    """Sub-elements in a picture: pixels middle + x / w, with x and w in intervals."""

    def __init__(self, rng):
        self.perspective = rng.integers(2, size=COUNT)
        self.middle, self.miss = rng.uniform([0, 0], [52, 40], (COUNT, 2)), rng.uniform(-8, 8, (COUNT, 2))
        self.total, self.depth = rng.uniform(0.01, 6, (COUNT, 4)), rng.uniform(-0.5, 4, COUNT)
        self.total[:, 2] = rng.uniform(0.01, 1, COUNT)

    def rows(self):
        return np.column_stack([self.perspective, self.middle, self.miss, self.depth, self.total])

    def pixels(self, weights):
        """Pixels (2, n, k, 2) of both ends at weights (n, k)."""
        ends = np.stack([self.miss - self.total[:, :2], self.miss + self.total[:, :2]])
        return self.middle[:, None] + ends[:, :, None] / weights[..., None]


MARKOV = {"once": 4.0, "twice": 4.0 * 3.0 / 3.0, "across": 16.0}


def test_pixels_that_sub_elements_may_meet(follow):
    looks = Looks(np.random.default_rng(21))
    found = follow(SubElements(np.random.default_rng(1), 1.0), looks)
    near, far = looks.depth - looks.total[:, 2], looks.depth + looks.total[:, 2]
    wide = looks.perspective > 0
    crosses = wide & (near <= 0) & (far > 0)
    assert (found["outcome"][far <= 0] == -1).all()

    # in front of the eye: by the ends of the intervals
    ahead = (far > 0) & ~crosses
    weights = np.where((ahead & wide)[:, None], np.stack([near, far], axis=1), 1.0)
    pixels = looks.pixels(weights)
    ends = pixels.min(axis=(0, 2)), pixels.max(axis=(0, 2))
    first = np.maximum(np.ceil(ends[0] - 1e-6), PICTURE[0])
    last = np.minimum(np.floor(ends[1] + 1e-6), PICTURE[1])
    is_seen = (first <= last).all(axis=1) & (first <= DRAWN[1]).all(axis=1) & (last >= DRAWN[0]).all(axis=1)
    assert np.array_equal(found["outcome"][ahead], np.where(is_seen, 1, -1)[ahead])
    seen = ahead & is_seen
    assert 8 < seen.sum() < ahead.sum()
    assert np.array_equal(found["first"][seen], first[seen])
    assert np.array_equal(found["last"][seen], last[seen])
    farthest = np.maximum(np.abs(first - looks.middle), np.abs(last - looks.middle))
    assert found["aside"][seen] == pytest.approx(farthest[seen], rel=1e-12)
    # the end that is farther away is the first one, and the last one, in some
    assert len(set(np.argmax(np.abs([first - looks.middle, last - looks.middle])[:, seen, 0], axis=0))) == 2
    size = (np.abs(looks.miss) + looks.total[:, :2]) / weights[:, :1] + 1e-6
    assert found["spread"][ahead] == pytest.approx(size[ahead], rel=1e-12, abs=0)

    # next to the eye: only what lies beyond one side of the picture at all distances is left out
    shares = np.linspace(1e-6, 1, 400)
    pixels = looks.pixels(shares * np.maximum(far, 1e-9)[:, None])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    may_be_seen = ((low <= PICTURE[1] + 1) & (high >= PICTURE[0])).all(axis=2).any(axis=1)
    assert (found["outcome"][crosses & may_be_seen] == 0).all()
    is_beside = ((low > PICTURE[1] + 1) | (high < PICTURE[0])).all(axis=1).any(axis=1)
    assert is_beside[crosses & (found["outcome"] == -1)].all()
    assert (found["outcome"][crosses] == -1).any()
    assert (found["first"][crosses & may_be_seen] == PICTURE[0]).all()
    assert (found["last"][crosses & may_be_seen] == PICTURE[1]).all()


def test_remainders_are_the_largest_values_of_nonlinear_parts(follow):
    """The corner of a cube has the largest values if all coefficients are positive; errors and misfits add to them."""
    cases = SubElements(np.random.default_rng(1), 1.0)
    plain, errors, misfit, both, *_ = follow(cases)
    expected = remainder_of(cases, cases.c)
    check_equal(plain, expected, REMAINDER)
    check_equal(errors, with_errors(expected, cases.off, cases.error, **MARKOV), FIELDS)
    misfits = misfit_of(cases.spread, np.ones(COUNT))
    assert misfit["misfit"] == pytest.approx(misfits, rel=1e-12, abs=0)
    check_equal(both, with_misfit(errors, misfits), FIELDS)


def deviations_of(cases, c):
    """How far points of [-c, c]^3 are from the straight lines."""
    bent = np.abs(cases.steps())
    bent[:, ORDER < 2] = 0.0
    return np.einsum("nt,ntk->nk", terms_at(c, (0, 0, 0)), bent)


def extents_of(cases, off):
    """The first extent that holds the points of rays through it, or the largest."""
    own = deviations_of(cases, np.ones(COUNT))
    wander, least = np.minimum(own.max(axis=1), 0.1), 1 + 2 * ROOM + 2 * np.minimum(off.max(axis=1), 0.1)
    found = np.full(COUNT, np.nan)
    for reach in REACHES:
        extent = least + reach * wander
        farthest = own + off + deviations_of(cases, extent)
        found = np.where(np.isnan(found) & (farthest <= extent[:, None] - 1 - ROOM).all(axis=1), extent, found)
    return np.where(np.isnan(found), extent, found)


def worth_of(remainder, size, error):
    by_field = 2 * remainder["gain"] + remainder["profit"] / size[:, None]
    return np.where((size <= 4 * error)[:, None], remainder["straight"], by_field)


class Followed:
    """What is known of rays through sub-elements: iso_follow, in NumPy."""

    def __init__(self, cases, pixels=(10, 20)):
        px, py = cases.grid_places.T
        vx, vy = cases.grid_values.T
        gradient, inverse = np.abs(cases.gradient), np.abs(cases.inverse)
        misplaced = np.maximum(cases.misplaced, py)
        levels = np.stack([2 * cases.across, 2 * cases.across, np.ones(COUNT)], axis=1)
        to_places = np.einsum("nij,nj->ni", inverse, levels)
        self.extent = extents_of(cases, (misplaced + px)[:, None] * to_places)
        growth = chebyshev.chebval(self.extent, [0, 0, 1]) ** 3
        self.shift = shift_of(cases, growth, growth * cases.amplification * misplaced)
        own, local = np.maximum(cases.own, vy), SUMMED * (np.abs(cases.value) + cases.most[:, 3])
        error = growth * (cases.amplification * own + local)

        # of the series, of its distance from the quantity, and of errors that are analytic themselves
        remainder = remainder_of(cases, self.extent)
        by_shift = (gradient * self.shift).sum(axis=1)
        remainder = with_errors(remainder, self.shift, error + by_shift, **MARKOV)
        beside = self.extent + 3e-3
        misfit = misfit_of(cases.spread, beside)
        moved = px[:, None] * to_places
        smooth, steepness = vx + (gradient * moved).sum(axis=1), 1 / (AXES[1] - beside)
        analytic = steepness[:, None], 2 * steepness[:, None] ** 2, 2 * steepness[:, None] ** 2
        remainder = with_errors(with_misfit(remainder, misfit), moved, smooth, *analytic)

        # rays: directions, second derivatives along them
        turned = inverse[:, :, 0] * cases.aside[:, :1] + inverse[:, :, 1] * cases.aside[:, 1:]
        self.direction = inverse[:, :, 2] + cases.perspective[:, None] * turned
        q = np.minimum(remainder["bends"].max(axis=1), 0.5)
        bend, longest, curl = q / (1 - q), self.direction.max(axis=1), remainder["curls"].max(axis=1)
        d = self.direction + (bend * longest)[:, None]
        self.stretch, self.remainder = (1 + bend) * longest, remainder["field"]
        across = (remainder["mixed"] * d[:, [1, 2, 0]] * d[:, [2, 0, 1]]).sum(axis=1)
        second = (remainder["pure"] * d**2).sum(axis=1) + 2 * across
        self.curvature = (second + remainder["steep"] * curl * (1 + bend) * self.stretch**2) / 2
        self.steepest = 1.5 * gradient.sum(axis=1) + remainder["steep"]
        self.half_hessian = remainder["half_hessian"] + curl * self.steepest
        bulge = self.curvature / longest**2

        # values and derivatives: what is computed, and what the series adds
        places = misplaced[:, None] * to_places
        wrong = own + (gradient * places).sum(axis=1) + remainder["steep"] * places.max(axis=1)
        wrong *= outside_of(cases, beside) + cases.amplification
        self.noise = wrong + local + by_shift / growth + 1e-10 * bulge + misfit[:, 0] + smooth
        of_rounding = 2 * wrong * (4 * cases.half * d).sum(axis=1)
        self.derivative_error = of_rounding + (misfit[:, 1] + steepness * smooth) * d.sum(axis=1)

        size = cases.most[:, 3]
        columns, rows = np.transpose(pixels)
        fits = np.maximum(np.maximum(columns, rows) * misfit[:, 0], misfit[:, 1]) <= 1e-3 * size
        self.worth = np.where(fits[:, None], worth_of(remainder, size, cases.amplification * own + local), cases.half)
        self.effort = columns * rows * self.remainder / size * (1 + np.sqrt(bulge / size))
        own_deviation = deviations_of(cases, np.ones(COUNT))
        within = (own_deviation + remainder["map"] <= self.extent[:, None] - 1).all(axis=1)
        straight = (own_deviation.max(axis=1) <= 0.1) & (remainder["bends"].max(axis=1) <= 0.5) & within
        self.follows = (fits & straight).astype(float)


def shift_of(cases, growth, misplaced):
    """How far the series of the map may be from it, in steps of s: places, and sums of magnitudes."""
    levels = np.stack([2 * cases.across, 2 * cases.across, np.ones(COUNT)], axis=1)
    sums = growth[:, None] * SUMMED * (np.abs(cases.series[:, 0, :3]) + cases.most[:, :3])
    return np.einsum("nij,nj->ni", np.abs(cases.inverse), misplaced[:, None] * levels + sums)


def test_bounds_of_rays_match_those_of_numpy(follow):
    """In sub-elements from nearly straight ones to those that rays can't be followed through."""
    cases = SubElements(np.random.default_rng(2), np.geomspace(0.01, 3, COUNT)[:, None, None])
    cases.own[::3] *= 1e3
    *_, series, followed = follow(cases)
    growth = chebyshev.chebval(cases.c, [0, 0, 1]) ** 3
    expected = {
        "deviation": deviations_of(cases, np.ones(COUNT)),
        "around": deviations_of(cases, cases.c),
        "extent": extents_of(cases, cases.off),
        "worth": worth_of(remainder_of(cases, cases.c), cases.most[:, 3], cases.error),
        "shift": shift_of(cases, growth, cases.error),
    }
    check_equal(series, expected, expected)
    check_equal(followed, vars(Followed(cases)), FOLLOWED)
    # twice the remainder of a part of 0.3
    taylor = follow(cases, Looks(np.random.default_rng(20)))["taylor"]
    assert taylor == pytest.approx(2 * 0.3**2 * followed["half_hessian"], rel=1e-12)
    assert 6 < followed["follows"].sum() < 20


def test_points_of_straight_rays_are_within_the_extent(follow):
    """The sub-element itself, and what the map may be off around it."""
    found = follow(SubElements(np.random.default_rng(2), 1.0), Looks(np.random.default_rng(20)))
    assert found["within"].all()
    assert not found["beyond"].any()


def test_fields_along_rays_bend_by_no_more_than_is_stated(follow):
    """f'' = d H d - grad f . J^-1 (X_dd) with d = J^-1 e_z: at nodes and corners, on straight maps and bent ones."""
    places = np.array(list(product([-1, 0.3, 1], repeat=3)), float)
    for bent in (0.0, 0.05):
        cases = SubElements(np.random.default_rng(3), 1.0)
        cases.series[:, ORDER > 1, :3] *= bent
        cases.own = cases.misplaced = cases.spread = cases.perspective = np.zeros(COUNT)
        cases.grid_values = cases.grid_places = np.zeros((COUNT, 2))
        *_, found = follow(cases)
        # without errors, noise is the rounding of sums
        assert found["noise"] == pytest.approx(vars(Followed(cases))["noise"], rel=1e-9, abs=0)
        first, second = jets_of(cases.series, places)
        d = np.linalg.inv(first[..., :3].swapaxes(2, 3))[..., 2]
        along = np.einsum("npijc,npi,npj->npc", second, d, d)
        turned = np.einsum("npck,npk->npc", np.linalg.inv(first[..., :3].swapaxes(2, 3)), along[..., :3])
        curved = along[..., 3] - (first[..., 3] * turned).sum(axis=2)
        known = found["follows"] > 0
        assert known.sum() > 5
        part = (np.abs(curved).max(axis=1) / 2 / found["curvature"])[known]
        assert part.max() <= 1
        assert part.max() > (0.5 if bent == 0 else 0.3)
        assert (np.abs(d).max(axis=(1, 2)) <= found["stretch"])[known].all()
        assert (np.abs(first[..., 3]).sum(axis=2).max(axis=1) <= found["steepest"])[known].all()


def jets_of(series, places):
    """First (n, p, 3, 4) and second (n, p, 3, 3, 4) derivatives of series at places (p, 3)."""
    values = series.reshape(COUNT, 3, 3, 3, 4).transpose(3, 2, 1, 0, 4)
    x, y, z = places.T

    def derivative(*axes):
        own = values
        for axis in axes:
            own = chebyshev.chebder(own, axis=axis)
        return np.stack([chebyshev.chebval3d(x, y, z, own[..., k]) for k in range(4)]).transpose(1, 2, 0)

    first = np.stack([derivative(i) for i in range(3)], axis=2)
    second = np.stack([np.stack([derivative(i, j) for j in range(3)], axis=2) for i in range(3)], axis=2)
    return first, second


DROPPED, SPLIT, CLEAR, TINY, FLAT = -1, 0, 1, 2, 3
MATRIX = np.prod([chebyshev.chebvander(series(2)[0], 2)[POWERS[:, None, k], POWERS[:, k]] for k in range(3)], axis=0)


class Decided(SubElements):
    """Sub-elements in a picture of 59 x 50 pixels, and what is known of their quantity.

    zoom  pixels per unit; each pair of neighbours differs by a part of 0.99 or 1.01
    """

    def __init__(self, rng, bent, zoom):
        super().__init__(rng, np.reshape(bent, (-1, 1, 1)))
        zoom = np.broadcast_to(zoom, COUNT)
        self.series[..., :2] *= zoom[:, None, None]
        self.series[:, 0, :3] *= [1.0, 1.0, 0.0]
        self.inverse = np.linalg.inv(self.series[:, ORDER == 1, :3].swapaxes(1, 2))
        self.part, self.side = np.where(np.arange(COUNT) % 2 == 0, 0.99, 1.01), rng.choice([-1, 1], COUNT)
        self.middle, self.depth = rng.uniform(20, 30, (COUNT, 2)), np.full(COUNT, 40.0)
        self.radius, self.before = np.full(COUNT, 1e9), np.full(COUNT, 1e300)
        self.doubtful, self.last, self.whole, self.all_flat = np.zeros((4, COUNT))
        self.settle()

    def settle(self):
        """What follows from the series: sums of terms, and pixels between the ends of intervals."""
        self.most = np.abs(self.series).sum(axis=1) - np.abs(self.series[:, 0])
        self.value = self.series[:, 0, 3]
        self.amplification = LEBESGUE * outside_of(self, np.ones(COUNT))
        near, far = self.depth - self.most[:, 2], self.depth + self.most[:, 2]
        weights = np.where(self.perspective[:, None] > 0, np.stack([near, far], axis=1), 1.0)
        miss = self.series[:, 0, :2]
        ends = np.stack([miss - self.most[:, :2], miss + self.most[:, :2]])[:, :, None] / weights[..., None]
        ends = self.middle[:, None] + ends
        first = np.maximum(np.ceil(ends.min(axis=(0, 2)) - 1e-6), PICTURE[0])
        last = np.minimum(np.floor(ends.max(axis=(0, 2)) + 1e-6), PICTURE[1])
        assert (first <= last + 1).all()
        self.aside = np.maximum(np.abs(first - self.middle), np.abs(last - self.middle))
        self.pixels = last - first + 1
        self.is_seen = (self.pixels > 0).all(axis=1)
        spread = (np.abs(miss) + self.most[:, :2]) / weights[:, :1] + 1e-6
        self.weight, self.extents = weights[:, 0], spread.max(axis=1)
        self.size = np.maximum(self.extents, 0.1 * self.across * self.most[:, 2] / self.weight)
        self.misfit = misfit_of(self.spread, np.ones(COUNT))
        self.greatest = self.most[:, 3] + np.abs(self.value)
        own = np.maximum(self.own, self.grid_values[:, 1])
        self.room = self.amplification * own + self.grid_values[:, 0] + SUMMED * self.greatest

    def rows(self):
        alone = [self.own, self.value, self.across, self.misplaced, self.perspective]
        known = [self.spread, self.radius, self.doubtful, self.last, self.whole, self.before]
        nodes = np.einsum("pt,ntk->npk", MATRIX, self.series)
        lists = [self.centre, self.half, np.stack(alone, axis=1), self.grid_values, self.grid_places]
        placed = [self.middle, self.depth[:, None], self.all_flat[:, None], nodes.reshape(COUNT, -1)]
        return np.concatenate([*lists, np.stack(known, axis=1), *placed], axis=1)

    def outcome(self):
        """Outcomes (n,), and the cost of following rays."""
        with np.errstate(invalid="ignore"):
            followed = Followed(self, self.pixels)
        hopeless = ~(self.misfit[:, 1] <= 2e-3 * self.radius)
        is_flat = ~hopeless & (self.greatest <= 4 * self.room)
        bounded = (followed.follows > 0) & ~hopeless & (self.doubtful == 0)
        effort = np.where(bounded, followed.effort, 1e300)
        gains_little = (3 * effort > np.where(self.whole > 0, 1e300, self.before)) & (effort <= 4000)
        is_still_flat = is_flat | (self.all_flat > 0)
        coarse = is_still_flat | (self.doubtful > 0) | ~(self.misfit[:, 0] < 1e300)
        is_small = (self.size < np.where(coarse, 0.5, 1e-3)) | (self.last > 0)
        found = np.where(is_small, TINY, SPLIT)
        found = np.where(bounded & ((effort <= 400) | gains_little), CLEAR, found)
        found = np.where(bounded & is_still_flat, FLAT, found)
        found = np.where(self.is_seen, found, DROPPED)
        dropped = ~hopeless & (np.abs(self.value) > self.most[:, 3] + self.room + self.misfit[:, 0])
        self.is_all_flat = ~dropped & (self.whole > 0) & is_flat
        return np.where(dropped, DROPPED, found), effort


def at_levels(cases):
    """Values at the middle that exceed all terms, errors and misfits just so."""
    room = cases.room + cases.misfit[:, 0]
    cases.series[:, 0, 3] = cases.side * (cases.most[:, 3] + cases.part * room)


def nearly_flat(cases):
    """Values as large as four errors, in whole elements or parts of them."""
    cases.whole[::3] = 1
    cases.series[:, 0, 3] *= 0.01
    cases.settle()
    cases.own = (cases.greatest * cases.part / 4 - cases.grid_values[:, 0]) / cases.amplification


def doubtful(cases):
    cases.doubtful[::2] = 1


def hopeless(cases):
    cases.radius = (
        np.where(np.arange(COUNT) % 4 < 2, 1 / cases.part, 1.0) * misfit_of(cases.spread, np.ones(COUNT))[:, 1] / 2e-3
    )


def last(cases):
    cases.last[::2] = 1


def costly(cases):
    """Just more or less than a third of what the sub-element before cost."""
    cases.series[:, ORDER > 1, 3] *= np.geomspace(1, 50, COUNT)[:, None]
    cases.spread[:] = cases.perspective[:] = 0.0
    cases.settle()
    cases.before = 3 * cases.outcome()[1] * cases.part
    cases.whole[::5] = 1


def unbounded(cases):
    cases.spread[:] = np.inf


def small(cases, limit=1e-3):
    """Just as small as parts that aren't divided any more, across rays or along them."""
    cases.series[:, 0, :2], cases.middle = 0.0, np.round(cases.middle)
    cases.settle()
    is_across, limits = np.arange(COUNT) % 4 < 2, limit * cases.part
    cases.across = np.where(is_across, 1e-9, 10 * limits * cases.weight / cases.most[:, 2])
    zoom = np.where(is_across, (limits - 1e-6) / (cases.extents - 1e-6), 1e-6)
    cases.series[..., :2] *= zoom[:, None, None]
    cases.inverse = np.linalg.inv(cases.series[:, ORDER == 1, :3].swapaxes(1, 2))


def small_and_doubtful(cases):
    cases.doubtful[:] = 1
    small(cases, 0.5)


def flat_before(cases):
    cases.all_flat[::2] = 1


@pytest.fixture(scope="module")
def decide(functions):
    exports = "export static const bool analytic = true; export static const bool deciding = true;"
    kernel = functions("iso_follow", exports)
    given = {"axes": np.array(AXES), "box_sizes": np.array(BOXES), "tails": tails(2), "transform": series(2)[1]}
    return lambda cases: kernel(cases.rows(), 3, **given)


@pytest.mark.parametrize(
    ("change", "bent", "zoom"),
    [
        (at_levels, 0.3, 1.0),
        (nearly_flat, 0.1, 1.0),
        (doubtful, 0.1, 1.0),
        (hopeless, 0.1, 1.0),
        (last, 2.0, 1.0),
        (costly, 0.05, np.tile([2.0, 3.0, 6.0, 10.0], COUNT // 4)),
        (unbounded, 0.1, 0.05),
        (flat_before, 0.1, 1.0),
        (small, 2.0, 1.0),
        (small_and_doubtful, 0.1, 1.0),
    ],
)
def test_outcomes_follow_from_bounds_and_costs(decide, change, bent, zoom):
    cases = Decided(np.random.default_rng(22), np.broadcast_to(bent, COUNT), zoom)
    change(cases)
    cases.settle()
    found = decide(cases)
    outcome, effort = cases.outcome()
    assert np.array_equal(found[:, 0], outcome)
    is_known = outcome != DROPPED
    assert found[is_known, 1] == pytest.approx(effort[is_known], rel=1e-6)
    assert np.array_equal(found[:, 2], np.where(cases.is_all_flat, 1, cases.all_flat))
    assert len(set(outcome)) > 1
