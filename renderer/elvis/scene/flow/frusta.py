"""Glyphs of a scene in its data, as solids between discs, made once for all pictures of the same data; their key."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns
from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import texts_of
from elvis.core.streamlines.anchors import anchors
from elvis.core.streamlines.flow_data import FlowSource
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError
from elvis.scene.model.objects import Glyphs
from elvis.scene.model.style import Style
from elvis.scene.model.whole import Scene
from elvis.scene.record.frame import Arrow, Legend

#: default length of the longest glyph, relative to the diagonal of the box
LENGTH = 0.05
#: proportions of an arrow, relative to the radius of its head: radius of the shaft, length of the head, overlap of
#: shaft and head
_SHAFT, _HEAD, _WITHIN = 0.4, 3.0, 0.3
#: maximum length of the glyph in the key, relative to the width of the picture
KEY = 0.2
#: objects in the same data whose solids are retained
_MOST = 8
_KNOWN: WeakKeyDictionary[FlowSource, dict[Glyphs, Frusta]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Frusta:
    """Solids between two discs across one axis: cylinders, and cones, whose second disc is a point.

    base       (n, 3)  centre of the first disc
    axis       (n, 3)  unit vector to the second
    length     (n,)    distance of the discs
    radii      (n, 2)  of both; the second is the smaller
    reference  (n, 3)  reference coordinates of the anchor in its element
    element    (n,)    ids of the anchors' elements
    points     (m, 3)  the anchors
    name       name of the vector
    magnitude  magnitude that corresponds to the object's length
    left       reasons why points have no glyph, with counts
    size       length of that magnitude, in world units
    """

    base: Floats
    axis: Floats
    length: Floats
    radii: Floats
    reference: Floats
    element: Ints
    points: Floats
    name: str
    magnitude: float
    left: Mapping[str, int]
    size: float


def frusta_in(data: FlowSource, item: Glyphs) -> Frusta:
    """The solids of an object; SceneError for points and vectors that can't be, and where nothing is to be drawn."""
    asked = replace(item, style=Style())
    known = _KNOWN.setdefault(data, {})
    if "-" in item.points:
        raise SceneError("points of glyphs: expected the name of a table, found -")
    if asked not in known:
        if len(known) >= _MOST:
            known.clear()
        try:
            known[asked] = _made(data, item)
        except ElvisError as error:
            raise SceneError(f"glyphs: {error}") from error
    found = known[asked]
    if not len(found.element):
        why = ", ".join(f"{count} that {words}" for words, count in found.left.items())
        raise SceneError(f"points of glyphs: expected some in the elements where the vector is not zero, found {why}")
    return found


def _made(data: FlowSource, item: Glyphs) -> Frusta:
    """The solids of all anchors."""
    vector = texts_of(item.vector)
    found = anchors(data, item.points, None if vector is None else tuple(vector), item.random)
    magnitudes = np.linalg.norm(found.vectors, axis=1)
    axis = found.vectors / magnitudes[:, None]
    magnitude = item.magnitude or float(magnitudes.max(initial=0.0))
    size = item.length or LENGTH * found.size
    whole = size * magnitudes / magnitude if item.lengths == "magnitude" else np.full(len(found), size)
    parts = _parts(item, whole)
    axes = np.tile(axis, (len(parts), 1))
    points, reference = (np.tile(own, (len(parts), 1)) for own in (found.points, found.reference))
    starts, lengths, radii = joined_columns(parts)
    return Frusta(
        points + starts[:, None] * axes,
        axes,
        lengths,
        radii,
        reference,
        np.tile(found.element, len(parts)),
        found.points,
        found.name,
        magnitude,
        found.left,
        size,
    )


def _parts(item: Glyphs, length: Floats) -> list[tuple[Floats, Floats, Floats]]:
    """Solids of glyphs of lengths (n,): start (n,), length (n,) and radii (n, 2) of each.

    A cone, or the head of an arrow and its shaft, which ends within the head.
    """
    wide = item.thickness * length
    head = length if item.shape == "cone" else _HEAD * wide
    parts = [(length - head, head, np.stack([wide, np.zeros(len(length))], axis=1))]
    if item.shape == "arrow":
        shaft = np.repeat(_SHAFT * wide[:, None], 2, axis=1)
        parts.append((np.zeros(len(length)), length - (1.0 - _WITHIN) * head, shaft))
    return parts


def keys_of(data: FlowSource, scene: Scene, view: View) -> tuple[Legend, ...]:
    """Length of each object's glyphs of a round magnitude, for objects whose lengths show magnitudes.

    In perspective this is the length at the mean depth of the glyphs that start in the picture; without any there is no
    key.
    """
    found = []
    for item in scene.every_object:
        if not isinstance(item, Glyphs) or item.lengths == "equal" or not item.key:
            continue
        own = frusta_in(data, item)
        scale = float(np.linalg.norm(view.column))
        if view.perspective:
            depth = view.depth_of(own.points[view.is_in_picture(own.points)])
            if not len(depth):
                continue
            scale *= float(depth.mean())
        pixels = own.size / own.magnitude / scale
        magnitude = _round_below(min(own.magnitude, KEY * view.width / pixels))
        unit = f" {item.unit}" if item.unit else ""
        where = " at the mean depth of these glyphs" if view.perspective else ""
        text = f"|{own.name}| = {magnitude:.6g}{unit}{where}"
        found.append(Legend(own.name, None, arrow=Arrow(_outline(item, magnitude * pixels), text)))
    return tuple(found)


def _round_below(value: float) -> float:
    """The maximum of 1, 2 and 5 times a power of ten that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(factor * power for factor in (0.5, 1.0, 2.0, 5.0) if factor * power <= value * (1 + 1e-12))


def _outline(item: Glyphs, length: float) -> Floats:
    """(k, 2) what a glyph is seen as from the side: its upper half from the beginning to the tip, then the lower."""
    (start, _, radii), *rest = _parts(item, np.array([length]))
    head, tip = [start[0], radii[0, 0]], [length, 0.0]
    shaft = rest[0][2][0, 0] if rest else 0.0
    upper = np.array([[0.0, shaft], [start[0], shaft], head, tip])
    return np.concatenate([upper, upper[-2::-1] * [1.0, -1.0]])
