"""The compressed form of GEOMETRY: each section is a payload of 8-byte records (format notes 1.7)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.formats.nektar.payload import decode
from elvis.formats.nektar.raw import RawCurves
from elvis.formats.nektar.xml import Element, located

#: columns of a curve record: id, entity, number of points, 0, offset into INDEX, PointsType
_CURVE_WIDTH = 6


class Codec:
    """Reads the sections of the compressed form."""

    def read_vertices(self, section: Element) -> tuple[Ints, Floats]:
        """Ids (n,) and points (n, 3)."""
        records = decode(section.content, 4)
        return records.view("<i8")[:, 0].astype(np.int64), records.view("<f8")[:, 1:].astype(np.float64)

    def read_rows(self, section: Element, widths: Mapping[str, int]) -> dict[str, tuple[Ints, Ints]]:
        """By tag ids (n,) and members (n, width); EDGE is a payload itself, others have one a tag."""
        if section.tag == "EDGE":
            return {"E": _table(section, widths["E"])}
        rows: dict[str, tuple[Ints, Ints]] = {}
        for child in section.children():
            if child.tag not in widths or child.tag in rows:
                raise child.error(f"expected {', '.join(widths)}, each once, found <{child.tag}>")
            rows[child.tag] = _table(child, widths[child.tag])
        return rows

    def read_curves(self, section: Element) -> tuple[RawCurves, RawCurves]:
        """Curved edges and curved faces."""
        children = {child.tag: child for child in section.children()}
        data = children.get("DATAPOINTS")
        parts = {child.tag: child for child in data.children()} if data else {}
        if "INDEX" not in parts or "POINTS" not in parts:
            raise FormatError("expected DATAPOINTS with INDEX and POINTS, found none")

        index = _records(parts["INDEX"], 1)[:, 0]
        with located(parts["POINTS"]):
            _, points = self.read_vertices(parts["POINTS"])
        if len(index) and not 0 <= index.min() <= index.max() < len(points):
            raise parts["INDEX"].error(f"expected places in {len(points)} points, found one beyond them")
        edges = _curves(children.get("E"), index, points)
        return edges, _curves(children.get("F"), index, points)


CODEC = Codec()


def _table(element: Element, width: int) -> tuple[Ints, Ints]:
    """Ids and members of records of one more item."""
    records = _records(element, width + 1)
    return records[:, 0].copy(), records[:, 1:].copy()


def _records(element: Element, width: int) -> Ints:
    with located(element):
        return decode(element.content, width).view("<i8").astype(np.int64, copy=False)


def _curves(element: Element | None, rows: Ints, points: Floats) -> RawCurves:
    """The curves of one kind; ``rows`` are those of INDEX in ``points``."""
    if element is None or element.is_empty:
        return RawCurves.none()
    table = _records(element, _CURVE_WIDTH)
    entities, counts, offsets, kinds = table[:, 1].copy(), table[:, 2].copy(), table[:, 4], table[:, 5].copy()
    with located(element):
        return RawCurves(entities, kinds, counts, points[rows[owned(counts, offsets, len(rows))]])


def owned(counts: Ints, offsets: Ints, available: int) -> Ints:
    """Places of the points of all curves, one after another; FormatError where they aren't among those available."""
    if np.any((counts < 0) | (counts > available) | (offsets < 0) | (offsets > available - counts)):
        raise FormatError(f"expected curves of at most {available} points, found one beyond them")
    total = int(counts.sum())
    if total > 16 * (available + 1):
        raise FormatError(f"expected curves of {available} points in all, found {total}")
    ends = np.cumsum(counts)
    places = np.repeat(offsets - ends + counts, counts)
    places += np.arange(total)
    return places
