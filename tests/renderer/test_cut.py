"""The host's part of a plane cut: tiles of sections, and who owns a disputed pixel."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elvis.renderer import Status
from elvis.renderer.pixels import BORDER, INSIDE, NOBODY, UNKNOWN, Pixels, settle
from elvis.renderer.tiles import TILE, tiles_of

CLAIM = np.dtype(
    [
        ("pixel", np.uint32),
        ("element", np.uint32),
        ("verdict", np.int32),
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


def claims_of(*rows):
    """Claims from (pixel, element, verdict, margin); field and reference tell who made them."""
    claims = np.zeros(len(rows), CLAIM)
    for claim, (pixel, element, verdict, margin) in zip(claims, rows, strict=True):
        claim["pixel"], claim["element"], claim["verdict"], claim["margin"] = pixel, element, verdict, margin
        claim["field"], claim["reference"] = 100 + element, element
    return claims


def settled(owners, *claims):
    owner = np.array(owners, np.uint32)
    status = np.where(owner == NOBODY, Status.MISS, Status.CERTAIN).astype(np.uint8)
    pixels = Pixels(owner, status)
    settle(pixels, [claims_of(*rows) for rows in claims])
    return pixels


@pytest.mark.parametrize(
    ("claims", "owner", "status"),
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
def test_who_owns_a_pixel_that_nobody_took(claims, owner, status):
    for order in (claims, claims[::-1]):
        pixels = settled([NOBODY, NOBODY], order)
        assert pixels.owner.tolist() == [owner, NOBODY]
        assert pixels.status.tolist() == [status, Status.MISS]
        granted = [claim for some in pixels.granted for claim in some]
        assert not granted if owner == NOBODY else granted[-1]["field"] == 100 + owner
        assert owner == NOBODY or (granted[-1]["reference"] == owner).all()


@pytest.mark.parametrize(
    ("claim", "owner"),
    [
        ((0, 5, INSIDE, 0.0), 8),
        ((0, 9, INSIDE, 0.0), 8),
        ((0, 9, INSIDE, 0.3), 8),
        ((0, 5, INSIDE, 0.3), 5),
        ((0, 5, UNKNOWN, 0.3), 8),
    ],
)
def test_a_pixel_that_has_an_owner_goes_to_a_lower_number_only(claim, owner):
    pixels = settled([8], [claim])
    assert (pixels.owner[0], pixels.status[0]) == (owner, Status.CERTAIN)
    assert [claim["field"] for some in pixels.granted for claim in some] == [100 + owner] * (owner != 8)


def test_claims_of_all_parts_count_together():
    pixels = settled([NOBODY] * 3, [(2, 7, INSIDE, 0.0), (0, 7, INSIDE, 0.2)], [(2, 3, INSIDE, 0.0)])
    assert pixels.owner.tolist() == [7, NOBODY, 3]
    assert pixels.status.tolist() == [Status.CERTAIN, Status.MISS, Status.AMBIGUOUS]
