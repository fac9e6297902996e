"""The colours of a series: one range for all of its steps, certified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.core.moments import BETWEEN
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.bounding import quantity_range
from elvis.core.terminal import track
from elvis.plugins.series.series import Series, series_in
from elvis.renderer.request import reading_for
from elvis.scene import Scene
from elvis.scene.errors import SceneError
from elvis.scene.palette import automatic_range


def with_range(scene: Scene, is_kept: bool = True, series: Series | None = None) -> Scene:
    """The scene with values in place of the range ``series``: bounds of its field over all steps that can be read.

    is_kept  whether conversions are kept
    series   that of the scene's data, where it is open already

    Raises SceneError where the data are no series, or nothing is known of the field's values.
    """
    if scene.range != "series":
        return scene
    if series is None:
        coloured = replace(scene, plane=None, objects=(), clip=())
        series = series_in(tuple(map(Path, scene.data)), reading_for([coloured], is_kept))
    if series is None:
        raise SceneError("range: expected several steps of a series, found one state: say seen, all or two values")
    return replace(scene, range=range_over(scene.field, series, scene.between))


def range_over(text: str, series: Series, between: str = BETWEEN[0]) -> tuple[float, float]:
    """The least lower and the greatest upper bound of a quantity over all steps; SceneError where none is known.

    between  how derivatives in time are found
    """
    ends: list[float] = []
    for number in track(series.readable(), "range of all steps", len(series)):
        dataset = series.at(float(series.times[number]), between)
        names = Names.of(dataset)
        text = text or names.fields[0]
        expression = Expression.parse(text, names)
        found = quantity_range(dataset, expression)
        ends += [] if found is None else [found.lower, found.upper]
    if not ends or not np.isfinite(ends).all():
        raise SceneError(f"range: nothing is known of the values of {text} at all steps: expected seen or two values")
    return automatic_range(np.array(ends))
