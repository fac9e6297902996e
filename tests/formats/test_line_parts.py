"""Parts of streamlines by themselves: entry into elements, directions of ribbons at their seeds, limits."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import patches
from elvis.core.quantities.expression import Expression
from elvis.core.shapes import Shape
from elvis.core.streamlines import marks
from elvis.core.streamlines.entries import ALONG, ON_SIDE, taking_up
from elvis.core.streamlines.lines import local_maps
from elvis.core.streamlines.lines import pieces as line_pieces
from elvis.core.streamlines.lines.pieces import Pieces, Steps, _curved, check_count, resting
from elvis.core.streamlines.lines.steps import Piece
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.streamlines.ribbons import _directions, _turned, _with_length, at_seeds
from elvis.core.streamlines.velocity import Velocity
from elvis.core.testing import curved, grid


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("place", "velocity", "takes"),
    [
        # heights over sides in reference coordinates are half the distance in these
        ((0.3, 0.2, -0.4), (-1.0, 0.3, 0.2), True),
        ((-1 + 0.9 * 2 * ON_SIDE, 0.2, -0.4), (-1.0, 0.3, 0.2), False),
        ((-1 + 1.1 * 2 * ON_SIDE, 0.2, -0.4), (-1.0, 0.3, 0.2), True),
        ((-1.0, 0.2, -0.4), (1.0, 0.3, 0.2), True),
        ((-1.0, 0.2, -0.4), (-1.9 * ALONG, 1.0, 0.2), True),
        ((-1.0, 0.2, -0.4), (-2.1 * ALONG, 1.0, 0.2), False),
        ((-1.0, 0.2, 1.0), (1.0, 0.3, 0.2), False),
        ((-1.0, 0.2, 1.0), (1.0, 0.3, -0.2), True),
    ],
)
def test_elements_take_up_lines_that_lead_into_them(place, velocity, takes, sign):
    """Onto the nearest side that they are on, before they are judged; in either direction of the stream."""
    dataset = Dataset(grid(Shape.HEXAHEDRON, 1))
    flow = Velocity(dataset, [Expression.of(dataset, f"{sign * each!r} + 0*x") for each in velocity])
    neighbours = Neighbours.of(dataset, patches(dataset))
    location = Locator(patches(dataset)).locate(np.full((3, 3), 0.5))
    states = np.array([[0.0, 0.0, 0.0], place, [0.0, 0.0, 0.0]])
    assert taking_up(flow, neighbours, location, states, np.array([1]), sign).tolist() == [takes]
    on_side = np.array([-1.0, *place[1:]]) if abs(place[0] + 1) < 2 * ON_SIDE else place
    assert states[1] == pytest.approx(on_side, abs=1e-15)
    assert not states[[0, 2]].any()


def test_ribbons_begin_across_their_lines():
    """Along the part of a vector across the line; of an axis where the vector is along the line, to rounding."""
    x, y, z = np.eye(3)
    tilted = np.array([np.cos(2e-6), np.sin(2e-6), 0.0])
    nearly = np.array([np.cos(5e-7), np.sin(5e-7), 0.0])
    found = at_seeds(np.array([z, x, tilted, nearly]), [3.0, 0.0, 0.0], 3)
    assert found[0] == pytest.approx(x)
    assert found[2] == pytest.approx([np.sin(2e-6), -np.cos(2e-6), 0.0], abs=1e-9)
    for direction, own in zip((x, nearly), found[[1, 3]], strict=True):
        assert np.linalg.norm(own) == pytest.approx(1)
        assert abs(own @ direction) < 1e-15
        assert own @ y > 0.99
    # without a vector the axis of the space that all lines together are most across
    directions = np.array([0.8 * x + 0.6 * y, x])
    assert at_seeds(directions, None, 2) == pytest.approx(np.array([[-0.6, 0.8, 0.0], y]))
    assert at_seeds(directions, None, 3) == pytest.approx(np.array([z, z]))


def test_directions_of_pieces_and_shortest_turns():
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (5, 8, 3))
    numbers = np.zeros(5, int)
    pieces = Pieces(points, points, numbers, np.zeros(5), numbers, np.zeros((5, 2)), np.zeros((5, 8)))
    polynomials = [[np.polynomial.Polynomial(own[:, k]).deriv() for k in range(3)] for own in points]
    for u, found in zip((-1.0, 1.0), _directions(pieces), strict=True):
        slope = np.array([[each(u) for each in own] for own in polynomials])
        assert found == pytest.approx(slope / np.linalg.norm(slope, axis=1, keepdims=True), rel=1e-12)
    before, after = _directions(pieces)
    across = np.cross(before, rng.normal(size=(5, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turned = _turned(across, before, after)
    # Rodrigues' formula about the axis across both directions
    axis, cosine = np.cross(before, after), (before * after).sum(axis=1, keepdims=True)
    own = cosine * across + np.cross(axis, across) + axis * (axis * across).sum(axis=1, keepdims=True) / (1 + cosine)
    assert turned == pytest.approx(own, rel=1e-9, abs=1e-12)


def test_curves_have_a_limit_and_particles_rest(monkeypatch):
    monkeypatch.setattr(line_pieces, "_MOST_PIECES", 3)
    check_count(3)
    with pytest.raises(ElvisError, match="expected curves of 3 pieces"):
        check_count(4)
    points, reference = np.arange(6.0).reshape(2, 3), np.arange(4.0).reshape(2, 2)
    pieces = resting(points, reference, np.array([7, 8]), np.array([0, 1]), np.array([0.5, 0.25]))
    for u in (-1.0, 0.3, 1.0):
        powers = u ** np.arange(8)
        assert powers @ pieces.points == pytest.approx(points)
        assert powers @ pieces.reference == pytest.approx(np.pad(reference, ((0, 0), (0, 1))))
    assert pieces.time.tolist() == [[0.5, 0.5], [0.25, 0.25]]
    assert not pieces.length.any()


def test_curves_of_steps_end_where_the_steps_do(monkeypatch):
    """Their polynomials are off at the end: what is missing there is added in proportion to the time."""
    rng, found = np.random.default_rng(5), []
    nets, end, zeros = rng.normal(size=(3, 8, 4)), rng.normal(size=(3, 4)), np.zeros(3, int)
    monkeypatch.setattr(line_pieces, "in_patch", lambda velocity, number, steps, most: found.append(steps))
    monkeypatch.setattr(Pieces, "joined", staticmethod(list))
    time, lasts = np.array([0.0, 1.0, 4.0]), np.array([1.0, 3.0, 0.5])
    _curved([Piece(np.arange(3), zeros, zeros, time, lasts, nets, np.ones(3), end)], 10, -1, None, 1.0)
    (steps,) = found
    assert isinstance(steps, Steps)
    assert steps.line.tolist() == [10, 11, 12]
    assert steps.time.tolist() == [[0.0, -1.0], [-1.0, -4.0], [-4.0, -4.5]]
    assert steps.nets[:, -1] == pytest.approx(end, rel=1e-14)
    added = np.linspace(0, 1, 8)[:, None] * (end - nets[:, -1])[:, None]
    assert steps.nets == pytest.approx(nets + added, rel=1e-13, abs=1e-14)


@pytest.mark.parametrize(("part", "is_kept"), [(0.99, False), (1.01, True)])
def test_pieces_count_if_they_are_longer_than_rounding_of_their_places(part, is_kept):
    """Places may have negative coordinates, of which the largest magnitude counts."""
    points = np.zeros((1, 8, 3))
    points[0, 0] = [1.0, -1000.0, 10.0]
    points[0, 3, 2] = part * 1e-10 * 1000.0
    pieces = SimpleNamespace(points=points, part=lambda chosen: len(chosen))
    assert _with_length(pieces) == is_kept


def test_marks_are_at_equal_lengths_or_times_of_lines_that_are_slower_at_one_end():
    """Lengths of pieces are polynomials that grow; times grow in proportion to the parameter."""
    wanted = np.linspace(-0.9, 0.9, 7)
    length = np.tile([2.0, 1.0, 0.4, 0.2, 0, 0, 0, 0], (7, 1))
    pieces, which = SimpleNamespace(length=length), np.arange(7)
    reached = np.einsum("np,np->n", wanted[:, None] ** np.arange(8), length)
    assert marks._places(pieces, which, None, reached, "length") == pytest.approx(wanted, abs=1e-9)
    ends = np.tile([3.0, 5.0], (7, 1))
    assert marks._places(pieces, which, ends, 4 + wanted, "time") == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.QUADRILATERAL])
def test_short_steps_lie_where_the_map_says(shape):
    """Local polynomials serve many steps that are close to each other; the map itself serves the others."""
    mesh = curved(grid(shape, 2), lambda x: x + 0.1 * np.sin(2.0 * x[..., ::-1]), 6)
    velocity = Velocity(Dataset(mesh), [])
    rng = np.random.default_rng(3)
    d = shape.dimension
    spread = rng.uniform(-1e-4, 1e-4, (60, 15, d))
    states = np.full((60, 1, d), -0.4) + spread
    # in a second element, alone in its place, and too long for a cell
    states[40:58] += 0.05
    states[58], states[59] = -0.6 + spread[58], -0.4 + 100.0 * spread[59]
    rows = np.repeat([0, 1, 0], [40, 18, 2])
    found, errors = local_maps.positions_along(velocity, 0, rows, states, 1e-11)
    places = velocity.positions(*local_maps.repeated(0, rows, states)).reshape(60, 15, 3)
    differences = np.abs(found - places).max(axis=(1, 2))
    assert (errors[:58] > 0).all()
    assert (errors <= local_maps._PART * 1e-11).all()
    assert (differences <= errors + 4e-16).all()
    assert differences[:58].max() > 0
    assert not errors[58:].any()
    assert not differences[58:].any()
    assert not local_maps.positions_along(velocity, 0, rows, states, 1e-16)[1].any()


def test_cells_far_from_the_element_are_not_shared():
    """As a clock may be; keys of cells would be ambiguous."""
    states = np.zeros((40, 15, 2))
    states[:, :, 1] = 1e6
    assert not len(local_maps._cells_of_steps(np.zeros(40, int), states)[0])
    assert len(local_maps._cells_of_steps(np.zeros(40, int), states / 1e6)[0]) == 40
