"""Values to colours; the one piece of picture-making that renderer and reference share."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.hints import perhaps
from elvis.core.files.plain import check_plain
from elvis.scene import ColorBar, Transfer, Vector
from elvis.scene.model.errors import SceneError

if TYPE_CHECKING:
    from cmap import Colormap

#: a function of many values at once
Change: TypeAlias = Callable[[Floats], Floats]
#: colour of visible values that are not finite
NOT_A_NUMBER = (1.0, 0.0, 1.0)
STEPS = 256
#: part of its size by which the rounding of a constant's evaluation may change it
CONSTANT = 1e-14
#: characters of a file with a colour map, at most
LARGEST = 1 << 20
#: colour maps of the first ElVis: places in [0, 1] and colours there; its diverging one is K. Moreland's (2009)
FIRST: dict[str, list[tuple[float, ...]]] = {
    "elvis:blackbody": [(0, 0, 0, 0), (0.4, 0.901961, 0, 0), (0.8, 0.901961, 0.901961, 0), (1, 1, 1, 1)],
    "elvis:bluetoyellow": [(0, 0.0392157, 0.0392157, 0.94902), (1, 0.94902, 0.94902, 0.0392157)],
    "elvis:grayscale": [(0, 0, 0, 0), (1, 1, 1, 1)],
    "elvis:rainbow": [(0, 0, 0, 1), (0.25, 0, 1, 1), (0.5, 0, 1, 0), (0.75, 1, 1, 0), (1, 1, 0, 0)],
}
ALIASES = {"elvis:diverging": "matplotlib:coolwarm"}


@dataclass(frozen=True, eq=False)
class Palette:
    """A colour map: ``table`` (n, 3) in [0, 1], for values from ``low`` to ``high``.

    edges  (n - 1,) the values at which one colour follows another, ascending; None: all steps are equal
    """

    table: Floats
    low: float
    high: float
    edges: Floats | None = None

    @staticmethod
    def of_name(name: str, low: float, high: float) -> Palette:
        """The colour map that the cmap catalogue, or FIRST, calls ``name``, or of an .xml file; SceneError else."""
        if _is_own(name):
            places = np.array(FIRST.get(name) or points_in(name))
            return Palette(_between(places[:, 0], places[:, 1:], (0.0, 1.0)), low, high)
        return Palette(_of_catalogue(name), low, high)

    def over_range(self, bar: ColorBar | None) -> Palette:
        """The same colours, spread over the values as a bar says; SceneError where the range has no logarithms."""
        if bar is None or (bar.scale == "linear" and bar.bands is None):
            return self
        if bar.scale == "log" and not self.low > 0.0:
            raise SceneError(
                f"a logarithmic scale: expected a range above zero, found {self.low:g} to {self.high:g}: "
                "use two values for the range, or scale=symlog"
            )
        edges = self._edges(bar)
        count = len(edges) + 1
        table = self.table if bar.bands is None else self.table[np.rint(np.linspace(0, STEPS - 1, count)).astype(int)]
        return replace(self, table=table, edges=edges)

    def _edges(self, bar: ColorBar) -> Floats:
        """(k,) values between neighbouring colours: evenly on the scale of the bar, or round ones."""
        if bar.bands is not None and bar.round and bar.scale == "linear":
            return levels(self.low, self.high, bar.bands - 1, is_round=True)
        there, back = scales(bar, self.low, self.high)
        low, high = there(np.array([self.low, self.high]))
        return back(np.linspace(low, high, (bar.bands or STEPS) + 1)[1:-1])

    @staticmethod
    def of_transfer(transfer: Transfer) -> Palette:
        """The colours of a transfer function that has its own."""
        ends = transfer.values[0], transfer.values[-1]
        return Palette(_between(np.array(transfer.values), np.array(transfer.colors, np.float64), ends), *ends)

    def steps(self, values: Floats) -> NDArray[np.uint16]:
        """Steps (…) of values (…): finite values beyond the range take the last one there, all others their number."""
        if self.edges is not None:
            found = np.searchsorted(self.edges, values, side="right")
            return np.where(np.isfinite(values), found, len(self.table)).astype(np.uint16)
        span = self.high - self.low
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = (values - self.low) * (STEPS / span if span > 0 else 0.0)
        np.clip(scaled, 0, STEPS - 1, out=scaled)
        np.copyto(scaled, STEPS, where=~np.isfinite(values))
        return scaled.astype(np.uint16)

    def colors(self, values: Floats) -> Floats:
        """Colours (…, 3) in [0, 1] of values (…)."""
        return np.vstack([self.table, NOT_A_NUMBER]).take(self.steps(values), axis=0)


def ticks(low: float, high: float, most: int, is_whole: bool = False) -> list[float]:
    """Round values in [low, high], at most ``most``: steps of 1, 2 or 5 times a power of ten.

    The two ends where the range is too narrow for such steps.
    is_whole  whether values are whole numbers: steps are at least 1
    """
    low = float(low)
    high = float(high)
    span = high - low
    narrowest = max(1e-12 * max(abs(low), abs(high)), 1e-300)
    if not narrowest < span < 1e301:
        return [low, high]

    # the shortest step with few enough multiples in the range
    power = 10.0 ** np.floor(np.log10(span / max(most, 1)))
    if is_whole:
        power = max(power, 1.0)
    for factor in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0):
        step = power * factor
        first = int(np.ceil(low / step - 1e-9))
        last = int(np.floor(high / step + 1e-9))
        if last - first < most:
            break
    return [number * step for number in range(first, last + 1)]


def levels(low: float, high: float, count: int, *, is_round: bool = False) -> Floats:
    """Values that part a range, none at its ends: n evenly, or about n that are round, as ticks are."""
    if not is_round:
        return np.linspace(low, high, count + 2)[1:-1]

    # ticks of several steps, which double or are 2.5 times as long: their numbers lie on both sides of n
    most = count + np.arange(7) * (count // 4 + 1)
    found = [_inside(low, high, np.array(ticks(low, high, number))) for number in most.tolist()]
    nearest = min(found, key=lambda inside: abs(len(inside) - count))
    return nearest if len(nearest) else np.array([0.5 * (low + high)])


def _inside(low: float, high: float, values: Floats) -> Floats:
    """Evenly spaced values, but those next to an end, where a field at rest on a wall is lost in rounding."""
    margin = 0.25 * (values[1] - values[0]) if len(values) > 1 else 0.0
    return values[(values > low + margin) & (values < high - margin)]


@lru_cache(maxsize=64)
def is_diverging(name: str) -> bool:
    """Whether a colour map has two sides with a neutral colour between them, as the catalogue says."""
    return not _is_own(name) and str(_in_catalogue(name).category) == "diverging"


def _is_own(name: str) -> bool:
    """Whether a name stands for a colour map of FIRST or of a file."""
    return name in FIRST or name.lower().endswith(".xml")


@lru_cache(maxsize=64)
def _of_catalogue(name: str) -> Floats:
    """(STEPS, 3) the colours of a map of the cmap catalogue, which takes its time to make them."""
    return frozen_floats(_in_catalogue(name).lut(STEPS)[:, :3])


def _in_catalogue(name: str) -> Colormap:
    """A map of the cmap catalogue; SceneError where it has none of this name."""
    import cmap

    # a plain name stands for matplotlib's map where several collections have one
    logging.getLogger("cmap").setLevel(logging.ERROR)
    try:
        return cmap.Colormap(ALIASES.get(name, name))
    except (ValueError, TypeError) as error:
        meant = perhaps(name, [*cmap.Colormap.catalog(), *FIRST, *ALIASES])
        known = ", ".join(("viridis", "magma", "turbo", "coolwarm", "RdBu_r", "gray", *FIRST, *ALIASES))
        raise SceneError(
            f"unknown colour map {name!r}{meant}: expected an .xml file or a name of the cmap catalogue, e.g. {known}"
        ) from error


def linear_part(bar: ColorBar, low: float, high: float) -> float:
    """Up to which size values are spread evenly on a symmetric logarithmic scale."""
    return bar.linear or 1e-3 * max(abs(low), abs(high)) or 1.0


def scales(bar: ColorBar, low: float, high: float) -> tuple[Change, Change]:
    """Function from the values (k,) of a range to a scale linear in colour, and its inverse."""
    if bar.scale == "log":
        return np.log, np.exp
    if bar.scale == "linear":
        return np.asarray, np.asarray
    part = linear_part(bar, low, high)

    # even up to the linear part, which has the room of a power of ten, as matplotlib has it
    room = 1.0 / (1.0 - 0.1)

    def there(values: Floats) -> Floats:
        size = np.abs(values)
        far = room + np.log10(np.maximum(size / part, 1.0))
        return np.asarray(np.where(size <= part, room * values / part, np.sign(values) * far))

    def back(places: Floats) -> Floats:
        far = part * 10.0 ** (np.abs(places) - room)
        return np.asarray(np.where(np.abs(places) <= room, places * part / room, np.sign(places) * far))

    return there, back


def _between(places: Floats, colors: Floats, ends: tuple[float, float]) -> Floats:
    """(STEPS, 3) colours in equal steps between two places, from those (k, 3) at some places (k,)."""
    steps = np.linspace(*ends, STEPS)
    return np.stack([np.interp(steps, places, part) for part in colors.T], axis=1)


def points_in(file: str) -> list[tuple[float, ...]]:
    """Places in [0, 1] and colours there of a colour map in the layout of the first ElVis, which is ParaView's.

    ``<ColorMap space="RGB"><Point x="0" r="0" g="0" b="1"/>…``: opacities (o) and the colour of NaN are not taken over;
    places beyond [0, 1] are scaled to it.  SceneError for anything else; documents with a DTD aren't read at all.
    """
    from xml.etree import ElementTree

    check_plain(file)
    try:
        with open(file, encoding="utf-8") as stream:
            text = stream.read(LARGEST + 1)
        if len(text) > LARGEST or "<!DOCTYPE" in text:
            raise ValueError("more than a mebibyte" if len(text) > LARGEST else "a document type declaration")
        top = ElementTree.fromstring(text)
        listed = next(top.iter("ColorMap"))
        if listed.get("space", "RGB") != "RGB":
            raise ValueError(f"the space {listed.get('space')}")
        points = np.array([[float(point.attrib[key]) for key in "xrgb"] for point in listed.iter("Point")])
    except OSError as error:
        raise SceneError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, StopIteration, ElementTree.ParseError) as error:
        reason = {KeyError: f"a point without {error}", StopIteration: "none"}.get(type(error), str(error))
        raise SceneError(f"{file}: expected a ColorMap of RGB points in XML, found {reason}") from error
    good = len(points) > 1 and (np.diff(points[:, 0]) >= 0).all() and np.ptp(points[:, 0]) > 0
    if not (good and np.isfinite(points).all() and (points[:, 1:] >= 0).all() and (points[:, 1:] <= 1).all()):
        raise SceneError(
            f"{file}: expected points of ascending x with r, g, b from 0 to 1, found {len(points)} that aren't"
        )
    first, last = points[0, 0], points[-1, 0]
    if first < 0 or last > 1:
        points[:, 0] = (points[:, 0] - first) / (last - first)
    return [tuple(map(float, point)) for point in points]


def automatic_range(values: ArrayLike, palette: str | None = None) -> tuple[float, float]:
    """Minimum and maximum finite value; (0, 1) without finite values; for a constant, 50 % below and above it.

    Values that differ only by rounding, by less than CONSTANT of their size, count as constant.

    palette  name of a colour map; the range of a diverging one has zero in its middle if values lie on both sides of it
    """
    every = np.asarray(values, np.float64)
    finite = every[np.isfinite(every)]
    if not len(finite):
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high))
    if is_constant(low, high):
        return low - (0.5 * size or 1.0), high + (0.5 * size or 1.0)
    if palette is not None and low < 0.0 < high and is_diverging(palette):
        return -size, size
    return low, high


def text_color_on(background: Vector) -> Vector:
    """A dark or light colour that can be read on a background."""
    red, green, blue = background
    dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.4
    return (0.92, 0.92, 0.92) if dark else (30 / 255, 30 / 255, 30 / 255)


def is_constant(low: float, high: float) -> bool:
    """Whether values between two bounds differ only by rounding."""
    # numbers of Python give no warning for infinite bounds
    low, high = float(low), float(high)
    return high - low <= CONSTANT * max(abs(low), abs(high))
