"""Largest differences of polynomials on two meshes, of any orders and bends, against dense samples.

No sample may exceed the bound, nor the largest difference that is stated by more than a part of it.  The points count
like pixels.
"""

from functools import partial

import numpy as np

from audit.cases import Case
from audit.validating import counted_as
from elvis.core.data.dataset import Dataset
from elvis.core.differences.difference import diff
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.scene.record.frame import Status

#: by how much a sample may be greater than what is stated, in parts of it
CLOSE = 1e-6
#: widths of clouds of further samples around the largest one
CLOUDS = (0.02, 0.003)


def case(rng, size):
    """Waves, half of the time with a narrow peak, as each mesh has them."""
    dimension = int(rng.choice([2, 2, 3]))
    parts, names = zip(*(_part(rng, dimension) for _ in range(2)), strict=True)
    points = rng.uniform(-0.05, 1.05, (size[0] * size[1], dimension))
    return Case(" and ".join(names), parts, {"size": size}, partial(count_samples, points, rng), False, compare)


def _part(rng, dimension):
    """A dataset and how it was made."""
    shape = Shape.of_dimension(dimension)[rng.integers(4 if dimension == 3 else 2)]
    cells, bend = int(rng.integers(1, 4 if dimension == 2 else 3)), float(rng.choice([0.0, 0.05]))
    modes = int(rng.integers(2, 6 if dimension == 2 else 5))
    mesh = grid(shape, cells)
    if bend:
        mesh = curved(mesh, ripple(bend, int(rng.integers(99))), int(rng.integers(2, 5)))
    waves, peak, height = rng.normal(size=(3, 3)) * 4, rng.uniform(0.2, 0.8, 3), 8 * rng.integers(2)

    def function(p):
        away = ((p - peak)[:, :dimension] ** 2).sum(axis=1)
        return np.sin(p @ waves).sum(axis=1) + height * np.exp(-away / 0.01)

    bare = Dataset(mesh)
    made = Dataset(mesh, (approximated(bare, "u", function, modes),))
    return made, f"{shape.label.lower()} {cells} bend {bend} modes {modes}"


def compare(gallery, case):
    """The difference, its integrals roughly."""
    return diff(*case.data, error=0.5)[0]


def count_samples(points, rng, case, row):
    """The count of samples."""
    apart = _apart(case.data, points)
    for width in CLOUDS:
        best = points[apart.argmax()]
        cloud = best + width * rng.normal(size=(len(points) // 4 + 1, points.shape[1]))
        points, apart = np.concatenate([points, cloud]), np.concatenate([apart, _apart(case.data, cloud)])
    reasons = {
        "greater than the bound": apart > row.bound * (1 + 1e-12),
        "greater than the greatest": apart > row.linf * (1 + CLOSE),
    }
    status = np.full(len(points), Status.CERTAIN, np.uint8)

    def details(number):
        place = ", ".join(f"{x:.17g}" for x in points[number])
        return f"at ({place}): {apart[number]:.10g}, stated {row.linf:.10g}, at most {row.bound:.10g}"

    return counted_as(case, status, np.isfinite(apart), reasons, details)


def _apart(data, points):
    """(n,) magnitudes of the difference, 0 where one of both has no value."""
    one, other = (sample(part, "u", points).values[:, 0] for part in data)
    return np.nan_to_num(np.abs(one - other))
