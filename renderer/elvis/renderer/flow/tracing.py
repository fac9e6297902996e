"""Lines of a picture as curves (see elvis.scene.record.strokes), from the hits of its surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.device.drafts import has_segments, is_draft
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.renderer.frame.shading import Painter
from elvis.renderer.frame.undeformed import GREY
from elvis.renderer.frame.visible_hits import Drawn
from elvis.renderer.passes.lines.lines import Lines
from elvis.renderer.raster.compositing import FAINT
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene import Vector
from elvis.scene.cameras.view import View
from elvis.scene.record.strokes import Segments, Stroke, borders, chain, meet_at_corners

#: width of lines whose distances to borders are known far enough from these, in pixels
WIDE = 6.0
#: the same in drafts: fewer pixels search for their distance, and next to them lines may be off by parts of a pixel
WIDE_OF_DRAFTS = 3.0
#: widths of a pixel by which a surface's depth changes at most from its centre to its border
STEEP = 8.0
#: width of outlines in pixels
OUTLINE = 1.5
#: part of a depth within which two surfaces are one
SAME = 1e-9


@dataclass(frozen=True)
class StrokeStyle:
    """Common properties of the lines of one stroke."""

    width: float
    color: Vector
    opacity: float
    value: float | None
    labels: bool = False


#: short lines of one object: starts and ends (n, 2), the pixels (n,) that they lie on, and their depths (n,) there
ShortLines: TypeAlias = tuple[Floats, Floats, Ints, Floats]
#: number of what a scene draws, and of its lines among them: borders are 0, contours follow by their values
Place: TypeAlias = tuple[int, int]
#: short lines of one style, by their owners: starts and ends (n, 2), and in drafts depths of both (n, 2)
Found: TypeAlias = dict[StrokeStyle, list[tuple[Place, Floats, Floats, Floats]]]


@dataclass(eq=False)
class Tracer:
    """Gathers short lines band by band."""

    painter: Painter
    draw_calls: Sequence[DrawCall]
    found: Found = field(default_factory=dict)

    def strokes(self) -> tuple[Stroke, ...]:
        """All of them, joined: in an order that neither bands nor threads of a device have a part in."""
        made = []
        for style in sorted(self.found, key=self._order):
            _, starts, ends, _ = zip(*self.found[style], strict=True)
            short = np.concatenate([np.concatenate(starts), np.concatenate(ends)], axis=1)
            short = short[np.lexsort(short.T)]
            lines = chain(short[:, :2], short[:, 2:])
            lines = meet_at_corners(lines) if style.value is None else lines
            made.append(Stroke(lines, style.width, style.color, style.opacity, style.value, style.labels))
        return tuple(made)

    def segments(self) -> tuple[Segments, ...]:
        """All lines as short segments, for drafts: joining them takes longer than drawing them."""
        made = []
        for style in sorted(self.found, key=self._order):
            _, *parts = zip(*self.found[style], strict=True)
            starts, ends, depths = map(np.concatenate, parts)
            made.append(Segments(starts, ends, depths, style.width, style.color, style.opacity))
        return tuple(made)

    def _order(self, style: StrokeStyle) -> tuple[Place, float]:
        """First position of a style, with faint lines before others."""
        return min(place for place, *_ in self.found[style]), style.opacity

    def take(self, found: Found) -> None:
        """Lines that others have gathered."""
        for style, parts in found.items():
            self.found.setdefault(style, []).extend(parts)

    def note(self, drawn: Drawn, view: View, own: Bools) -> None:
        """Lines of the surfaces of a view.

        own  (n,) pixels of the view on which lines are wanted
        """
        for number, (draw_call, hits) in enumerate(drawn):
            before = [one for k, one in enumerate(drawn) if k != number]
            call = self.draw_calls.index(draw_call)
            if draw_call.style.mesh_lines is not None:
                side = hits.owner if hits.side is None else hits.side
                seen, style = draw_call.view_of(view), draw_call.style.mesh_lines
                lines = self._borders(seen, hits, side, self.painter.lines_of(draw_call))
                self._keep(StrokeStyle(style.width, style.color, 1.0, None), (call, 0), lines, before, hits, seen, own)
            if draw_call.style.contours is not None:
                self._contours(view, call, hits, before, own)
        shown = [one for one in drawn if one[0].ghost is None]
        if self.painter.scene.outline and shown:
            self._outline(shown, view, own, self.painter.text_color)
        if self.painter.scene.undeformed == "outline":
            self._outline([one for one in drawn if one[0].ghost is not None], view, own, GREY, shown)

    def _borders(self, view: View, hits: HitBuffer, side: NDArray[np.uint32], of: Lines) -> ShortLines:
        """Short lines around all pixels of one side."""
        shape = view.height, view.width
        marks = of.mesh(view, hits, WIDE_OF_DRAFTS if is_draft() else WIDE)
        owner = np.where(hits.owner == NOBODY, -1, side.astype(np.int64)).reshape(shape)
        lines = borders(owner, marks.distance.reshape(shape), hits.depth.reshape(shape), view.first)
        return *lines, hits.depth[lines[2]]

    def _outline(self, drawn: Drawn, view: View, own: Bools, color: Vector, before: Drawn | None = None) -> None:
        """The border of all pixels of some surfaces; distances to borders refer to the nearest one.

        before  surfaces that may hide it
        """
        distance, depth = np.full((2, view.count), np.inf)
        for draw_call, hits in drawn:
            nearer = np.flatnonzero(hits.depth < depth)
            depth[nearer] = hits.depth[nearer]
            marks = self.painter.lines_of(draw_call).mesh(draw_call.view_of(view), hits, WIDE)
            distance[nearer] = marks.distance[nearer]
        shape = view.height, view.width
        seen = np.where(np.isfinite(depth), 0, -1).reshape(shape)
        lines = borders(seen, distance.reshape(shape), depth.reshape(shape), view.first)
        style = StrokeStyle(OUTLINE, color, 1.0, None)
        outline = *lines, depth[lines[2]]
        self._keep(style, (len(self.draw_calls), 0), outline, before or [], drawn[0][1], view, own)

    def _contours(self, view: View, call: int, hits: HitBuffer, before: Drawn, own: Bools) -> None:
        """The contours of a surface, where it is not itself in front of them."""
        draw_call, painter = self.draw_calls[call], self.painter
        contours = draw_call.style.contours
        assert contours is not None
        quantity, values = draw_call.on_device(painter.of_contours(draw_call)), painter.values(draw_call)
        of = painter.stages.resampled(hits, draw_call.on_device(draw_call.quantity), quantity)
        found = painter.stages.lines.strokes(draw_call.view_of(view), of, values, quantity)
        if hits.flat is None:
            there = hits.depth[found["pixel"]]
            found = found[~(np.abs(there - found["depth"]) > found["slack"]) | ~np.isfinite(there)]
        for number, value in enumerate(values.tolist()):
            here = found[found["number"] == number]
            style = StrokeStyle(contours.width, contours.color, 1.0, value, contours.labels)
            pixel = here["pixel"].astype(np.int64)
            # next to a silhouette, a line may lie on a pixel whose centre shows no surface
            there = hits.depth[pixel]
            lines = here["from"], here["to"], pixel, np.where(np.isfinite(there), there, here["depth"])
            self._keep(style, (call, 1 + number), lines, before, hits, draw_call.view_of(view), own)

    def _keep(
        self,
        style: StrokeStyle,
        place: Place,
        lines: ShortLines,
        others: Sequence[tuple[DrawCall, HitBuffer]],
        hits: HitBuffer,
        view: View,
        own: Bools,
    ) -> None:
        """Store short lines of an object, faded by the surfaces in front of them."""
        starts, ends, pixel, depth = lines
        depths = np.zeros((len(pixel), 0))
        if has_segments(self.painter.scene):
            depths = np.stack([depths_at(view, hits, pixel, depth, places) for places in (starts, ends)], axis=1)
        through = np.ones(len(pixel))
        with np.errstate(invalid="ignore"):
            for draw_call, other in others:
                through[other.depth[pixel] < depth * (1.0 - SAME)] *= 1.0 - draw_call.opacity
        through = np.where(own[pixel], np.round(through, 3), 0.0)
        for part in np.unique(through[through > FAINT]):
            here = through == part
            fainter = replace(style, opacity=float(part))
            self.found.setdefault(fainter, []).append((place, starts[here], ends[here], depths[here]))


def depths_at(view: View, hits: HitBuffer, pixel: Ints, depth: Floats, places: Floats) -> Floats:
    """Depths (n,) of a surface at places (n, 2) next to the centres of pixels (n,): of its tangent planes there.

    depth  (n,) at the centres
    """
    normal = hits.normal[pixel]
    origin, direction = view.rays_of(pixel)
    points = origin + depth[:, None] * direction

    # the ray o + d r of a place meets the plane n·(x - p) = 0 at d = n·(p - o) / n·r; at a silhouette that may be
    # anywhere, and some pixels before or behind the point are enough
    origin, direction = view.rays(places[:, 0], places[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        found = ((points - origin) * normal).sum(axis=1) / (direction * normal).sum(axis=1)
    wide = STEEP * np.linalg.norm(view.column) * (np.abs(depth) if view.perspective else 1.0)
    return np.where(np.isfinite(found), np.clip(found, depth - wide, depth + wide), depth)
