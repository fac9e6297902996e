"""Contour lines in the squares of pixels: strokes along conic sections, and marks on the pixels around them."""

import numpy as np
import pytest

COUNT, SIDE = 140, 44
LEVELS = np.array([-0.6, -0.2, 0.0, 0.25, 0.7])
#: world length of a pixel, half the width of lines in pixels, and depth of the plane
LENGTH, HALF_WIDTH, DEPTH = 0.5, 0.8, 5.0
FACETS = np.array([[1.0, 0, 0, 1], [0, 1.0, 0, 1], [0, 0, 1.0, 1], [-1.0, -1.0, -1.0, -1.0]])
#: of each case the pixel whose square it is: marks of different cases lie apart
PIXELS = 3 * np.stack([np.arange(COUNT) % 14, np.arange(COUNT) // 14], axis=1) + 1
NAMES = PIXELS @ [1, SIDE]
#: of marks: units of a pixel, and the bits of a level's number
UNITS, NUMBERS = 67108864.0, 1 << 10
UNMARKED = 0xFFFFFFFF
STRAIGHT, MILD, CURVED, EXTREMUM, VALLEY, BORDER, THIN = range(7)


class Squares:
    """Quadratic functions of the place in a pixel (n), in tetrahedra that contain its square, or a part of it."""

    def __init__(self, rng):
        self.kind = np.arange(COUNT) % 7
        turn, size = rng.uniform(0, 2 * np.pi, COUNT), rng.uniform(0.3, 0.9, COUNT)
        self.slope = np.stack([size * np.cos(turn), size * np.sin(turn)], axis=1)
        self.form = np.zeros((COUNT, 2, 2))
        self.constant = rng.uniform(-0.5, 0.5, COUNT)
        self.bounds = np.tile([-3.0, 3.0], (COUNT, 1))
        self.bounds[::5] = [-0.3, 0.3]
        for k, kind in enumerate(self.kind):
            self._choose(k, kind, rng)
        self.linear = 10 * (np.eye(3) + rng.uniform(-0.3, 0.3, (COUNT, 3, 3)))
        self.linear[self.kind == THIN] *= np.array([0.012, 0.1, 0.1])
        # the pixel's centre in the element
        self.place = np.tile([-0.45, -0.5, -0.55], (COUNT, 1))
        self.place[self.kind == BORDER] = [-0.99, -0.5, -0.4]
        self.whole = np.where(self.kind == THIN, 2, np.where(np.arange(COUNT) % 3, 0, 1))
        self.whole[self.kind == BORDER] = 0
        self.base = PIXELS + rng.integers(-1, 2, (COUNT, 2))

    def _choose(self, k, kind, rng):
        turn = rng.uniform(0, 2 * np.pi) * (k % 2)
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        if kind in (MILD, CURVED, BORDER, THIN):
            size = {MILD: 0.03, BORDER: 0.03, CURVED: 0.4, THIN: 0.1}[kind]
            self.form[k] = size * axes.T @ np.diag(rng.uniform(-1, 1, 2)) @ axes
        level, sign = rng.choice(LEVELS), rng.choice([-1, 1])
        if kind in (STRAIGHT, MILD):
            # the level is in the square, or in three times its range, or just not
            self.slope[k] *= 0.3
            away = rng.uniform(0, 0.4) if k % 3 else rng.uniform(1.2, 1.8)
            self.constant[k] = level + sign * away * np.abs(self.slope[k]).sum()
        if kind == EXTREMUM:
            self.form[k] = sign * axes.T @ np.diag(rng.uniform(1, 3, 2)) @ axes
            middle = rng.uniform(-0.48, 0.48, 2)
            if k % 3 == 0:
                # beyond the square, whose values end before the level
                middle[k % 2] = rng.choice([-0.7, 0.7])
            self.slope[k] = -2 * self.form[k] @ middle
            self.constant[k] = (
                level - sign * (rng.choice([1e-3, 1e-3, 0.1, 0.2]) if k % 3 else 0.02) + middle @ self.form[k] @ middle
            )
        if kind == VALLEY:
            away = rng.uniform(-0.3, 0.3)
            self.form[k] = sign * 4 * np.outer(axes[0], axes[0])
            self.slope[k] = -2 * sign * 4 * away * axes[0] + 0.02 * axes[1]
            self.constant[k] = level - sign * rng.choice([0.01, 0.03, 0.1]) + sign * 4 * away**2

    def at(self, k, places):
        """Values at places (m, 2) relative to the pixel."""
        return places @ self.slope[k] + np.einsum("mi,ij,mj->m", places, self.form[k], places) + self.constant[k]

    def references(self, k, places):
        """Reference coordinates (m, 3) of places in the plane, relative to the pixel."""
        moved = np.column_stack([LENGTH * places * [1, -1], np.zeros(len(places))])
        return self.place[k] + np.linalg.solve(self.linear[k], moved.T).T

    def margins(self, k, places):
        return (self.references(k, places) @ FACETS[:, :3].T + FACETS[:, 3]).min(axis=1)

    def polynomials(self):
        """Coefficients of powers for positions and values."""
        found = np.zeros((COUNT, 5, 27))
        ones = [1, 3, 9]
        for k in range(COUNT):
            found[k, :3, ones] = self.linear[k].T
            centre = np.append(LENGTH * PIXELS[k] * [1, -1], 0.0)
            found[k, :3, 0] = centre - self.linear[k] @ self.place[k]
            to_places = np.array([[1, 0, 0], [0, -1, 0]]) / LENGTH @ self.linear[k]
            slope, form = to_places.T @ self.slope[k], to_places.T @ self.form[k] @ to_places
            found[k, 3, 0] = self.constant[k] - slope @ self.place[k] + self.place[k] @ form @ self.place[k]
            found[k, 3, ones] = slope - 2 * form @ self.place[k]
            for i in range(3):
                for j in range(3):
                    found[k, 3, ones[i] + ones[j]] += form[i, j]
        return found

    def contour(self, k, level):
        """Places (m, 2) in the pixel's square at which lines of a fine lattice cross a level."""
        lattice = np.linspace(-0.5, 0.5, 41)
        found = []
        for axis in range(2):
            other = 1 - axis
            square = self.form[k][axis, axis]
            rate = self.slope[k][axis] + 2 * self.form[k][0, 1] * lattice
            rest = self.form[k][other, other] * lattice**2 + self.slope[k][other] * lattice + self.constant[k] - level
            part = np.sqrt(np.maximum(rate**2 - 4 * square * rest, 0.0)) if square else np.zeros_like(rate)
            for sign in (1, -1):
                with np.errstate(divide="ignore", invalid="ignore"):
                    root = (sign * part - rate) / (2 * square) if square else -rest / rate
                places = np.stack([root, lattice] if axis == 0 else [lattice, root], axis=1)
                found.append(places[(np.abs(root) <= 0.5) & (rate**2 >= 4 * square * rest)])
        return np.concatenate(found)


@pytest.fixture(scope="module")
def squares():
    return Squares(np.random.default_rng(51))


@pytest.fixture(scope="module")
def run(functions, squares):
    """Arrays of the kernel after it has drawn all squares."""
    kernel = functions("line_draw")

    def run(names, flat=1, **settings):
        view, items = kernel.records("view", 1), kernel.records("items", COUNT)
        camera = view["camera"]
        camera["eye"], camera["forward"] = [0.0, 0.0, DEPTH], [0.0, 0.0, -1.0]
        camera["column"], camera["row"] = [LENGTH, 0.0, 0.0], [0.0, -LENGTH, 0.0]
        camera["width"] = camera["height"] = SIDE
        settings = {"facets": 4, "levels": len(LEVELS), "packed": 1, "smooth": 1, "flat": flat, **settings}
        for name, value in {"half_width": HALF_WIDTH, "count": COUNT, **settings}.items():
            view[name] = value
        items["pixel"], items["base"] = NAMES, squares.base @ [1, SIDE]
        items["whole"], items["element"] = squares.whole, np.arange(COUNT)
        references = np.concatenate([squares.references(k, squares.base[k : k + 1] - PIXELS[k]) for k in range(COUNT)])
        normal = np.array([0.0, 0.0, 1.0])
        given = {
            "references": references,
            "hit_normal": normal if flat else np.repeat(normal, SIDE**2),
            "facets": FACETS,
            "bounds": squares.bounds.astype(np.float32),
            "levels": LEVELS,
            "polynomials": squares.polynomials(),
            "strokes": kernel.records("strokes", 200 * COUNT),
            "count": np.zeros(1, np.uint32),
            "told": np.full(COUNT, 9, np.uint32),
            "marks": np.full(SIDE**2, UNMARKED, np.uint32),
            "hit_depth": depths(),
        }
        return kernel.results(COUNT, names, view=view, items=items, **given)

    return run


def depths():
    """Of pixels, some as far in front of the plane as lines may be on the same surface, or just farther."""
    slack = (1 + HALF_WIDTH) * LENGTH
    return DEPTH + np.resize([0.0, 0.99 * slack, -1.01 * slack, 0.0, 1.01 * slack], SIDE**2)


@pytest.fixture(scope="module")
def strokes(run):
    """Strokes of all squares."""
    found = run(["strokes", "count"], traced=1)
    return found["strokes"][: found["count"][0]]


def cases(strokes):
    """Each case with the ends of its strokes (m, 2), relative to its pixel, and their levels (m,)."""
    for k in range(COUNT):
        own = strokes[strokes["pixel"] == NAMES[k]]
        yield k, own["from"] - PIXELS[k], own["to"] - PIXELS[k], own["number"]


def distances(points, starts, ends):
    """Distances (m, n) of points from straight lines."""
    along = ends - starts
    away = points[:, None] - starts
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    part = np.clip((away * along).sum(axis=2) / square, 0, 1)
    return np.linalg.norm(away - part[..., None] * along, axis=2)


def test_strokes_lie_in_the_plane_of_their_square(strokes):
    assert 3 * COUNT < len(strokes) < 200 * COUNT
    assert strokes["depth"] == pytest.approx(DEPTH)
    assert strokes["slack"] == pytest.approx((1 + HALF_WIDTH) * LENGTH)
    assert np.isin(strokes["pixel"], NAMES).all()


def test_strokes_end_on_their_contours_in_the_square_and_the_element(squares, strokes):
    for k, starts, ends, number in cases(strokes):
        places, levels = np.concatenate([starts, ends]), LEVELS[np.tile(number, 2)]
        off = np.abs(squares.at(k, places) - levels)
        steep = np.linalg.norm(squares.slope[k] + 2 * places @ squares.form[k], axis=1)
        # values between corners are linear or quadratic: exact for these but at extrema and where lines end at borders
        size = np.abs(squares.form[k]).max()
        assert (off <= 0.02 * steep + 0.03 * size + 1e-9).all(), k
        inner = 0.5 if squares.kind[k] != THIN else 0.75
        assert np.abs(places).max(initial=0) <= inner + 1e-9
        if squares.whole[k] != 1:
            assert squares.margins(k, places).min(initial=0) >= -1e-9
        assert ((levels >= squares.bounds[k, 0] - 1e-6) & (levels <= squares.bounds[k, 1] + 1e-6)).all()


def test_all_of_each_contour_is_drawn(squares, strokes):
    seen = np.zeros(7, int)
    for k, starts, ends, number in cases(strokes):
        for level in range(len(LEVELS)):
            places = squares.contour(k, LEVELS[level])
            if squares.whole[k] != 1 and len(places):
                places = places[squares.margins(k, places) > 0]
            own = number == level
            is_within = squares.bounds[k, 0] <= LEVELS[level] <= squares.bounds[k, 1]
            if not is_within or not len(places):
                continue
            assert own.any(), (k, level)
            off = distances(places, starts[own], ends[own]).min(axis=1)
            # loops smaller than a cell are points, and what only touches the square may be left out
            assert off.max() < (0.09 if squares.kind[k] in (EXTREMUM, VALLEY) else 0.05), (k, level)
            assert np.median(off) < (0.05 if squares.kind[k] == EXTREMUM else 0.02)
            seen[squares.kind[k]] += 1
    assert seen.min() > 5


def test_loops_between_the_corners_of_cells_are_points_at_extrema(squares, strokes):
    """Exactly, if the axes of the parabolas are those of the cells."""
    corners = np.array([[x, y] for y in range(9) for x in range(9)]) / 8 - 0.5
    seen = 0
    for k, starts, ends, number in cases(strokes):
        middle = np.linalg.solve(squares.form[k], -0.5 * squares.slope[k]) if squares.kind[k] == EXTREMUM else 1.0
        if k % 2 or np.abs(middle).max() > 0.49:
            continue
        top, sign = squares.at(k, middle[None])[0], np.sign(squares.form[k][0, 0])
        nearest = (sign * squares.at(k, corners)).min()
        is_within = (squares.bounds[k, 0] <= LEVELS) & (squares.bounds[k, 1] >= LEVELS)
        for level in np.flatnonzero(is_within & (sign * LEVELS > sign * top) & (sign * LEVELS < nearest)):
            is_point = (starts == ends).all(axis=1) & (number == level)
            assert np.abs(starts[is_point] - middle).max(axis=1).min() < 1e-9
            seen += 1
    assert seen > 2


def test_nearly_linear_values_have_few_strokes(squares, strokes):
    """As many as triangles of 1, 2 x 2 or 4 x 4 cells that a line crosses."""
    seen = dict.fromkeys([2, 6, 14], 0)
    for k, _, _, number in cases(strokes):
        bend = unevenness(squares, k)
        most = 2 if bend <= 0.0125 else 6 if bend <= 0.05 else 14
        if squares.kind[k] in (STRAIGHT, MILD, CURVED) and bend <= 0.1:
            assert np.bincount(number).max(initial=0) <= most, k
            seen[most] += 1
    assert min(seen.values()) > 2


@pytest.mark.parametrize("flat", [1, 0])
def test_marks_have_the_nearest_line_on_the_same_surface(run, strokes, flat):
    marks = run(["marks"], flat=flat)["marks"]
    places = np.array([[x, y] for y in range(SIDE) for x in range(SIDE)])
    slack = (1 + HALF_WIDTH) * LENGTH
    expected = np.full(len(places), UNMARKED, np.int64)
    for row in np.arange(len(places)).reshape(SIDE, SIDE):
        away = distances(places[row], strokes["from"], strokes["to"])
        near = (away < HALF_WIDTH) & (flat or (np.abs(depths()[row] - DEPTH) <= slack)[:, None])
        named = ((UNITS * away).astype(np.int64) & ~(NUMBERS - 1)) + strokes["number"]
        expected[row] = np.where(near, named, UNMARKED).min(axis=1)
    assert np.array_equal(marks == UNMARKED, expected == UNMARKED)
    assert np.abs(marks.astype(np.int64) - expected).max() <= NUMBERS * 2
    assert (marks % NUMBERS == expected % NUMBERS).mean() > 0.99
    assert 0.1 < (marks != UNMARKED).mean() < 0.9


def test_squares_with_many_cells_and_squares_with_lines_are_told(run, squares, strokes):
    many = run(["told", "strokes", "count"], traced=1, telling=1)
    bent = many["told"] > 0
    left = many["strokes"][: many["count"][0]]
    assert np.array_equal(np.sort(left["from"], axis=0), np.sort(strokes["from"][~bent_of(strokes, bent)], axis=0))
    plain = squares.kind != THIN
    expected = np.array([is_bent(squares, k) for k in range(COUNT)])
    assert np.array_equal(bent[plain], expected[plain])
    assert 10 < bent.sum() < COUNT - 10

    possible = run(["told", "count"], traced=1, telling=2)
    assert possible["count"][0] == 0
    has_lines = np.isin(NAMES, strokes["pixel"])
    assert (possible["told"][has_lines] == 1).all()
    assert np.isin(possible["told"], [0, 1]).all()
    expected = [may_have_any(squares, k) for k in range(COUNT)]
    assert np.array_equal(possible["told"][plain], np.array(expected)[plain])


def bent_of(strokes, bent):
    """Of each stroke, whether its square is among these."""
    return np.isin(strokes["pixel"], NAMES[bent])


NODES = np.array([[x, y] for y in (-0.5, 0, 0.5) for x in (-0.5, 0, 0.5)])


def has_levels(squares, k, share):
    """Whether levels lie in the range of values at nine nodes, extended by a share of it to both sides."""
    values = squares.at(k, NODES)
    room = share * np.ptp(values)
    low, high = max(values.min() - room, squares.bounds[k, 0]), min(values.max() + room, squares.bounds[k, 1])
    return ((low <= LEVELS) & (high >= LEVELS)).any()


def may_have_any(squares, k):
    return has_levels(squares, k, 1.0)


def is_bent(squares, k):
    return has_levels(squares, k, 0.25) and unevenness(squares, k) > 0.1


def unevenness(squares, k):
    """By how much values half a pixel apart deviate from linearity, relative to their gradient."""
    v = squares.at(k, NODES).reshape(3, 3)
    bends = [np.abs(np.diff(v, 2, axis=axis)).max() for axis in range(2)]
    twist = abs(v[2, 2] + v[0, 0] - v[0, 2] - v[2, 0])
    return max(*bends, twist) / max(abs(v[1, 2] - v[1, 0]), abs(v[2, 1] - v[0, 1]))
