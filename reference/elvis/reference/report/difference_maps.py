"""Pictures of a report on differences: both solutions and what separates them, in one scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.differences.pairing import REFERENCE
from elvis.core.summary.picturing import Kind
from elvis.reference.study import complete, drawing_device
from elvis.scene import Scene
from elvis.scene.record.frame import Frame
from elvis.scene.record.palette import automatic_range

#: width and height of pictures if the scene gives none
SIZE = (640, 480)
#: colours of differences, white for zero
_DIVERGING = "coolwarm"


@dataclass(frozen=True, eq=False)
class Maps:
    """The pictures of one field.

    pictures  pictures by their names on the page: the field of both data in one range, then the difference
    words     for each picture the ends of its colours, and remarks about the difference's pixels
    """

    field: str
    pictures: dict[str, NDArray[np.uint8]]
    words: tuple[str, str, str]


def difference_maps(
    first: Dataset, second: Dataset, names: tuple[str, str], fields: Sequence[str], scene: Scene
) -> Iterator[Maps]:
    """The pictures of some fields in a scene, whose own field and range don't count.

    names  of the data
    Raises ElvisError if nothing can be drawn.
    """
    if Kind.LINE in map(Kind.of, (first, second)):
        raise ElvisError("expected 2D or 3D data, found 1D data, which are drawn as curves")
    draw, both = drawing_device(), first.with_others(**{REFERENCE: second})
    asked = replace(scene, outputs=(), stats=None, range=None, size=scene.size or SIZE)
    for field in fields:
        ours = draw(first, replace(asked, field=field), device=scene.device)
        placed = replace(complete(ours), range=automatic_range(np.array(ours.range)))
        theirs = draw(second, placed, device=scene.device)
        apart = _difference(draw, both, placed, field)
        titled = zip((*names, f"{names[0]} less {names[1]}"), (ours, theirs, apart), strict=True)
        yield Maps(field, {name: frame.image for name, frame in titled}, (_ends(ours), _ends(theirs), _words(apart)))


def _difference(draw: Callable[..., Frame], both: Dataset, placed: Scene, field: str) -> Frame:
    """The picture of what separates the fields, in colours that are white where nothing does."""
    text = f'"{field}" - {REFERENCE}:"{field}"'
    scene = replace(placed, field=text, palette=_DIVERGING, range=None, title=f"difference of {field}")
    found = draw(both, scene, device=placed.device)
    greatest = float(np.abs(found.field[np.isfinite(found.field)]).max(initial=0.0))
    if greatest == 0.0:
        return found
    return draw(both, replace(scene, range=(-greatest, greatest)), device=placed.device)


def _ends(frame: Frame) -> str:
    """The ends of the colours."""
    low, high = frame.range
    return f"{low:.4g} to {high:.4g}"


def _words(frame: Frame) -> str:
    """The ends of the colours, given by the largest visible difference, and the number of undefined pixels."""
    lost = frame.counts()["not_a_number"]
    return _ends(frame) + (f"; {lost} pixels, in magenta, where the reference has no value" if lost else "")
