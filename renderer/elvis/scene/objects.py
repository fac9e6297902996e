"""What a scene shows: cut surfaces, faces, isosurfaces, volumes, streamlines, glyphs."""

from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite
from typing import Annotated, ClassVar, Literal, TypeAlias

from elvis.core.seed_forms import FORMS
from elvis.scene.settings import Components, Model, Quantity, Seeds, Setting, check
from elvis.scene.style import COLOR, POSITIVE, Style
from elvis.scene.surfaces import Surface, Vector


@dataclass(frozen=True, repr=False)
class CutSurface(Model, of="a cut"):
    """What a surface meets of the volume."""

    surface: Annotated[Surface, Setting("The surface.")]
    style: Annotated[Style, Setting("How it looks.")] = field(default_factory=Style)
    kind: Literal["cut"] = field(default="cut", kw_only=True)
    option: ClassVar = Setting(
        "A surface that cuts 3D data: plane:POINT:NORMAL, sphere:CENTER:RADIUS, cylinder:POINT:AXIS:RADIUS, "
        "cone:APEX:AXIS:DEGREES, mesh:FILE, implicit:EXPRESSION.",
        option="--cut",
        metavar="SURFACE",
        parse="cut",
        repeatable=True,
    )


@dataclass(frozen=True, repr=False)
class Faces(Model, of="faces"):
    """Element faces."""

    select: Annotated[
        tuple[str, ...],
        Setting(
            "Any of: all (the outer faces), inner (those between elements), the name or id of a boundary or composite, "
            "element:ID, shape:NAME and region:NAME (every face of these elements)."
        ),
    ] = ("all",)
    style: Annotated[Style, Setting("How they look.")] = field(default_factory=Style)
    kind: Literal["faces"] = field(default="faces", kw_only=True)
    option: ClassVar = Setting(
        "Element faces: any of all, inner, a boundary's name, element:ID, shape:NAME, region:NAME.",
        option="--faces",
        metavar="NAMES",
        parse="faces",
        repeatable=True,
    )

    def check(self) -> None:
        """SceneError where nothing is selected."""
        check(self.select, "select of faces", "all, names of boundaries or elements", "none")


@dataclass(frozen=True, repr=False)
class Isosurface(Model, of="an isosurface"):
    """Where a quantity has one of the values; the quantity of its style, by default the scene's field, colours it."""

    values: Annotated[tuple[float, ...], Setting("The values.", finite=True, expected="finite numbers")]
    quantity: Annotated[Quantity | None, Setting("What has the values.", default="the scene's field")] = None
    style: Annotated[Style, Setting("How it looks.")] = field(default_factory=Style)
    kind: Literal["isosurface"] = field(default="isosurface", kw_only=True)
    option: ClassVar = Setting(
        "Isosurface(s) of quantity Q at value(s) V; Q defaults to --field.",
        option="--isosurface",
        metavar="[Q=]V,V",
        parse="isosurface",
        repeatable=True,
    )

    def check(self) -> None:
        """SceneError where there is no value."""
        check(len(self.values), "values of an isosurface", "at least one", "none")


@dataclass(frozen=True, repr=False)
class Transfer(Model, of="a transfer function"):
    """A piecewise linear transfer function; beyond the first and last value its ends hold."""

    values: Annotated[tuple[float, ...], Setting("(k,) ascending values of the quantity.")]
    densities: Annotated[
        tuple[float, ...],
        Setting(
            "(k,) extinction per world unit of length.", ge=0, expected="a finite number of 0 or more for each value"
        ),
    ]
    colors: Annotated[
        tuple[Vector, ...], Setting("(k,) colours.", ge=0, le=1, expected=COLOR["expected"], default="the colour map")
    ] = ()

    def check(self) -> None:
        """SceneError unless values ascend and all have a density."""
        ascending = all(isfinite(value) for value in self.values) and all(a < b for a, b in pairwise(self.values))
        check(len(self.values) and ascending, f"values{self.noun}", "ascending finite numbers", self.values)
        is_complete = len(self.densities) == len(self.values)
        check(is_complete, f"densities{self.noun}", "a finite number of 0 or more for each value", self.densities)
        enough = len(self.colors) in (0, len(self.values))
        check(enough, f"colors{self.noun}", f"none or {len(self.values)}", len(self.colors))


@dataclass(frozen=True, repr=False)
class VolumeRendering(Model, of="a volume"):
    """Light that the volume emits and absorbs along each ray."""

    transfer: Annotated[Transfer, Setting("Extinction and colour by the values of the quantity.")]
    quantity: Annotated[Quantity | None, Setting("What is shown.", default="the scene's field")] = None
    error: Annotated[float, Setting("Greatest error of a pixel's colour that the quadrature aims at.", **POSITIVE)] = (
        1e-3
    )
    kind: Literal["volume"] = field(default="volume", kw_only=True)
    option: ClassVar = Setting(
        "Volume rendering: piecewise linear transfer function, extinction D at value V of quantity Q.",
        option="--volume",
        metavar="[Q=]V:D,V:D",
        parse="volume",
        repeatable=True,
    )


