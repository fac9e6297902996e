"""The exact record of a picture, pixel by pixel."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from dataclasses import field as default
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.moments import Instant
from elvis.core.distances.triangle_files import renamed
from elvis.core.files.output import Outputs
from elvis.core.quantities.derived import RECOVERED
from elvis.scene import ColorBar, Scene, Vector
from elvis.scene.cameras.view import PlaneView, View
from elvis.scene.model.quantities import quantities
from elvis.scene.record.line_coverage import coverage
from elvis.scene.record.palette import NOT_A_NUMBER, Palette, automatic_range, is_constant
from elvis.scene.record.strokes import Segments, Stroke

#: pixels whose positions are worked out at once, as pictures may be large
_AT_ONCE = 1 << 20


class Status(IntEnum):
    """Status of a pixel."""

    MISS = 0
    CERTAIN = 1
    AMBIGUOUS = 2  # its point is within tolerance of an element border
    FAILED = 3  # an element may hold its point, but the search for it did not converge


#: statuses by the names that statistics give them
_STATUSES = {status.name.lower(): int(status) for status in Status}


@dataclass(frozen=True, eq=False)
class Arrow:
    """A glyph of a round magnitude, seen from the side.

    outline  (k, 2) pixels to the right of its base, and above it
    text     its magnitude
    """

    outline: Floats
    text: str


#: quantities of elements that are whole numbers
WHOLE_NUMBERS = ("element", "composite", "order", "shape", "jacobian_sign")


@dataclass(frozen=True, eq=False)
class Legend:
    """Meaning of colours, lines or lengths.

    palette  None for lines of a quantity that colours nothing, and for lengths
    marks    values of contour lines and their colours
    bar      settings of the bar in the scene
    constant  the single visible value, if there is only one: one colour needs no bar
    arrow    key to the lengths of glyphs
    """

    title: str
    palette: Palette | None
    marks: tuple[tuple[float, Vector], ...] = ()
    bar: ColorBar | None = None
    constant: float | None = None
    arrow: Arrow | None = None

    @property
    def is_whole(self) -> bool:
        """Whether values are whole numbers."""
        return self.title in WHOLE_NUMBERS


@dataclass(frozen=True, eq=False)
class Drawing:
    """The combined picture of several surfaces; arrays as in Frame.

    color        (h, w, 3) in [0, 1], or in whole steps of 1/255 as 8-bit integers
    uncertainty  also NaN where the surface is analytic
    line_status  (h, w) Status of the pixels' contours, MISS for pixels without; None if none is known
    strokes      lines over the pixels, which then contain no lines
    segments     the same in drafts, as short lines
    through      (h, w) visible share of the background; None: visible where nothing else is
    copies       (h, w) numbers of the copies that are visible, -1 where nothing is; None if there are no copies
    """

    depth: Floats
    normal: Floats
    color: Floats | NDArray[np.uint8]
    legends: tuple[Legend, ...]
    uncertainty: Floats | None = None
    line_status: NDArray[np.uint8] | None = None
    strokes: tuple[Stroke, ...] = ()
    segments: tuple[Segments, ...] = ()
    through: Floats | None = None
    copies: Ints | None = None


@dataclass(frozen=True)
class Ordinate:
    """What y means in a plot: the value ``base`` + y / ``scale`` of a quantity."""

    name: str
    base: float
    scale: float


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture; row 0 is the top.

    field      (h, w)     NaN where nothing is visible
    element    (h, w)     global element ids, -1 where nothing is visible
    reference  (h, w, 3)  reference coordinates in the element, NaN where nothing is visible; None if not requested
    status     (h, w)     see Status
    stats      seconds, bytes and counts by name
    box        (2, 3) low and high corner of the domain, if the picture shows it
    instant    time of a series that is shown, None for data that are not a series
    domain     lines of the domain, which images have over their pixels, but records do not
    ordinate   meaning of y if the picture is a plot of a quantity over x
    drawing    None for a single unlit plane, whose colours, depths and normals follow from the rest
    """

    scene: Scene
    view: View
    field: Floats
    element: Ints
    reference: Floats | None
    status: NDArray[np.uint8]
    stats: dict[str, Any] = default(default_factory=dict)
    drawing: Drawing | None = None
    box: Floats | None = None
    instant: Instant | None = None
    domain: Segments | None = None
    ordinate: Ordinate | None = None

    @property
    def has_rulers(self) -> bool:
        """Whether axes with ticks are drawn: on request, and next to plots."""
        return self.scene.axes or self.ordinate is not None

    @property
    def title(self) -> str:
        """The scene's own title, else that of the only colour map; then time and interpolation in a series."""
        if self.scene.title is not None:
            title = self.scene.title
        else:
            mapped = [legend for legend in self.legends if legend.palette and legend.constant is None]
            title = mapped[0].title if len(mapped) == 1 else ""
        return ", ".join(filter(None, (title, str(self.instant or ""))))

    @property
    def undeclared(self) -> list[str]:
        """Recovered quantities that neither the title of the picture nor that of a bar names."""
        mapped = [legend for legend in self.legends if legend.palette and legend.constant is None]
        titles = [self.scene.title or ""]
        if len(mapped) > 1 or self.scene.title is None:
            # the name of a single colour map is the title of the picture, unless its bar has one
            titles += [own.title for own in mapped if own.bar is None or own.bar.title is None]
        found = [text for text in quantities(self.scene) if RECOVERED in text]
        return [text for text in found if not any(text in title for title in titles)]

    def at(self, instant: Instant) -> Frame:
        """The frame as a picture of a time in a series, which its statistics record."""
        return replace(self, instant=instant, stats={**self.stats, "moment": instant.facts()})

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """Mask (h, w) of the pixels that show an element."""
        return self.element >= 0

    @property
    def copy(self) -> Ints | None:
        """Numbers (h, w) of the copies that are visible, 0 for the data, -1 where nothing is; None without copies."""
        return None if self.drawing is None else self.drawing.copies

    @cached_property
    def position(self) -> Floats:
        """World positions (h, w, 3) of the visible points, NaN elsewhere."""
        position = np.full((*self.element.shape, 3), np.nan)
        step = max(1, _AT_ONCE // self.element.shape[1])
        for first in range(0, len(self.element), step):
            rows, columns = np.nonzero(self.element[first : first + step] >= 0)
            rows += first
            position[rows, columns] = self.points_of(columns, rows)
        return position

    def points_of(self, columns: Ints, rows: Ints) -> Floats:
        """World positions (n, 3) of the visible points at pixels (n,)."""
        if self.drawing is None:
            return self._plane.points_of(columns, rows)
        origins, directions = self.view.rays(columns, rows)
        return np.asarray(origins + self.drawing.depth[rows, columns, None] * directions)

    @cached_property
    def depth(self) -> Floats:
        """Distances (h, w) from the eye's plane along the view, infinite where nothing is visible."""
        if self.drawing is not None:
            return self.drawing.depth
        return np.where(self.seen, self.view.depth_of(self.position), np.inf)

    @cached_property
    def uncertainty(self) -> Floats:
        """Largest difference (h, w) between ``depth`` and the true depth, in world units.

        The rounding of field and positions, divided by the slope at which the ray meets the surface; infinite where
        nothing is proved, NaN where nothing is visible.
        """
        from elvis.scene.record.conditioning import uncertainties

        known = None if self.drawing is None else self.drawing.uncertainty
        result = np.full(self.element.shape, np.nan) if known is None else known.copy()
        rest = np.flatnonzero(self.seen & np.isnan(result))
        places = self.position.reshape(-1, 3)[rest]
        depth, normal = self.depth.reshape(-1)[rest], self.normal.reshape(-1, 3)[rest]
        extent = float(np.abs(places).max(initial=0.0))
        result.reshape(-1)[rest] = uncertainties(self.view, rest, depth, normal, extent)
        return result

    @property
    def line_status(self) -> NDArray[np.uint8]:
        """Combined status (h, w) of contour coverage and of hits.

        If nothing is proved about contours, as for statistics and records, hits with contours are ambiguous.
        """
        told = None if self.drawing is None else self.drawing.line_status
        if told is None and has_contours(self.scene):
            told = np.where(self.seen, np.uint8(Status.AMBIGUOUS), np.uint8(Status.MISS))
        return self.status if told is None else np.maximum(self.status, told)

    @cached_property
    def normal(self) -> Floats:
        """Unit normals (h, w, 3) of the visible surface, towards the viewer; NaN elsewhere."""
        if self.drawing is not None:
            return self.drawing.normal
        return np.where(self.seen[..., None], self._plane.normal(), np.nan)

    @property
    def _plane(self) -> PlaneView:
        assert isinstance(self.view, PlaneView)
        return self.view

    @cached_property
    def range(self) -> tuple[float, float]:
        """Values at the ends of the first colour map."""
        return self.palette.low, self.palette.high

    @cached_property
    def palette(self) -> Palette:
        """The first colour map; the map of the scene's field if no object is coloured by a map."""
        if self.drawing is not None:
            maps = [legend.palette for legend in self.drawing.legends if legend.palette]
            if maps:
                return maps[0]
        asked = self.scene.range
        ends = asked if isinstance(asked, tuple) else automatic_range(self.field, self.scene.palette)
        return Palette.of_name(self.scene.palette, *ends).over_range(self.scene.bar)

    @property
    def legends(self) -> tuple[Legend, ...]:
        """Legends of the colours and lines; distances are labelled with bare file names."""
        found = (self._legend,) if self.drawing is None else self.drawing.legends
        return tuple(replace(one, title=renamed(one.title, os.path.basename)) for one in found)

    @property
    def _legend(self) -> Legend:
        """The legend of a single plane."""
        return Legend(self.scene.field, self.palette, bar=self.scene.bar, constant=constant_of(self.scene, self.field))

    @cached_property
    def alpha(self) -> Floats:
        """Opacities (h, w) of the picture, for backgrounds that are not opaque."""
        through: Any = ~self.seen
        if self.drawing is not None and self.drawing.through is not None:
            through = self.drawing.through
        behind = self.scene.background[3] if self.scene.is_clear else 1.0
        return np.asarray(1.0 - through * (1.0 - behind))

    @property
    def rgba(self) -> NDArray[np.uint8]:
        """Colours and opacities (h, w, 4) in [0, 255]; colours are not multiplied by opacities."""
        if not self.scene.is_clear:
            return np.dstack([self.rgb, np.full(self.element.shape, 255, np.uint8)])
        part = self.alpha[..., None]
        own = self.color - (1.0 - part) * np.asarray(self.scene.backdrop)
        own = np.divide(own, part, out=np.ones_like(own), where=part > 0.0)
        made: NDArray[np.uint8] = np.rint(255 * np.clip(np.dstack([own, part]), 0.0, 1.0)).astype(np.uint8)
        return made if self._ink is None else self._inked(made)

    @cached_property
    def color(self) -> Floats:
        """(h, w, 3) colours in [0, 1]."""
        if self.drawing is None:
            return self._colors.take(self._steps, axis=0)
        color = self.drawing.color
        return np.asarray(color / 255.0 if color.dtype == np.uint8 else color)

    @cached_property
    def rgb(self) -> NDArray[np.uint8]:
        """(h, w, 3) colours in [0, 255]."""
        return self._bare if self._ink is None else self._inked(self._bare)

    @property
    def _bare(self) -> NDArray[np.uint8]:
        """The same without lines of the domain."""
        if self.drawing is None:
            return np.rint(255 * self._colors).astype(np.uint8).take(self._steps, axis=0)
        return whole(self.drawing.color)

    @property
    def below_domain(self) -> tuple[Ints, NDArray[np.uint8]]:
        """Numbers (n,) of the pixels with lines of the domain, and the colours (n, 3) that they have without."""
        assert self._ink is not None
        numbers = self._ink[0]
        return numbers, self._bare.reshape(-1, 3)[numbers]

    @cached_property
    def _ink(self) -> tuple[Ints, Floats] | None:
        """Numbers (n,) of the pixels with lines of the domain, and the part of each that they cover."""
        return None if self.domain is None else coverage(self.domain, self.element.shape)

    def _inked(self, values: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Pixels (h, w, 3 or 4) of an image in [0, 255] with the lines of the domain, which are opaque."""
        assert self._ink is not None
        assert self.domain is not None
        numbers, part = self._ink
        rows = values.reshape(-1, values.shape[2]).copy()
        ink = np.multiply(255.0, [*self.domain.color, 1.0][: values.shape[2]])
        mixed = rows[numbers] + part[:, None] * (ink - rows[numbers])
        rows[numbers] = np.rint(mixed)
        return rows.reshape(values.shape)

    @cached_property
    def _steps(self) -> NDArray[np.uint16]:
        """(h, w) rows of _colors."""
        return np.where(self.seen, self.palette.steps(self.field), np.uint16(len(self.palette.table) + 1))

    @property
    def _colors(self) -> Floats:
        """Colours (steps + 2, 3): the palette, the colour for values that are not numbers, the background."""
        return np.vstack([self.palette.table, NOT_A_NUMBER, self.scene.backdrop])

    def counts(self) -> dict[str, int]:
        """Number of pixels by status, and of visible pixels whose values are not finite."""
        # some rows at a time, as pictures may be large
        rows = max(1, _AT_ONCE // max(1, self.status.shape[1]))
        blocks = (self.status[first : first + rows].ravel() for first in range(0, len(self.status), rows))
        by_status = dict.fromkeys(_STATUSES, 0)
        for block in blocks:
            for name, status in _STATUSES.items():
                by_status[name] += int(np.count_nonzero(block == status))
        undefined = self.stats.get("not_a_number")
        if undefined is None:
            undefined = int(np.count_nonzero(self.seen & ~np.isfinite(self.field)))
        return {**by_status, "not_a_number": undefined}

    def __repr__(self) -> str:
        counts = self.counts()
        told = ", ".join(f"{counts[name]} {name}" for name in ("certain", "ambiguous", "failed"))
        height, width = self.element.shape
        return f"<Frame {width} x {height} of {self.scene.field}: pixels {told}>"

    @property
    def image(self) -> NDArray[np.uint8]:
        """(h, w, 3) the bare picture in [0, 255], row 0 at the top; (h, w, 4) where the background is transparent."""
        return self.rgba if self.scene.is_clear else self.rgb

    @property
    def remarks(self) -> tuple[str, ...]:
        """Messages about the content of the picture and the origin of its data."""
        return tuple(self.stats.get("remarks", ()))

    def plot(self, ax: Any = None, *, colorbar: bool = True) -> Any:
        """Draw the picture into axes of matplotlib.

        Parameters
        ----------
        ax : matplotlib axes, optional
            By default those of a new figure.
        colorbar : bool
            Whether each colour map gets a colour bar.

        Returns
        -------
        matplotlib.image.AxesImage
            With world coordinates as its extent where the view is along an axis, else without axes.

        Raises
        ------
        ElvisError
            If matplotlib is not installed.
        """
        from elvis.scene.figure.axes_plot import plot_frame

        return plot_frame(self, ax, colorbar)

    def show(self) -> None:
        """Show the picture, with its colour bar and title: in a notebook, or in the system's viewer of pictures."""
        from elvis.scene.figure.showing import show

        show(self)

    def _repr_png_(self) -> bytes:
        """The picture as notebooks show it."""
        from io import BytesIO

        from elvis.scene.figure.picture import picture

        stream = BytesIO()
        picture(self).save(stream, "PNG")
        return stream.getvalue()

    def save(self, path: str | Path, *, plain: bool = False, outputs: Outputs | None = None) -> None:
        """Write ``.png`` (with colour bar and title unless ``plain``), ``.html``, ``.exr`` or ``.npz``, by the suffix.

        outputs  set of files to which this one belongs; all replace earlier files at once
        """
        from elvis.scene.figure.saving import save

        save(self, Path(path), plain=plain, outputs=outputs)


def whole(color: Floats | NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours in [0, 1], or already in [0, 255], in [0, 255]."""
    return color if color.dtype == np.uint8 else np.rint(255 * color).astype(np.uint8)  # type: ignore[return-value]


def has_contours(scene: Scene) -> bool:
    """Whether an object of a scene has contours."""
    styles = [getattr(item, "style", None) for item in scene.every_object]
    return any(style is not None and style.contours is not None for style in styles)


def constant_of(scene: Scene, values: Floats) -> float | None:
    """The only value that is seen, NaN aside, where colours go by the range of those; None where there are several,
    and of no values, as a rank without rows has."""
    if scene.range is not None or not values.size:
        return None
    low, high = np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)
    return float(low) if is_constant(low, high) else None
