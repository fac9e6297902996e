"""The colours of a series: one range for all of its steps, certified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.base.terminal import track
from elvis.core.bounds.bounding import deciding_elements, quantity_range
from elvis.core.bounds.ranges import Range
from elvis.core.data.dataset import Dataset
from elvis.core.data.moments import Moment
from elvis.core.portions.borrowing import borrowing
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities import Expression, Names
from elvis.plugins.series.series import Series, series_in
from elvis.renderer.asking.request import reading_for
from elvis.renderer.frame.copied import CopiedData
from elvis.renderer.frame.copy_checks import with_periods
from elvis.renderer.parts.parts import whole_of
from elvis.scene import Scene
from elvis.scene.model.errors import SceneError
from elvis.scene.record.palette import automatic_range


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
    return replace(scene, range=range_over(scene.field, series, scene, ranks))


def range_over(text: str, series: Series, scene: Scene, ranks: Ranks = ALONE) -> tuple[float, float]:
    """The smallest lower and the largest upper bound of a quantity over all steps; SceneError where none is known.

    scene  whose copies show the quantity; it also says how derivatives in time are found, and the colour map
    ranks  that each read their part of the steps
    """
    ends: list[float] = []
    for number in track(series.readable(), "range of all steps", len(series)):
        own = series.part_at(Moment(time=float(series.times[number]), between=scene.between))
        text = text or Names.of(own if isinstance(own, Dataset) else own.dataset).fields[0]
        if isinstance(own, Portion) and scene.copies is not None:
            own = whole_of(own, [text], ranks)
        if isinstance(own, Portion):
            found = [_range_in_parts(own, Expression.of(own.dataset, text), ranks)]
        else:
            found = [quantity_range(own, each) for each in _on_copies(own, text, scene)]
        ends += [end for each in found if each is not None for end in (each.lower, each.upper)]
    if not ends or not np.isfinite(ends).all():
        raise SceneError(f"range: no bounds of {text} over all steps are known: expected visible or two values")
    return automatic_range(ends, scene.palette)


def _on_copies(dataset: Dataset, text: str, scene: Scene) -> list[Expression]:
    """A quantity as a function of the data on each copy in a scene, each function once."""
    own = Expression.of(dataset, text)
    alone = replace(scene, field=text, plane=None, objects=(), clip=())
    return [own, *CopiedData.of(with_periods(alone, dataset), Names.of(dataset)).expressions]


def _range_in_parts(part: Portion, expression: Expression, ranks: Ranks) -> Range | None:
    """The range of a quantity, of those elements of each part that may hold an end; of all if it looks beyond one."""
    if not expression.is_borrowed:
        whole = whole_of(part, [expression.text], ranks)
        return quantity_range(whole, Expression.of(whole, expression.text))
    part = borrowing(part, [expression.text], ranks)
    own = part.of(deciding_elements(part.dataset, expression)).alone
    every = ranks.exchange(own, f"the range of {expression.text}")
    return quantity_range(replace(unite(every).dataset, surfaces=part.dataset.surfaces), expression)
