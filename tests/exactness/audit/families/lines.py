"""Streamlines of linear and Hamiltonian fields with known solutions, from seeds in awkward places of curved elements.

The maps are polynomials with explicit inverses (`worlds`), and so are the velocities in their elements: a flow in
straight coordinates X is carried to the world by x = map(X).  Points count like pixels.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import expm

from audit.cases import Case
from audit.polynomials import X, Y, Z
from audit.validating import counted_as
from audit.worlds import world
from elvis.core.streamlines.endings import End
from elvis.core.streamlines.streamlines import trace
from elvis.scene.record.frame import Status

#: error of points in parts of the box, for each e-fold by which neighbouring lines part
PROMISED = 1e-10
#: seeds of a case
SEEDS = 6
#: ends that no such field may have
WRONG = (End.JUMP, End.NAN, End.INVERTED, End.FAILED, End.STEPS)


def case(rng, size):
    """Rotations, saddles and Hamiltonian flows about a middle of an element, a vertex or anywhere."""
    dimension = int(rng.choice([2, 3, 3]))
    own = world(rng, dimension, placements=("plain", "off", "mirrored"))
    low, high = own.mesh.vertices.min(axis=0), own.mesh.vertices.max(axis=0)
    matrix = _matrix(rng, dimension, str(rng.choice(["rotation", "saddle", "hamiltonian"])))
    centre = np.where(rng.random(3) < 0.5, 0.5, np.round(8 * rng.random(3)) / 8) * (high - low) + low
    centre[dimension:] = 0.0
    straight = [
        sum((float(a) * (axis + -float(c)) for a, axis, c in zip(row, (X, Y, Z), centre, strict=True)), 0 * X)
        for row in matrix
    ]
    # x = X + a Y^2 + e Y moves with dX + (2 a Y + e) dY
    (a, b), (e, f) = own.bend, own.shear
    u, v, w = straight
    local = (u + (2 * a * Y + e) * v, v, w + (2 * b * Y + f) * v)
    fields = {name: local[k] * float(own.scale[k]) for k, name in enumerate("uvw"[:dimension])}
    data = own.dataset(fields, 4)
    seeds = np.round(4 * rng.random((SEEDS, 3))) / 4 * (high - low) + low
    vertices = own.mesh.vertices[rng.integers(len(own.mesh.vertices), size=SEEDS)]
    seeds = np.where(rng.random((SEEDS, 1)) < 0.5, seeds, vertices)
    seeds[:, dimension:] = 0.0
    check = partial(count_points, own, matrix, centre)
    return Case(own.name, data, {"size": size}, check, False, partial(follow, own.placed(own.bent(seeds))))


def _matrix(rng, dimension, kind):
    """(3, 3) a matrix whose numbers are eighths."""
    matrix = np.zeros((3, 3))
    matrix[:dimension, :dimension] = np.round(8 * rng.normal(size=(dimension, dimension))) / 8
    if kind == "saddle":
        matrix[0, 0] -= np.trace(matrix)
        return matrix
    if kind == "rotation":
        return matrix - matrix.T
    # a quadratic Hamiltonian in the plane of X and Y
    plane = np.zeros((3, 3))
    plane[0, 1], plane[1, 0] = 1 + matrix[0, 1] ** 2, -1 - matrix[1, 0] ** 2
    return plane


def follow(seeds, gallery, case):
    """The lines, of a duration in which rotations turn a few times."""
    dimension = case.data.mesh.dimension
    return trace(case.data, seeds[:, :dimension], duration=8.0, length=1e9, steps=20_000)


def count_points(own, matrix, centre, case, lines):
    """The count of points of all lines."""
    line = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))
    first = own.straightened(lines.points[lines.offsets[:-1][np.diff(lines.offsets) > 0]]).astype(float)
    firsts = np.zeros((len(lines), 3))
    firsts[np.diff(lines.offsets) > 0] = first
    flows = np.array([expm(matrix * time) for time in lines.time]).reshape(-1, 3, 3)
    straight = centre + np.einsum("nij,nj->ni", flows, firsts[line] - centre)
    straight[:, own.dimension :] = 0.0
    expected = own.placed(own.bent(straight))
    size = np.linalg.norm(np.ptp(own.corners(), axis=0))
    growth = np.linalg.norm(flows, ord=2, axis=(1, 2)).clip(1.0)
    off = np.linalg.norm((lines.points - expected)[:, : own.dimension], axis=1)
    reasons = {
        "off the line": off > PROMISED * size * growth,
        "ended without a reason": np.isin(lines.end[line], WRONG),
    }
    status = np.full(len(line), Status.CERTAIN, np.uint8)

    def details(row):
        end = lines.ends[lines.end[line[row]]]
        return f"line {line[row]} at time {lines.time[row]:.6g}: {off[row] / size:.3g} of the box off, end {end}"

    return counted_as(replace(case, scene={}), status, np.ones(len(line), bool), reasons, details)
