"""Values to colours; the one piece of picture-making that renderer and reference share."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Floats
from elvis.core.files.plain import check_plain
from elvis.scene import Transfer
from elvis.scene.errors import SceneError

#: colour of what is seen but is not a finite number
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
    """A colour map in equal steps: ``table`` (STEPS, 3) in [0, 1], for values from ``low`` to ``high``."""

    table: Floats
    low: float
    high: float

    @staticmethod
    def named(name: str, low: float, high: float) -> Palette:
        """The colour map that the cmap catalogue, or FIRST, calls ``name``, or of an .xml file; SceneError else."""
        if name in FIRST or name.lower().endswith(".xml"):
            places = np.array(FIRST.get(name) or points_in(name))
            return Palette(_between(places[:, 0], places[:, 1:], (0.0, 1.0)), low, high)
        import cmap

        # a plain name stands for matplotlib's map where several collections have one
        logging.getLogger("cmap").setLevel(logging.ERROR)
        try:
            colormap = cmap.Colormap(ALIASES.get(name, name))
        except (ValueError, TypeError) as error:
            known = ", ".join(("viridis", "magma", "turbo", "coolwarm", "RdBu_r", "gray", *FIRST, *ALIASES))
            raise SceneError(
                f"unknown colour map {name!r}: expected an .xml file or a name of the cmap catalogue, e.g. {known}"
            ) from error
        return Palette(np.ascontiguousarray(colormap.lut(STEPS)[:, :3], dtype=np.float64), low, high)

    @staticmethod
    def of_transfer(transfer: Transfer) -> Palette:
        """The colours of a transfer function that has its own."""
        ends = transfer.values[0], transfer.values[-1]
        return Palette(_between(np.array(transfer.values), np.array(transfer.colors, np.float64), ends), *ends)

    def steps(self, values: Floats) -> NDArray[np.uint16]:
        """Steps (…) of values (…): finite values beyond the range take the last one there, all others STEPS."""
        span = self.high - self.low
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = (values - self.low) * (STEPS / span if span > 0 else 0.0)
        np.clip(scaled, 0, STEPS - 1, out=scaled)
        np.copyto(scaled, STEPS, where=~np.isfinite(values))
        return scaled.astype(np.uint16)

    def colors(self, values: Floats) -> Floats:
        """Colours (…, 3) in [0, 1] of values (…)."""
        return np.vstack([self.table, NOT_A_NUMBER]).take(self.steps(values), axis=0)


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


def automatic_range(values: Floats) -> tuple[float, float]:
    """Least and greatest finite value; (0, 1) where there is none; half as much and half as much again of a constant.

    A constant is also what varies by rounding alone, by less than CONSTANT of its size.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high))
    if high - low <= CONSTANT * size:
        return low - (0.5 * size or 1.0), high + (0.5 * size or 1.0)
    return low, high
