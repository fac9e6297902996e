"""How surfaces look: colours, contours, mesh lines, opacity and light, as settings."""

from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Literal

from elvis.scene.convolution import Lic
from elvis.scene.settings import Model, PaletteName, Quantity, Setting, check
from elvis.scene.surfaces import Vector

#: what is the same for all colours
COLOR: dict[str, Any] = {
    "ge": 0,
    "le": 1,
    "expected": "red, green and blue from 0 to 1",
    "metavar": "COLOR",
    "parse": "color",
}
POSITIVE: dict[str, Any] = {"gt": 0, "expected": "a positive number"}


def check_range(ends: tuple[float, float] | None) -> None:
    """SceneError unless the range is None or ascends."""
    good = ends is None or (-inf < ends[0] < ends[1] < inf)
    found = ends and f"{ends[0]:g} to {ends[1]:g}"
    check(good, "range", "a colour range from a smaller to a greater value", found)


@dataclass(frozen=True, repr=False)
class Contours(Model, of="contours"):
    """Lines of equal value on a surface: of some values, or this many."""

    values: Annotated[tuple[float, ...], Setting("The values.", finite=True, expected="finite numbers")] = ()
    count: Annotated[
        int | None, Setting("Number of lines, evenly between the ends of the colour range.", ge=1, le=1000)
    ] = None
    width: Annotated[float, Setting("Line width in pixels.", **POSITIVE)] = 1.5
    color: Annotated[Vector, Setting("Line colour.", **COLOR)] = (0.0, 0.0, 0.0)
    quantity: Annotated[Quantity | None, Setting("What the lines are of.", default="that of the style")] = None
    labels: Annotated[bool, Setting("Whether the lines tell their values.")] = False

    def check(self) -> None:
        """SceneError unless there are either values or a count."""
        check(len(self.values) or self.count is not None, "contours", "values or a count", "neither")
        check(not len(self.values) or self.count is None, "contours", "values or a count", "both")


@dataclass(frozen=True, repr=False)
class MeshLines(Model, of="mesh lines"):
    """The borders of elements on a surface."""

    width: Annotated[float, Setting("Line width in pixels.", **POSITIVE)] = 1.0
    color: Annotated[Vector, Setting("Line colour.", **COLOR)] = (0.25, 0.25, 0.25)


@dataclass(frozen=True, repr=False)
class ColorBar(Model, of="a colour bar"):
    """How the colours of a colour map are spread over values, and the bar that tells it."""

    title: Annotated[
        str | None, Setting("Its title, with mathematics between dollars.", default="the name of the quantity")
    ] = None
    unit: Annotated[str | None, Setting("The unit of the values, after the title.")] = None
    scale: Annotated[
        Literal["linear", "log", "symlog"],
        Setting("How colours go with values: evenly, by the logarithm, by the logarithm on both sides of zero."),
    ] = "linear"
    linear: Annotated[
        float | None,
        Setting(
            "Of symlog: values nearer to zero than this are spread evenly.",
            **POSITIVE,
            default="a thousandth of the greatest value",
        ),
    ] = None
    bands: Annotated[int | None, Setting("So many colours, each for a band of values.", ge=2, le=256)] = None
    ticks: Annotated[
        tuple[float, ...],
        Setting("Values that are marked.", finite=True, expected="finite numbers", default="round ones"),
    ] = ()
    position: Annotated[
        Literal["right", "left", "top", "bottom", "none"], Setting("Where it stands beside the picture.")
    ] = "right"

    def check(self) -> None:
        """SceneError for a scale or a place that there is not."""
        check(self.scale in ("linear", "log", "symlog"), "scale of a colour bar", "linear, log or symlog", self.scale)
        places = ("right", "left", "top", "bottom", "none")
        check(self.position in places, "position of a colour bar", " or ".join(places), self.position)


@dataclass(frozen=True, repr=False)
class Style(Model):
    """How an object looks.  Options of the command line set the style of every object."""

    quantity: Annotated[Quantity | None, Setting("What colours it.", default="the scene's field")] = None
    color: Annotated[
        Vector | None,
        Setting(
            "One colour in place of the colour map.",
            option="--color",
            option_help="One colour for all objects.",
            default="the colour map",
            **COLOR,
        ),
    ] = None
    palette: Annotated[PaletteName | None, Setting("Its colour map.", default="the scene's")] = None
    range: Annotated[
        tuple[float, float] | None, Setting("Values at the ends of its colour map.", default="the scene's")
    ] = None
    bar: Annotated[ColorBar | None, Setting("The bar of its colour map.", default="the scene's")] = None
    opacity: Annotated[
        float, Setting("Opacity.", gt=0, le=1, option="--opacity", option_help="Opacity of all objects.")
    ] = 1.0
    lit: Annotated[
        bool | None,
        Setting(
            "Whether lights shade it.",
            option="--lit/--unlit",
            option_help="Shade all objects by the lights, or don't.",
            default="faces, isosurfaces, tubes and glyphs are shaded",
        ),
    ] = None
    contours: Annotated[
        Contours | None,
        Setting(
            "Lines of equal value on it.",
            option="--contours",
            metavar="N|V,V[:labels]",
            parse="contours",
            option_help="N contour lines, or those of values, with these beside them.",
        ),
    ] = None
    mesh_lines: Annotated[
        MeshLines | None,
        Setting("The borders of elements on it.", option="--mesh-lines", option_help="Draw the borders of elements."),
    ] = None
    lic: Annotated[
        Lic | None, Setting("Streaks along a velocity on surfaces: line integral convolution.", option="--lic")
    ] = None

    @property
    def on_surfaces(self) -> bool:
        """Whether it has what is drawn on surfaces alone."""
        return any(part is not None for part in (self.contours, self.mesh_lines, self.lic))

    def check(self) -> None:
        """SceneError where the range doesn't ascend."""
        check_range(self.range)
