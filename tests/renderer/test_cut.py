"""The host's part of a plane cut: tiles of sections, and who owns a disputed pixel."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elvis import Plane, Status
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple
from elvis.renderer.passes.plane import cut
from elvis.renderer.passes.plane.cut import Cutter
from elvis.renderer.raster.pixels import BORDER, INSIDE, NOBODY, UNKNOWN, Pixels, resolve
from elvis.renderer.raster.tiles import TILE, tiles_of

CANDIDATE = np.dtype(
    [
        ("pixel", np.uint32),
        ("element", np.uint32),
        ("status", np.int32),
        ("field", np.float64),
        ("margin", np.float64),
        ("reference", np.float64, 3),
    ]
)
points = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 40)), min_size=1, max_size=12)


def bounds_of(groups):
    """Bounds (n, 4) and (n, 4) of x, y, x + y and x - y of the pixels of each group."""
    every = [np.array([(x, y, x + y, x - y) for x, y in pixels]) for pixels in groups]
    least, most = np.zeros((2, len(every), 4), np.int64)
    for number, bounds in enumerate(every):
        least[number], most[number] = bounds.min(axis=0), bounds.max(axis=0)
    return least, most


@given(st.lists(points, max_size=5))
def test_tiles_cover_every_pixel_of_a_section(groups):
    tiles = tiles_of(*bounds_of(groups))
    for number, pixels in enumerate(groups):
        own = tiles[tiles.section == number]
        for x, y in pixels:
            held = (own.x <= x) & (x < own.x + TILE) & (own.y <= y) & (y < own.y + TILE)
            assert held.sum() == 1


def test_slanted_sections_have_fewer_tiles():
    diagonal = [(i, i) for i in range(800)]
    tiles = tiles_of(*bounds_of([diagonal]))
    assert 100 <= len(tiles) <= 300


def candidates_of(*rows):
    """Candidates from (pixel, element, status, margin); field and reference tell who made them."""
    candidates = np.zeros(len(rows), CANDIDATE)
    for candidate, (pixel, element, status, margin) in zip(candidates, rows, strict=True):
        candidate["pixel"], candidate["element"], candidate["status"], candidate["margin"] = (
            pixel,
            element,
            status,
            margin,
        )
        candidate["field"], candidate["reference"] = 100 + element, element
    return candidates


def resolved(owners, *candidates):
    owner = np.array(owners, np.uint32)
    status = np.where(owner == NOBODY, Status.MISS, Status.CERTAIN).astype(np.uint8)
    pixels = Pixels(owner, status)
    resolve(pixels, [candidates_of(*rows) for rows in candidates])
    return pixels


@pytest.mark.parametrize(
    ("candidates", "owner", "status"),
    [
        ([(0, 5, INSIDE, 0.0)], 5, Status.AMBIGUOUS),
        ([(0, 5, INSIDE, -0.5 * BORDER), (0, 4, INSIDE, 0.5 * BORDER)], 4, Status.AMBIGUOUS),
        ([(0, 5, INSIDE, 0.3)], 5, Status.CERTAIN),
        ([(0, 5, INSIDE, 0.3), (0, 4, INSIDE, 0.0)], 5, Status.CERTAIN),
        ([(0, 5, INSIDE, 0.3), (0, 6, INSIDE, 0.4)], 5, Status.CERTAIN),
        ([(0, 5, UNKNOWN, 0.3)], NOBODY, Status.FAILED),
        ([(0, 5, UNKNOWN, 0.3), (0, 9, INSIDE, 0.3)], 9, Status.CERTAIN),
        ([(0, 5, 0, 0.3)], NOBODY, Status.MISS),
        ([], NOBODY, Status.MISS),
    ],
)
def test_a_free_pixel_goes_to_any_candidate(candidates, owner, status):
    for order in (candidates, candidates[::-1]):
        pixels = resolved([NOBODY, NOBODY], order)
        assert pixels.owner.tolist() == [owner, NOBODY]
        assert pixels.status.tolist() == [status, Status.MISS]
        committed = [candidate for some in pixels.committed for candidate in some]
        assert not committed if owner == NOBODY else committed[-1]["field"] == 100 + owner
        assert owner == NOBODY or (committed[-1]["reference"] == owner).all()


@pytest.mark.parametrize(
    ("candidate", "owner"),
    [
        ((0, 5, INSIDE, 0.0), 8),
        ((0, 9, INSIDE, 0.0), 8),
        ((0, 9, INSIDE, 0.3), 8),
        ((0, 5, INSIDE, 0.3), 5),
        ((0, 5, UNKNOWN, 0.3), 8),
    ],
)
def test_an_owned_pixel_goes_only_to_a_lower_number(candidate, owner):
    pixels = resolved([8], [candidate])
    assert (pixels.owner[0], pixels.status[0]) == (owner, Status.CERTAIN)
    assert [candidate["field"] for some in pixels.committed for candidate in some] == [100 + owner] * (owner != 8)


def test_candidates_of_all_parts_count_together():
    pixels = resolved([NOBODY] * 3, [(2, 7, INSIDE, 0.0), (0, 7, INSIDE, 0.2)], [(2, 3, INSIDE, 0.0)])
    assert pixels.owner.tolist() == [7, NOBODY, 3]
    assert pixels.status.tolist() == [Status.CERTAIN, Status.MISS, Status.AMBIGUOUS]


def test_the_winning_candidate_is_shown_with_its_value():
    """Later parts decide over earlier ones; element, field and reference belong together."""
    earlier, later = np.zeros(3, CANDIDATE), np.zeros(2, CANDIDATE)
    earlier["pixel"], later["pixel"] = [7, 5, 7], [5, 9]
    for each, first in ((earlier, 10), (later, 20)):
        each["element"] = first + np.arange(len(each))
        each["field"] = each["element"]
        each["reference"] = each["element"][:, None]
    shown = []

    class Commit:
        dtype = staticmethod(lambda name: CANDIDATE)

        def __call__(self, count, given):
            shown.append(given["candidates"])

    device = SimpleNamespace(kernel=lambda stage: Commit(), buffer=lambda array: array)
    Cutter._commit(SimpleNamespace(device=device, references=1), [earlier, later], {})
    (found,) = shown
    assert dict(zip(found["pixel"].tolist(), found["element"].tolist(), strict=True)) == {7: 12, 5: 20, 9: 21}
    assert (found["field"] == found["element"]).all()
    assert (found["reference"] == found["element"][:, None]).all()


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM], ids=lambda shape: shape.label)
def test_sections_drawn_a_few_at_a_time_give_the_same_picture(draw, linear, shape, monkeypatch):
    dataset = linear(curved(grid(shape, 3), ripple(0.2, seed=3), 4))
    scene = {"plane": Plane((0.5, 0.5, 0.5), (0.2, -0.3, 1.0)), "size": (60, 51)}
    whole = draw(dataset, **scene)
    monkeypatch.setattr(cut, "_SECTIONS", 7)
    lengths = []
    draw_sections = Cutter._draw_sections

    def counted(self, number, view, sections, image):
        lengths.append(len(sections))
        return draw_sections(self, number, view, sections, image)

    monkeypatch.setattr(Cutter, "_draw_sections", counted)
    in_blocks = draw(dataset, **scene)
    assert max(lengths) == 7
    assert len(lengths) > 3
    for name in ("status", "element", "field", "reference"):
        assert np.array_equal(getattr(in_blocks, name), getattr(whole, name), equal_nan=True)
