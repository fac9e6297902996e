"""Stages of plane cuts, each on its own: sections, guesses, pixels and second searches, against NumPy."""

from itertools import combinations
from math import factorial

import numpy as np
import pytest
from kernel_functions import rows_of

COUNT = 16
NOBODY = 0xFFFFFFFF
OUTSIDE, INSIDE, UNKNOWN = 0, 1, 2
#: number of the part's first element, first column and row of the window, and pixels of its sides
FIRST, WINDOW, SIDE = 100, np.array([10, 20]), 256
CENTRE = np.full(3, -0.5)
BORDER = 1e-10


class Elements:
    """Curved tetrahedra, each around its own pixel of a plane; the last ones are large, the first two are mirrored."""

    def __init__(self, rng):
        self.size = np.where(np.arange(COUNT) < 12, 0.8, 2.5)
        curved = self.size * np.resize([0.02, 0.1, 0.3], COUNT)
        self.polynomials = (
            rng.uniform(-1, 1, (COUNT, 5, 27)) * np.where(np.arange(5) < 3, curved[:, None] / 4, 1)[..., None]
        )
        linear = self.size[:, None, None] * (np.eye(3) + rng.uniform(-0.2, 0.2, (COUNT, 3, 3)))
        linear[:2, :, 0] *= -1
        self.polynomials[:, :3, [1, 3, 9]] = linear
        self.origin, self.column, self.row = np.array([[-3.0, 1.0, 0.5], [0.1, 0.0, 0.02], [0.01, 0.1, -0.03]])
        self.weight = np.array([1.0, 2e-4, -1e-4])
        self.pixel = WINDOW + np.stack([np.arange(COUNT) % 4, np.arange(COUNT) // 4], axis=1) * 64 + 32
        self.polynomials[:, :3, 0] = 0.0
        ids = np.arange(COUNT)
        shift = self.point(*self.pixel.T) - self.at(ids, np.tile(CENTRE, (COUNT, 1)))[0][:, :3]
        self.polynomials[:, :3, 0] = shift
        half = np.where(self.size < 1, 8, 24)[:, None] + np.array([0, 1])
        self.least, self.most = self.pixel - half, self.pixel + half + [1, 0]
        # a section that lies far from its element
        self.least[4] += 90
        self.most[4] += 90

    def point(self, i, j):
        """Points (n, 3) of the plane that pixels see."""
        i, j = np.asarray(i, float)[..., None], np.asarray(j, float)[..., None]
        return (self.origin + i * self.column + j * self.row) / (
            self.weight[0] + i * self.weight[1] + j * self.weight[2]
        )

    def at(self, elements, r):
        """Positions and fields (n, 5) and their derivatives (n, 5, 3)."""
        powers = np.stack([np.ones_like(r), r, r**2], axis=-1)
        slopes = np.stack([0 * r, np.ones_like(r), 2 * r], axis=-1)

        def sums(x, y, z):
            terms = np.einsum("na,nb,nc->ncba", x, y, z).reshape(len(r), 27)
            return np.einsum("nfk,nk->nf", self.polynomials[elements], terms)

        axes = [[slopes if k == axis else powers for k in range(3)] for axis in (None, 0, 1, 2)]
        jets = [sums(*(own[:, k] for k, own in enumerate(kinds))) for kinds in axes]
        return jets[0], np.stack(jets[1:], axis=-1)

    def step(self, element, r, target):
        """Newton's step."""
        values, slopes = self.at([element], r[None])
        return np.linalg.solve(slopes[0, :3], target - values[0, :3])

    def inverse(self, elements, targets, start):
        """Reference coordinates (n, 3), by damped Newton steps; NaN where these don't end."""
        r = start.copy()
        for _ in range(60):
            values, slopes = self.at(elements, r)
            step = np.linalg.solve(slopes[:, :3], (targets - values[:, :3])[..., None])[..., 0]
            size = np.abs(step).max(axis=1, keepdims=True)
            r += step * np.minimum(1.0, 0.5 / np.maximum(size, 1e-300))
        return np.where(size < 1e-13, r, np.nan)


def margin_of(r):
    return np.minimum((1 + r).min(axis=-1), -1 - r.sum(axis=-1))


@pytest.fixture(scope="module")
def elements():
    return Elements(np.random.default_rng(41))


def view_of(kernel, elements, count):
    view = kernel.records("view", 1)
    for name in ("origin", "column", "row", "weight"):
        view[name] = getattr(elements, name)
    camera = view["camera"]
    camera["left"], camera["top"], camera["width"], camera["height"] = *WINDOW, SIDE, SIDE
    camera["picture"] = [*WINDOW, *(WINDOW + SIDE - 1)]
    camera["to_weight"] = [0.0, 0.0, 0.0, 1.0]
    view["first"], view["count"], view["references"] = FIRST, count, 1
    return view


def node_of(i, n):
    """Chebyshev points of the second kind, by the sine's series up to its ninth power; or thirds of a parabola."""
    if n == 3:
        return i - 1
    angle = np.pi * (i / (n - 1) - 0.5)
    found = sum((-1) ** k * angle ** (2 * k + 1) / factorial(2 * k + 1) for k in range(5))
    assert found == pytest.approx(np.sin(angle), abs=4e-6)
    return found


def solved(elements, element, target, r, bend, limits):
    """Newton's method for a node, and its last step; as the kernel does, which stops where steps are short enough."""
    enough, is_first, takes_last = limits
    before = 1.0
    for _ in range(8):
        step = elements.step(element, r, target)
        length = np.abs(step).max()
        if before < 0.1:
            bend = max(bend, length / before**2)
        before = length
        if length < enough and not takes_last:
            break
        r = np.clip(r + step, -2, 2) if is_first else r + step
        if length < enough:
            break
    return r, length, bend


def aimed(elements, element, most_nodes):
    """Middle, spacing, nodes and largest negligible step of the guess; None instead of nodes where these are lost."""
    least, most = elements.least[element], elements.most[element]
    middle, size = 0.5 * (least + most), most - least
    n = 3 if size.prod() < 2000 else most_nodes
    spacing = (0.4 if n > 3 else 0.3) * size + 0.1
    own, bend = np.zeros((n * n, 3)), 1.0
    steps = None
    for k in range(n * n):
        node = (k + n * n // 2) % (n * n)
        offset = np.array([node_of(node % n, n), node_of(node // n, n)]) * spacing
        target = elements.point(*(middle + offset))
        predicted = CENTRE if k == 0 else own[n * n // 2] + offset @ steps
        limits = (1e-6, True, True) if k == 0 else (1e-5 if n > 3 else 1e-3, False, n > 3)
        r, length, bend = solved(elements, element, target, predicted, bend, limits)
        tame = length < 0.1 and np.abs(r).max() < 3
        if k == 0:
            if not tame or np.abs(r).max() >= 2:
                return middle, spacing, n, None, 1e-8
            slopes = elements.at([element], r[None])[1][0, :3]
            moved = np.array([elements.point(*(middle + step)) - target for step in ([1, 0], [0, 1])])
            steps = np.linalg.solve(slopes, moved.T).T
        own[node] = r if tame else predicted
    return middle, spacing, n, own, np.clip(np.sqrt(1e-14 / bend), 1e-8, 1e-7)


@pytest.fixture(scope="module", params=[3, 5], ids="nodes={}".format)
def aim(request, functions, elements):
    """Guesses and their numbers, on a device."""
    nodes = request.param
    kernel = functions("cut_aim", f"export static const int guess_nodes = {nodes};")
    sections, guesses = kernel.records("sections", COUNT), kernel.records("guesses", COUNT)
    sections["element"] = np.arange(COUNT)
    sections["least"][:, :2], sections["most"][:, :2] = elements.least, elements.most
    memory = {"guesses": guesses, "guess_values": np.zeros(3 * COUNT * nodes**2)}
    given = {"view": view_of(kernel, elements, COUNT), "sections": sections, "polynomials": elements.polynomials}
    found = kernel.results(COUNT, list(memory), **given, **memory)
    return nodes, found["guesses"], found["guess_values"].reshape(COUNT, nodes**2, 3)


def test_guesses_go_through_solved_nodes(aim, elements):
    nodes, guesses, values = aim
    straight, near = [], []
    for k in range(COUNT):
        middle, spacing, n, own, limit = aimed(elements, k, nodes)
        assert (guesses["element"][k], guesses["n"][k], guesses["first"][k]) == (k, n, k * nodes**2)
        assert guesses["middle"][k] == pytest.approx(middle)
        assert guesses["spacing"][k] == pytest.approx(spacing)
        assert guesses["near"][k] == pytest.approx(limit, rel=1e-3, abs=0)
        assert guesses["straight"][k] == (own is None)
        straight.append(own is None)
        near.append(limit)
        if own is None:
            centre, slopes = elements.at([k], CENTRE[None])
            inverse = np.linalg.inv(slopes[0, :3])
            assert values[k, 0] == pytest.approx(CENTRE - inverse @ centre[0, :3], rel=1e-10, abs=0)
            assert values[k, 1:4] == pytest.approx(inverse.T, rel=1e-10, abs=0)
        else:
            assert values[k, : n * n] == pytest.approx(own, abs=1e-9)
    assert 0 < sum(straight) < COUNT / 2
    assert len(set(near)) > 2


@pytest.mark.parametrize("nodes", [3, 5])
def test_guesses_of_pixels_interpolate_nodes_or_are_linear(functions, nodes):
    kernel, count = functions("cut_guess", f"export static const int guess_nodes = {nodes};"), 64
    rng = np.random.default_rng(44)
    middle, spacing = rng.uniform(-50, 50, (count, 2)), rng.uniform(5, 20, (count, 2))
    values, away = rng.uniform(-1, 1, (count, nodes**2, 3)), rng.uniform(-1.5, 1.5, (count, 2))
    # maps of low degree have few nodes in either case
    n = np.where(np.arange(count) % 2, 3, nodes)
    straight, position = rng.integers(2, size=count), rng.uniform(-2, 2, (count, 3))
    columns = [middle, spacing, n, straight, middle + away * spacing, position]
    found = kernel(rows_of(count, columns), 3, guess_values=values)
    for k in range(count):
        if straight[k]:
            expected = values[k, 0] + position[k] @ values[k, 1:4]
        elif nodes == 5 and n[k] == 3:
            expected = interpolated(values[k, :9].reshape(3, 3, 3), away[k], 3)
        else:
            expected = interpolated(values[k].reshape(nodes, nodes, 3), away[k], nodes)
        assert found[k] == pytest.approx(expected, abs=1e-11)


def interpolated(values, place, n):
    """The polynomial through rows of nodes, at (x, y)."""
    nodes = np.array([node_of(i, n) for i in range(n)])
    weights = [np.linalg.solve(np.vander(nodes).T, np.vander([own], n)[0]) for own in place]
    return np.einsum("j,i,jic->c", weights[1], weights[0], values)


def pixels_around(elements):
    """Tiles (n, 2) of the small elements that are not folded, by their first pixels, and elements (n,)."""
    small = np.flatnonzero((elements.size < 1) & (np.arange(COUNT) % 3 < 2))
    places = np.array([[x, y] for y in (-16, -8, 0, 8) for x in (-16, -8, 0, 8)])
    return np.concatenate(elements.pixel[small, None] + places), np.repeat(small, len(places))


def test_pixels_have_the_points_of_elements_that_they_see(functions, aim, elements):
    nodes, guesses, values = aim
    kernel = functions("cut_draw", f"export static const int guess_nodes = {nodes};")
    corners, own = pixels_around(elements)
    tiles, candidates = kernel.records("tiles", len(own)), kernel.records("candidates", 64 * len(own))
    tiles["x"], tiles["y"], tiles["first"] = *corners.T, own
    inner = np.array([[x, y] for y in range(8) for x in range(8)])
    pixels, element = np.concatenate(corners[:, None] + inner), np.repeat(own, 64)
    number = (pixels - WINDOW) @ [1, SIDE]
    owner = np.full(SIDE**2, NOBODY, np.uint32)
    # some pixels belong to other elements, some already to this one
    owner[number[::7]], owner[number[1::7]] = 7, FIRST + element[1::7]
    memory = {"hit_owner": owner, "hit_field": np.full(SIDE**2, np.nan), "hit_reference": np.full(3 * SIDE**2, np.nan)}
    memory |= {"candidates": candidates, "count": np.zeros(1, np.uint32)}
    given = {"view": view_of(kernel, elements, len(own)), "tiles": tiles, "guesses": guesses, "guess_values": values}
    given |= {"polynomials": elements.polynomials, "hit_pixels": np.array([SIDE**2], np.uint32)}
    found = kernel.results(len(own), list(memory), groups=True, **given, **memory)

    r = elements.inverse(element, elements.point(*pixels.T), np.tile(CENTRE, (len(pixels), 1)))
    # far from elements there may be no point at all
    r[np.isnan(r)] = 3.0
    margin, field = margin_of(r), elements.at(element, r)[0][:, 3]
    inside = margin > BORDER
    assert 0.05 < inside.mean() < 0.6
    upright = np.linalg.det(elements.at(element, r)[1][:, :3]) > 0
    is_free = np.isin(owner[number], [NOBODY, 0]) | (owner[number] == FIRST + element)
    clear = inside & upright & is_free
    assert np.array_equal(found["hit_owner"][number], np.where(clear, FIRST + element, owner[number]))
    assert found["hit_field"][number[clear]] == pytest.approx(field[clear], abs=1e-12)
    reference = found["hit_reference"].reshape(3, -1).T
    assert np.abs(reference[number[clear]] - r[clear]).max() < 1e-12
    assert np.isnan(found["hit_field"][number[~clear]]).all()

    listed = found["candidates"][: found["count"][0]]
    listed = listed[np.argsort(listed["pixel"])]
    doubtful = np.flatnonzero(inside & ~clear)
    doubtful = doubtful[np.argsort(number[doubtful])]
    known = listed["status"] == INSIDE
    assert np.array_equal(listed["pixel"][known], number[doubtful])
    assert np.array_equal(listed["element"][known], element[doubtful])
    assert listed["field"][known] == pytest.approx(field[doubtful], abs=1e-12)
    assert listed["margin"][known] == pytest.approx(margin[doubtful], abs=1e-12)
    assert listed["reference"][known] == pytest.approx(r[doubtful], abs=1e-12)
    # what stays open is left to the second search, and is outside
    assert not np.isin(listed["pixel"][~known], number[inside]).any()
    assert (~known).sum() < 0.1 * len(number)


def test_second_searches_find_points_or_that_there_is_none(functions, elements):
    kernel = functions("cut_retry")
    rng = np.random.default_rng(42)
    count = 400
    mild = np.flatnonzero(np.arange(COUNT) % 3 < 2)
    candidates = kernel.records("candidates", count)
    element = rng.choice(mild, count)
    pixels = elements.pixel[element] + rng.integers(-12, 12, (count, 2))
    candidates["pixel"], candidates["element"] = (pixels - WINDOW) @ [1, SIDE], element
    candidates["status"] = rng.choice([OUTSIDE, UNKNOWN], count)
    candidates["field"] = 7.0
    given = {"view": view_of(kernel, elements, count), "polynomials": elements.polynomials, "candidates": candidates}
    found = kernel.results(count, ["candidates"], **given)["candidates"]
    r = elements.inverse(element, elements.point(*pixels.T), np.tile(CENTRE, (count, 1)))
    again = candidates["status"] == UNKNOWN
    assert (found["field"][~again] == 7.0).all()
    assert np.array_equal(found["status"][again], np.where(margin_of(r) >= -BORDER, INSIDE, OUTSIDE)[again])
    assert found["reference"][again] == pytest.approx(r[again], abs=1e-12)
    assert found["margin"][again] == pytest.approx(margin_of(r)[again], abs=1e-12)
    assert found["field"][again] == pytest.approx(elements.at(element, r)[0][again, 3], abs=1e-11)


def test_sections_hold_the_pixels_of_hulls_in_the_plane(functions):
    """Bounds of x, y, x + y and x - y of the lines between points of the hull, where these cross the plane."""
    kernel, count = functions("cut_cull"), 60
    rng = np.random.default_rng(43)
    hulls = rng.uniform(-1, 1, (count, 8, 3)) + rng.uniform(-1, 1, (count, 1, 3)) * [2.5, 2.5, 0.7]
    # points in the plane, to rounding
    hulls[:20, :3, 2] = rng.choice([0.5, 2.0], (20, 3)) * rng.choice([-1e-3, 1e-3], (20, 3))
    hulls[:10, 3:, 2] = np.abs(hulls[:10, 3:, 2]) + 0.1
    view = kernel.records("view", 1)
    camera = view["camera"][0]
    camera["left"], camera["top"], camera["width"], camera["height"] = 5, 3, 40, 30
    camera["picture"] = [2, 1, 60, 50]
    forms = np.array([[8.0, 1.0, 0.5, 30.0], [-1.0, 9.0, 1.0, 20.0], [0.4, -0.2, 0.3, 1.0]])
    camera["to_column"], camera["to_row"], camera["to_weight"] = forms
    view["normal"], view["slack"], view["count"] = [0.0, 0.0, 1.0], 1e-3, count
    given = {
        "view": view,
        "hulls": hulls,
        "sections": kernel.records("sections", count),
        "count": np.zeros(1, np.uint32),
    }
    found = kernel.results(count, ["sections", "count"], **given)
    sections = {section["element"]: section for section in found["sections"][: found["count"][0]]}
    wholes = [section_of(hull, forms) for hull in hulls]
    assert set(sections) == {k for k, whole in enumerate(wholes) if whole is not None and meets(whole)}
    assert 20 < len(sections) < count
    for k, section in sections.items():
        least, most = (own.copy() for own in wholes[k])
        least[:2], most[:2] = np.maximum(least[:2], [2, 1]), np.minimum(most[:2], [60, 50])
        assert np.array_equal(section["least"], least)
        assert np.array_equal(section["most"], most)
    behind = [k for k in sections if wholes[k][0][3] == 2 - 50 - 1 and wholes[k][1][3] == 60 - 1 + 1]
    assert 0 < len(behind) < len(sections) / 2


def section_of(hull, forms):
    """Least and greatest x, y, x + y and x - y of pixels; None where the plane isn't near."""
    height, slack = hull[:, 2], 1e-3
    if height.min() > slack or height.max() < -slack:
        return None
    points = [hull[k] for k in np.flatnonzero(np.abs(height) <= slack)]
    for p, q in combinations(hull, 2):
        if min(p[2], q[2]) < -slack and max(p[2], q[2]) > slack:
            points.append(p + (q - p) * (p[2] / (p[2] - q[2])))
    x, y, weight = forms[:, :3] @ np.array(points).T + forms[:, 3:]
    if (weight <= 0).any():
        return np.array([2, 1, 3, 2 - 50 - 1]), np.array([60, 50, 60 + 50 + 2, 60 - 1 + 1])
    x, y = x / weight, y / weight
    bounds, limit = np.array([x, y, x + y, x - y]), np.array([59, 50, 109, 109])
    low = np.clip(bounds.min(axis=1) - 1e-3, -limit, 2 * limit)
    return np.ceil(low).astype(int), np.floor(np.clip(bounds.max(axis=1) + 1e-3, -limit, 2 * limit)).astype(int)


def meets(whole):
    """Whether pixels of a section, or next to it, are drawn."""
    least, most = whole
    return (least[:2] - 1 <= [44, 32]).all() and (most[:2] + 1 >= [5, 3]).all()
