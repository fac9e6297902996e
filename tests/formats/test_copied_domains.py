"""Components that mirrors change, boxes of copies that meet, and periods: what copies of a domain rest on."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.copied_domains import SLACK, _boxes_meet, _relative, check_mirror, check_overlaps
from elvis.core.deformed.isometries import Isometry
from elvis.core.quantities.moved_expressions import _agree, components
from elvis.core.quantities.tree import call, coordinate, number
from elvis.core.shapes import Shape
from elvis.core.testing import grid

UNIT_BOX = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
FLAT_BOX = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("fields", "dimension", "vectors", "tensors", "axial"),
    [
        (["u", "v", "w", "p"], 3, {"u": (0,), "v": (1,), "w": (2,)}, {}, []),
        (["u", "v"], 3, {}, {}, []),
        (["u", "v"], 2, {"u": (0,), "v": (1,)}, {}, []),
        (["u", "v", "w"], 2, {"u": (0,), "v": (1,), "w": (2,)}, {}, []),
        (["v", "w"], 2, {}, {}, []),
        (["W_x", "W_y", "W_z"], 3, {"W_x": (0,), "W_y": (1,), "W_z": (2,)}, {}, ["W_x", "W_y", "W_z"]),
        (["vorticity_z"], 2, {"vorticity_z": ()}, {}, ["vorticity_z"]),
        (["vorticity_z"], 3, {}, {}, []),
        (["q_z"], 2, {}, {}, []),
        (["s_xx", "s_xy", "s_yy"], 2, {}, {"s_xx": (0, 0), "s_xy": (0, 1), "s_yy": (1, 1)}, []),
        (["s_xx", "s_yy"], 2, {}, {}, []),
        (["s_xx", "s_xy", "s_yy"], 3, {}, {}, []),
        (["uu", "vu", "vv"], 2, {}, {"uu": (0, 0), "vu": (1, 0), "vv": (1, 1)}, []),
    ],
)
def test_components_are_those_of_complete_vectors_and_tensors(fields, dimension, vectors, tensors, axial):
    found = components(fields, dimension)
    assert {name: own.axes for name, own in found.items()} == vectors | tensors
    assert [name for name, own in found.items() if own.is_axial] == axial
    for name, axes in tensors.items():
        assert found[name].names[axes[::-1]] == name


@pytest.mark.parametrize(("part", "meets"), [(0.5, False), (2.0, True)])
@pytest.mark.parametrize("box", [UNIT_BOX, FLAT_BOX])
def test_boxes_meet_if_they_overlap_by_more_than_the_slack(box, part, meets):
    """Along each axis in which one of them has an extent; in the others they lie in one plane within it."""
    slack = 1e-3
    for axis in range(2):
        for way in (1, -1):
            shift = way * (1 - part * slack) * np.eye(3)[axis]
            assert _boxes_meet(box, box + shift, slack) is meets
            assert _boxes_meet(box + shift, box, slack) is meets
    assert _boxes_meet(FLAT_BOX, FLAT_BOX + np.array([0.2, 0.2, part * slack]), slack) is not meets
    thick = np.array([FLAT_BOX[0], [1.0, 1.0, part * slack]])
    assert _boxes_meet(thick, thick + np.array([0, 0, 0.9 * part * slack]), slack) is not meets
    assert _boxes_meet(FLAT_BOX, thick + np.array([0, 0, 0.9 * part * slack]), slack) is not meets


def test_copies_that_are_placed_alike_are_compared_once():
    steps = [Isometry.translation([k, 0, 0]) for k in range(4)]
    assert [pair for _, pair in _relative(steps)] == [(0, 1), (0, 2), (0, 3)]
    turned = [own.after(Isometry.turn([0, 0, 0], [0, 0, 1], 30)) for own in steps[:2]]
    assert len(_relative([*steps[:2], *turned])) == 5
    for own, (first, second) in _relative([steps[1], turned[0]]):
        points = np.random.default_rng(1).uniform(size=(3, 3))
        several = [steps[1], turned[0]]
        assert several[first].points(own.points(points)) == pytest.approx(several[second].points(points))


@pytest.mark.parametrize("away", [0.0, 1e4])
def test_copies_overlap_and_mirrors_cut_beyond_the_slack_only(away):
    """Also far from the origin: the slack is relative to the size of the domain."""
    mesh = grid(Shape.HEXAHEDRON, 1)
    dataset = Dataset(replace(mesh, vertices=mesh.vertices + away))
    slack = SLACK * np.sqrt(3)
    x = np.array([1.0, 0.0, 0.0])
    check_overlaps(dataset, [Isometry(), Isometry.translation((1 - 0.5 * slack) * x)])
    with pytest.raises(ElvisError, match="copy 1 overlaps copy 0"):
        check_overlaps(dataset, [Isometry(), Isometry.translation(0.4 * x)])
    for end, way in ((away, 1), (away + 1.0, -1)):
        check_mirror(dataset, [Isometry()], (end + 0.5 * way * slack) * x, x)
        with pytest.raises(ElvisError, match="cuts the domain"):
            check_mirror(dataset, [Isometry()], (end + 2 * way * slack) * x, -x)
    with pytest.raises(ElvisError, match="cuts the domain"):
        check_mirror(dataset, [Isometry(), Isometry.translation(2 * x)], (away + 1.5) * x, x)


def test_expressions_that_differ_at_negative_values_are_not_the_same():
    x = coordinate(0)
    assert not _agree(call("sqrt", call("*", x, x)), x)
    assert _agree(call("+", x, x), call("*", number(2.0), x))