@dataclass(frozen=True, repr=False)
class Streamlines(Model, of="streamlines"):
    """Lines along a velocity, as tubes or ribbons exact to the pixel, without contours, mesh lines and lic."""

    seeds: Annotated[
        tuple[Seeds, ...],
        Setting(
            f"Where lines begin: {'; '.join(FORMS.values())} (boundaries: N each way on every face); or a table of "
            "points.",
            metavar="WHAT",
            repeatable=True,
        ),
    ] = ()
    velocity: Components = None
    direction: Annotated[
        Literal["forward", "backward", "both"],
        Setting(
            "With the stream, against it, or both.",
            names=("forward", "backward", "both"),
            metavar="forward|backward|both",
        ),
    ] = "forward"
    length: Annotated[
        float | None, Setting("Greatest length of a line.", **POSITIVE, default="10 diagonals of the box")
    ] = None
    duration: Annotated[float | None, Setting("Greatest time along a line.", **POSITIVE)] = None
    speed: Annotated[float, Setting("Lines that become slower end.", ge=0, default="those at rest")] = 0.0
    steps: Annotated[int, Setting("Steps of a line at most.", ge=1)] = 10_000
    tolerance: Annotated[
        float | None, Setting("Error of a step in units of length.", **POSITIVE, default="1e-12 diagonals")
    ] = None
    random: Annotated[int, Setting("Number that random seeds are drawn with.", ge=0)] = 0
    wall: Annotated[
        str | None,
        Setting(
            "A boundary on which lines follow the wall shear, or the velocity where one is given: skin friction lines.",
            metavar="NAME",
            default="lines in elements",
        ),
    ] = None
    radius: Annotated[
        float | None,
        Setting("Radius of the tubes in world units.", **POSITIVE, default="0.003 diagonals of the box"),
    ] = None
    width: Annotated[
        float | None, Setting("In place of a radius the width of lines in pixels, at any depth.", **POSITIVE)
    ] = None
    ribbon: Annotated[
        float | None,
        Setting("In place of tubes the width, in world units, of ribbons that turn with the flow.", **POSITIVE),
    ] = None
    across: Annotated[
        Vector | None,
        Setting(
            "Of ribbons: the direction of their width where lines begin.",
            metavar="X,Y,Z",
            default="the axis that lines are least along there",
        ),
    ] = None
    arrows: Annotated[
        float | None, Setting("Cones that point with the flow, this far apart along lines.", **POSITIVE)
    ] = None
    arrows_by: Annotated[
        Literal["length", "time"], Setting("Whether that is a length or a time.", names=("length", "time"))
    ] = "length"
    arrow_length: Annotated[
        float | None,
        Setting(
            "Length of these cones in world units.",
            **POSITIVE,
            default="8 radii, 0.6 widths of a ribbon, 0.02 diagonals beside a width in pixels",
        ),
    ] = None
    since: Annotated[
        float | None,
        Setting(
            "In place of streamlines the paths of particles that seeds released at this time of a series, up to that "
            "of the picture.",
        ),
    ] = None
    releases: Annotated[
        int | None,
        Setting(
            "With since: in place of paths balls where the particles are that each seed has released at so many even "
            "steps of time: streaks, as dye makes them.",
            ge=2,
        ),
    ] = None
    cores: Annotated[
        Literal["acceleration", "vorticity"] | None,
        Setting(
            "In place of lines from seeds: the cores of all vortices, where the velocity is parallel to this.",
            names=("acceleration", "vorticity"),
            metavar="acceleration|vorticity",
        ),
    ] = None
    along: Annotated[
        str | None,
        Setting(
            "In place of lines from seeds: a curve on a wall, boundary:NAME of 2D data, or section:NAME:plane:P:N, "
            "where a plane cuts a boundary of 3D data.",
            metavar="CURVE",
        ),
    ] = None
    least_swirl: Annotated[float, Setting("Of cores: how fast the flow turns at least, in radians by time.", ge=0)] = (
        0.0
    )
    least_length: Annotated[float, Setting("Of cores: how long they are at least.", ge=0)] = 0.0
    style: Annotated[Style, Setting("How they look.")] = field(default_factory=Style)
    kind: Literal["streamlines"] = field(default="streamlines", kw_only=True)
    option: ClassVar = Setting(
        f"Streamlines from seeds: {'; '.join(FORMS.values())}; a table of points; after semicolons other keys, such as "
        "radius=0.01 or direction=both; cores=acceleration in place of seeds: the cores of all vortices, "
        "along=section:NAME:plane:P:N: where a plane cuts a boundary.",
        option="--streamlines",
        metavar="SEEDS[;KEY=VALUE]",
        parse="streamlines",
        repeatable=True,
    )

    def check(self) -> None:
        """SceneError where nothing says where lines begin, for a direction that there is not, and for two sizes."""
        check(len(self.seeds) or self.cores or self.along, "seeds of streamlines", "at least one", "none")
        directions = ("forward", "backward", "both")
        check(self.direction in directions, "direction of streamlines", " or ".join(directions), self.direction)
        sizes = [name for name in ("radius", "width", "ribbon") if getattr(self, name) is not None]
        check(len(sizes) < 2, "streamlines", "a radius, a width or a ribbon", " and ".join(sizes))
        check(self.across is None or any(self.across), "across of streamlines", "a direction", "zero")
        check(self.across is None or self.ribbon, "across of streamlines", "the width of a ribbon, too", "none")
        check(self.arrows_by in ("length", "time"), "arrows_by of streamlines", "length or time", self.arrows_by)
        alone = self.arrow_length is None and self.arrows_by == "length"
        check(self.arrows or alone, "arrows of streamlines", "how far apart they are", "nothing")
        check(self.wall is None or not self.ribbon, "ribbons", "lines in elements", f"lines on the wall {self.wall}")
        others = self.wall, self.ribbon, self.duration, self.arrows
        is_plain = self.direction == "forward" and all(own is None for own in others)
        check(
            self.since is None or is_plain, "since", "no wall, ribbon, arrows, duration and direction with it", "some"
        )
        check(self.releases is None or self.since is not None, "releases", "since with it", "none")
        self._check_cores()
        check(not self.style.on_surfaces, "style of streamlines", "no contours, no mesh lines and no lic", "some")

    def _check_cores(self) -> None:
        """SceneError where settings of lines from seeds are given of cores, or those of cores without."""
        if self.cores is None:
            alone = not self.least_swirl and not self.least_length
            check(alone, "streamlines", "cores with least_swirl and least_length", "none")
            if self.along is not None:
                self._check_no_seeds("along")
                check(self.velocity is None, "along of streamlines", "no velocity", self.velocity)
            return
        check(self.along is None, "cores of streamlines", "no curve along a wall", "some")
        self._check_no_seeds("cores")

    def _check_no_seeds(self, kind: str) -> None:
        """SceneError for settings of lines from seeds, beside what is in place of them."""
        default = Streamlines(("",))
        followed = (
            "direction",
            "length",
            "duration",
            "speed",
            "steps",
            "tolerance",
            "wall",
            "ribbon",
            "arrows",
            "since",
        )
        given = [name for name in followed if getattr(self, name) != getattr(default, name)]
        given += ["seeds"] if self.seeds else []
        check(not given, f"{kind} of streamlines", "no settings of lines from seeds", ", ".join(given))


