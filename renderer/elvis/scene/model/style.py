"""How surfaces look: colours, contours, mesh lines, opacity and light, as settings."""

from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Literal

from elvis.scene.model.convolution import Lic
from elvis.scene.model.settings import Model, PaletteName, Quantity, Setting, check
from elvis.scene.model.surfaces import Vector

#: common settings of all colours
COLOR: dict[str, Any] = {
    "ge": 0,
    "le": 1,
    "expected": "red, green and blue from 0 to 1",
    "metavar": "COLOR",
    "parse": "color",
}
POSITIVE: dict[str, Any] = {"gt": 0, "expected": "a positive number"}


def check_range(ends: tuple[float, float] | None) -> None:
    """Raise SceneError unless the range is None or ascends."""
    good = ends is None or (-inf < ends[0] < ends[1] < inf)
    found = ends and f"{ends[0]:g} to {ends[1]:g}"
    check(good, "range", "a colour range from a smaller to a greater value", found)


@dataclass(frozen=True, repr=False)
class Contours(Model, of="contours"):
    """Lines of equal value on a surface, either at given values or a given number of lines."""

    values: Annotated[tuple[float, ...], Setting("Values of the lines.", finite=True, expected="finite numbers")] = ()
    count: Annotated[int | None, Setting("Number of lines between the ends of the colour range.", ge=1, le=1000)] = None
    width: Annotated[float, Setting("Line width in pixels.", **POSITIVE)] = 1.5
    color: Annotated[Vector, Setting("Line colour.", **COLOR)] = (0.0, 0.0, 0.0)
    quantity: Annotated[Quantity | None, Setting("Quantity of the lines.", default="that of the style")] = None
    labels: Annotated[bool, Setting("Whether the lines are labelled with their values.")] = False
    round: Annotated[
        bool,
        Setting(
            "Whether a count of lines lies at round values, as ticks do: there are about so many, else exactly, evenly."
        ),
    ] = True

    def check(self) -> None:
        """Raise SceneError unless there are either values or a count."""
        check(len(self.values) or self.count is not None, "contours", "values or a count", "neither")
        check(not len(self.values) or self.count is None, "contours", "values or a count", "both")


@dataclass(frozen=True, repr=False)
class MeshLines(Model, of="mesh lines"):
    """Borders of elements on a surface."""

    width: Annotated[float, Setting("Line width in pixels.", **POSITIVE)] = 1.0
    color: Annotated[Vector, Setting("Line colour.", **COLOR)] = (0.25, 0.25, 0.25)


@dataclass(frozen=True, repr=False)
class ColorBar(Model, of="a colour bar"):
    """Scale of a colour map, and the bar that shows it."""

    title: Annotated[
        str | None, Setting("Title, with mathematics between dollar signs.", default="the name of the quantity")
    ] = None
    unit: Annotated[str | None, Setting("Unit of the values, written after the title.")] = None
    scale: Annotated[
        Literal["linear", "log", "symlog"],
        Setting("Scale of the colours: linear, logarithmic, or logarithmic on both sides of zero."),
    ] = "linear"
    linear: Annotated[
        float | None,
        Setting(
            "Half-width of the linear part around zero, for symlog.",
            **POSITIVE,
            default="a thousandth of the maximum magnitude",
        ),
    ] = None
    bands: Annotated[int | None, Setting("Number of discrete colours, each for a band of values.", ge=2, le=256)] = None
    round: Annotated[
        bool,
        Setting(
            "Whether bands of a linear scale end at round values, as ticks do: there are about so many, else exactly."
        ),
    ] = True
    ticks: Annotated[
        tuple[float, ...],
        Setting("Values of the ticks.", finite=True, expected="finite numbers", default="round values"),
    ] = ()
    position: Annotated[
        Literal["right", "left", "top", "bottom", "none"], Setting("Position of the bar relative to the picture.")
    ] = "right"

    def check(self) -> None:
        """Raise SceneError for an unknown scale or position."""
        check(self.scale in ("linear", "log", "symlog"), "scale of a colour bar", "linear, log or symlog", self.scale)
        places = ("right", "left", "top", "bottom", "none")
        check(self.position in places, "position of a colour bar", " or ".join(places), self.position)


@dataclass(frozen=True, repr=False)
class Style(Model):
    """Appearance of an object.  Options of the command line set the style of every object."""

    quantity: Annotated[Quantity | None, Setting("Quantity that colours the object.", default="the scene's field")] = (
        None
    )
    color: Annotated[
        Vector | None,
        Setting(
            "Single colour instead of the colour map.",
            option="--color",
            option_help="Single colour for all objects.",
            default="the colour map",
            **COLOR,
        ),
    ] = None
    palette: Annotated[PaletteName | None, Setting("Colour map of the object.", default="the scene's")] = None
    range: Annotated[
        tuple[float, float] | None, Setting("Values at the ends of the colour map.", default="the scene's")
    ] = None
    bar: Annotated[ColorBar | None, Setting("Colour bar of the object.", default="the scene's")] = None
    opacity: Annotated[
        float,
        Setting("Opacity of the object.", gt=0, le=1, option="--opacity", option_help="Opacity of all objects."),
    ] = 1.0
    lit: Annotated[
        bool | None,
        Setting(
            "Whether the lights shade the object.",
            option="--lit/--unlit",
            option_help="Shade all objects with the lights, or none.",
            default="faces, isosurfaces, tubes and glyphs are shaded",
        ),
    ] = None
    contours: Annotated[
        Contours | None,
        Setting(
            "Lines of equal value on the surface.",
            option="--contours",
            metavar="N|V,V[:…]",
            parse="contours",
            option_help="About N contour lines at round values (N:even: exactly N), or given ones; :labels: values.",
        ),
    ] = None
    mesh_lines: Annotated[
        MeshLines | None,
        Setting(
            "Borders of elements on the surface.", option="--mesh-lines", option_help="Draw the borders of elements."
        ),
    ] = None
    lic: Annotated[
        Lic | None, Setting("Line integral convolution: streaks along the velocity on surfaces.", option="--lic")
    ] = None

    @property
    def on_surfaces(self) -> bool:
        """Whether it has a setting that applies only to surfaces."""
        return any(part is not None for part in (self.contours, self.mesh_lines, self.lic))

    def check(self) -> None:
        """Raise SceneError if the range isn't ascending."""
        check_range(self.range)
