"""Series for tests: functions of place and time on a small mesh, a file for each of their steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Dataset
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid
from elvis.formats.writing import write
from elvis.plugins.series.series import Series
from elvis.plugins.series.statistics import average


def steps_of(
    folder: Path,
    times: Sequence[float | None],
    function: Callable[[Floats, Any], Floats],
    name: str = "run",
    **how: Any,
) -> list[Path]:
    """A mesh of four squares and a file of the field u for each time; these files.

    function  values (n,) at points (n, 3) and a time, quadratic in space
    how       as of `write`
    """
    mesh = grid(Shape.QUADRILATERAL, 2)
    write(Dataset(mesh), folder / "mesh.xml")
    (folder / "mesh.fld").unlink(missing_ok=True)
    files = [folder / "mesh.xml"]
    for number, time in enumerate(times):
        field = approximated(Dataset(mesh), "u", partial(_at, function, time), 3)
        file = folder / f"{name}_{number}.chk"
        write(Dataset(mesh, (field,), time), field_path=file, **how)
        files.append(file)
    return files


def _at(function: Callable[[Floats, Any], Floats], time: float | None, points: Floats) -> Floats:
    return function(points, time)


def polynomial(points: Floats, time: float, degree: int) -> Floats:
    """(n,) values at points (n, 3): quadratic in space, of a degree in time."""
    x, y = points[:, 0], points[:, 1]
    powers = [(1 + k * x - x * y) * time**k / (1 + k) for k in range(degree + 1)]
    return np.asarray(np.sum(powers, axis=0))


def waves(points: Floats, time: float) -> Floats:
    """(n,) values at points (n, 3): linear in space, a sine in time."""
    return np.asarray((1 + points[:, 0]) * np.sin(time))


def agree(series: Series, points: Floats, times: Sequence[float], values: Mapping[str, Floats]) -> None:
    """Check the fields of all steps, the middle of the last two, the mean and the variance against a solver's values.

    points  (n, 3) positions of the nodes
    values  (steps, n) by the name of a field

    AssertionError if any differs by 1e-12 of the field's largest value, for the variance 1e-12 of its square.
    """
    assert series.times.tolist() == list(times)
    mean = average(series, with_covariances=True).dataset
    middle = series.at((times[-2] + times[-1]) / 2)
    found = [sample(dataset, list(values), points) for dataset in (*series, middle, mean)]
    for name, own in values.items():
        wanted = [*own, own[-2:].mean(axis=0), own.mean(axis=0)]
        variance = sample(mean, f"{name}_{name}", points)[f"{name}_{name}"]
        largest = np.abs(own).max()
        assert np.abs(np.subtract([each[name] for each in found], wanted)).max() <= 1e-12 * largest
        assert np.abs(variance - own.var(axis=0)).max() <= 1e-12 * largest**2
