"""The colours of a series: one range for all of its steps, certified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.core.moments import BETWEEN, Moment
from elvis.core.portions.borrowing import borrowing
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.bounding import deciding_elements, quantity_range
from elvis.core.ranges import Range
from elvis.core.ranks import ALONE, Ranks
from elvis.core.terminal import track
from elvis.plugins.series.series import Series, series_in
from elvis.renderer.parts import whole_of
from elvis.renderer.request import reading_for
from elvis.scene import Scene
from elvis.scene.errors import SceneError
from elvis.scene.palette import automatic_range


def with_range(scene: Scene, is_kept: bool = True, series: Series | None = None, ranks: Ranks = ALONE) -> Scene:
    """The scene with the range ``series`` replaced by bounds of its field over all steps that can be read.

    is_kept  whether conversions are cached
    series   of the scene's data, if it is already open
    ranks    that each read their part of the steps, also of ``series``

    Raises SceneError if the data are not a series, or if no bounds of the field are known.
    """
    if scene.range != "series":
        return scene
    if series is None:
        coloured = replace(scene, plane=None, objects=(), clip=())
        reading = replace(reading_for([coloured], is_kept), ranks=ranks)
        series = series_in(tuple(map(Path, scene.data)), reading)
    if series is None:
        raise SceneError("range: expected several steps of a series, found one state: use visible, all or two values")
    return replace(scene, range=range_over(scene.field, series, scene.between, ranks, scene.palette))


def range_over(
    text: str, series: Series, between: str = BETWEEN[0], ranks: Ranks = ALONE, palette: str | None = None
) -> tuple[float, float]:
    """The smallest lower and the largest upper bound of a quantity over all steps; SceneError where none is known.

    between  how derivatives in time are found
    ranks    that each read their part of the steps
    palette  name of the colour map
    """
    ends: list[float] = []
    for number in track(series.readable(), "range of all steps", len(series)):
        moment = Moment(time=float(series.times[number]), between=between)
        part = series.part_at(moment) if ranks.size > 1 else None
        dataset = series.at_moment(moment) if part is None else part.dataset
        text = text or Names.of(dataset).fields[0]
        expression = Expression.of(dataset, text)
        found = quantity_range(dataset, expression) if part is None else _range_in_parts(part, expression, ranks)
        ends += [] if found is None else [found.lower, found.upper]
    if not ends or not np.isfinite(ends).all():
        raise SceneError(f"range: no bounds of {text} over all steps are known: expected visible or two values")
    return automatic_range(ends, palette)


def _range_in_parts(part: Portion, expression: Expression, ranks: Ranks) -> Range | None:
    """The range of a quantity, of those elements of each part that may hold an end; of all if it looks beyond one."""
    if not expression.is_borrowed:
        whole = whole_of(part, [expression.text], ranks)
        return quantity_range(whole, Expression.of(whole, expression.text))
    part = borrowing(part, [expression.text], ranks)
    own = part.of(deciding_elements(part.dataset, expression)).alone
    every = ranks.exchange(own, f"the range of {expression.text}")
    return quantity_range(replace(unite(every).dataset, surfaces=part.dataset.surfaces), expression)