@dataclass(frozen=True, repr=False)
class Glyphs(Model, of="glyphs"):
    """Arrows or cones along a vector, from exact points; they have no contours, no mesh lines and no lic."""

    points: Annotated[
        tuple[Seeds, ...],
        Setting(
            f"Where they begin: {'; '.join(FORMS.values())} (boundaries: N each way on every face); or a table of "
            "points.",
            metavar="WHAT",
            repeatable=True,
        ),
    ]
    vector: Annotated[
        Quantity | None,
        Setting(
            "Its components, any quantities, with commas between them.",
            metavar="U,V,W",
            default="the velocity: u,v,w, rhou/rho, … as named",
        ),
    ] = None
    random: Annotated[int, Setting("Number that random points are drawn with.", ge=0)] = 0
    shape: Annotated[Literal["arrow", "cone"], Setting("What is drawn.")] = "arrow"
    lengths: Annotated[
        Literal["magnitude", "equal"], Setting("Whether lengths go with the magnitude of the vector, or are equal.")
    ] = "magnitude"
    length: Annotated[
        float | None,
        Setting("Length in world units, of the magnitude below.", **POSITIVE, default="0.05 diagonals of the box"),
    ] = None
    magnitude: Annotated[
        float | None, Setting("The magnitude that has this length.", **POSITIVE, default="the greatest at the points")
    ] = None
    thickness: Annotated[
        float, Setting("Greatest radius in parts of the length.", gt=0, le=0.3, expected="a number from 0 to 0.3")
    ] = 0.12
    key: Annotated[bool, Setting("Whether a glyph of a round magnitude below the picture tells how long they are.")] = (
        True
    )
    unit: Annotated[str | None, Setting("The unit of the magnitude, in the key.")] = None
    style: Annotated[Style, Setting("How they look.")] = field(default_factory=Style)
    kind: Literal["glyphs"] = field(default="glyphs", kw_only=True)
    option: ClassVar = Setting(
        f"Arrows at points: {'; '.join(FORMS.values())}; a table of points; after semicolons other keys, such as "
        "length=0.1 or shape=cone.",
        option="--glyphs",
        metavar="POINTS[;KEY=VALUE]",
        parse="glyphs",
        repeatable=True,
    )

    def check(self) -> None:
        """SceneError where nothing says where they stand, and for a shape or lengths that there are not."""
        check(len(self.points), "points of glyphs", "at least one", "none")
        check(self.shape in ("arrow", "cone"), "shape of glyphs", "arrow or cone", self.shape)
        check(self.lengths in ("magnitude", "equal"), "lengths of glyphs", "magnitude or equal", self.lengths)
        check(not self.style.on_surfaces, "style of glyphs", "no contours, no mesh lines and no lic", "some")


SceneObject: TypeAlias = CutSurface | Faces | Isosurface | VolumeRendering | Streamlines | Glyphs
