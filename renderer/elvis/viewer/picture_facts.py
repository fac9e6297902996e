"""Facts of a picture that the page shows next to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elvis.scene.figure.page import BarPlace, Layout
    from elvis.scene.record.frame import Frame

Table = dict[str, Any]


def facts_of(frame: Frame, layout: Layout) -> Table:
    """Facts of a picture for the page: its camera, the position of the image, counts, ranges, remarks."""
    from elvis.scene.model.tables import table_of

    height, width = frame.element.shape
    legends = [legend for legend in frame.legends if legend.palette is not None]
    return {
        "camera": table_of(frame.view.camera),
        "image": [*layout.corner, width, height],
        "size": list(layout.size),
        "bars": [_facts_of_bar(bar) for bar in layout.bars],
        "counts": frame.counts(),
        "remarks": list(frame.remarks),
        "folds": bool(frame.stats.get("deformation", {}).get("folds")),
        "ranges": {own.title: [own.palette.low, own.palette.high] for own in legends if own.palette},
        "field": frame.scene.field,
        "title": frame.title,
    }


def _facts_of_bar(bar: BarPlace) -> Table:
    """Position of a colour bar, and the values at its ends."""
    from elvis.scene.record.palette import linear_part

    palette = bar.legend.palette
    assert palette is not None
    own = bar.legend.bar
    scale = "linear" if own is None else own.scale
    ends = {"low": palette.low, "high": palette.high}
    # up to which size a symmetric logarithmic scale is linear
    linear = linear_part(own, palette.low, palette.high) if own is not None and scale == "symlog" else None
    facts = {"title": bar.legend.title, "box": list(bar.box), "upright": bar.upright, "scale": scale, "linear": linear}
    return {**facts, **ends}
