"""Means over planes across an axis: a profile of the data along that axis, such as that of a channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import Integrals, integrate
from elvis.plugins.fourier.planes import fourier_mean, fourier_plane

_AXES = "xyz"
#: by how much of the extent of the data planes at its ends are moved inwards, where they may miss faces by rounding
_INWARDS = 1e-13


@dataclass(frozen=True)
class PlaneMeans:
    """Means over planes.

    places  coordinates of the planes
    sizes   area of the data in each plane, length in 2D data
    means   for each field a mean on each plane
    errors  for each field the largest bound or estimate of the error of a mean
    """

    axis: str
    places: tuple[float, ...]
    sizes: tuple[float, ...]
    means: dict[str, tuple[float, ...]]
    errors: dict[str, float]


def plane_means(dataset: Dataset, axis: str, places: Sequence[float]) -> PlaneMeans:
    """The mean of each field over the part of planes that lies in the data.

    Parameters
    ----------
    dataset : Dataset
        2D or 3D data, also with one Fourier direction; in 2D, planes are lines.
    axis : str
        ``x``, ``y`` or ``z``: the normal of the planes.
    places : sequence of float
        Coordinates of the planes along the axis.

    Raises
    ------
    ElvisError
        If a plane misses the data, or the data have no such axis.

    >>> cube = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    >>> ds = elvis.from_arrays({"hexahedron": [cube]}, u=[cube[:, 0] + cube[:, 2]])
    >>> profile = elvis.plane_means(ds, "z", [0.25, 0.5])
    >>> [round(mean, 6) for mean in profile.means["u"]]
    [0.75, 1.0]
    """
    names = [field.name for field in dataset.solution]
    if not names:
        raise ElvisError("--planes: expected fields to average, found none")
    rows = [_integrals(dataset, axis, float(place), names) for place in places]
    means = {name: tuple(row[number].value for row in rows) for number, name in enumerate(names)}
    errors = {name: max(row[number].error for row in rows) for number, name in enumerate(names)}
    return PlaneMeans(axis, tuple(places), tuple(row[0].measure for row in rows), means, errors)


def _integrals(dataset: Dataset, axis: str, place: float, names: Sequence[str]) -> Integrals:
    """The means of fields over one plane."""
    wanted = [f'average("{name}")' for name in names]
    dimension = dataset.mesh.dimension
    has_waves = any(block.expansion.homogeneous for field in dataset.fields for block in field.blocks)
    number = _AXES.index(axis)
    if has_waves and number == dimension:
        return integrate(fourier_plane(dataset, axis, place), wanted)
    if dimension < 2 or number >= dimension:
        raise ElvisError(f"--planes: expected 2D or 3D data with the axis {axis}, found {dimension}D data")
    flat = fourier_mean(dataset, _AXES[dimension]) if has_waves else dataset

    low, high = (float(corner[number]) for corner in flat.mesh.corners)
    if not low <= place <= high:
        raise ElvisError(f"--planes: expected places from {low:.6g} to {high:.6g} along {axis}, found {place:g}")
    margin = _INWARDS * (high - low)
    point, normal = [0.0] * 3, [0.0] * 3
    point[number], normal[number] = min(max(place, low + margin), high - margin), 1.0
    plane = f"plane:{','.join(map(repr, point))}:{','.join(map(repr, normal))}"
    return integrate(flat, wanted, plane)
