"""Objects of a scene: cut surfaces, faces, isosurfaces, volumes, streamlines, glyphs."""

from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite
from typing import Annotated, ClassVar, Literal, TypeAlias

from elvis.core.streamlines.seed_forms import FORMS
from elvis.scene.model.settings import Components, Model, Quantity, Seeds, Setting, check
from elvis.scene.model.style import COLOR, POSITIVE, Style
from elvis.scene.model.surfaces import Surface, Vector


@dataclass(frozen=True, repr=False)
class CutSurface(Model, of="a cut"):
    """The intersection of the volume with a surface."""

    surface: Annotated[Surface, Setting("Surface that cuts the volume.")]
    style: Annotated[Style, Setting("Appearance of the cut.")] = field(default_factory=Style)
    kind: Literal["cut"] = field(default="cut", kw_only=True)
    option: ClassVar = Setting(
        "Surface that cuts 3D data, such as sphere:0,0,0:0.5 or mesh:FILE (see elvis help geometry).",
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
            "Faces to draw, any of: all (outer faces), inner (faces between elements), the name or id of a boundary or "
            "composite, element:ID, shape:NAME and region:NAME (all faces of these elements)."
        ),
    ] = ("all",)
    style: Annotated[Style, Setting("Appearance of the faces.")] = field(default_factory=Style)
    kind: Literal["faces"] = field(default="faces", kw_only=True)
    option: ClassVar = Setting(
        "Element faces: all (outer), inner, names of boundaries, element:ID, shape:NAME, region:NAME.",
        option="--faces",
        metavar="NAMES",
        parse="faces",
        repeatable=True,
    )

    def check(self) -> None:
        """Raise SceneError if nothing is selected."""
        check(self.select, "select of faces", "all, names of boundaries or elements", "none")


@dataclass(frozen=True, repr=False)
class Isosurface(Model, of="an isosurface"):
    """Isosurfaces of a quantity, coloured by the quantity of the style, which defaults to the scene's field."""

    values: Annotated[tuple[float, ...], Setting("Values of the surfaces.", finite=True, expected="finite numbers")]
    quantity: Annotated[
        Quantity | None, Setting("Quantity that defines the surfaces.", default="the scene's field")
    ] = None
    style: Annotated[Style, Setting("Appearance of the surfaces.")] = field(default_factory=Style)
    kind: Literal["isosurface"] = field(default="isosurface", kw_only=True)
    option: ClassVar = Setting(
        "Isosurface(s) of quantity Q at value(s) V; Q defaults to --field.",
        option="--isosurface",
        metavar="[Q=]V,V",
        parse="isosurface",
        repeatable=True,
    )

    def check(self) -> None:
        """Raise SceneError if there is no value."""
        check(len(self.values), "values of an isosurface", "at least one", "none")


@dataclass(frozen=True, repr=False)
class Transfer(Model, of="a transfer function"):
    """A piecewise linear transfer function, constant beyond its first and last value."""

    values: Annotated[tuple[float, ...], Setting("Ascending values (k,) of the quantity.")]
    densities: Annotated[
        tuple[float, ...],
        Setting(
            "Extinction (k,) per world unit of length.", ge=0, expected="a finite number of 0 or more for each value"
        ),
    ]
    colors: Annotated[
        tuple[Vector, ...], Setting("Colours (k,).", ge=0, le=1, expected=COLOR["expected"], default="the colour map")
    ] = ()

    def check(self) -> None:
        """Raise SceneError unless values ascend and all have a density."""
        ascending = all(isfinite(value) for value in self.values) and all(a < b for a, b in pairwise(self.values))
        check(len(self.values) and ascending, f"values{self.noun}", "ascending finite numbers", self.values)
        is_complete = len(self.densities) == len(self.values)
        check(is_complete, f"densities{self.noun}", "a finite number of 0 or more for each value", self.densities)
        enough = len(self.colors) in (0, len(self.values))
        check(enough, f"colors{self.noun}", f"none or {len(self.values)}", len(self.colors))


@dataclass(frozen=True, repr=False)
class VolumeRendering(Model, of="a volume"):
    """Volume rendering: light that the volume emits and absorbs along each ray."""

    transfer: Annotated[Transfer, Setting("Extinction and colour as functions of the quantity.")]
    quantity: Annotated[Quantity | None, Setting("Quantity that is rendered.", default="the scene's field")] = None
    error: Annotated[float, Setting("Target of the quadrature: maximum error of a pixel's colour.", **POSITIVE)] = 1e-3
    kind: Literal["volume"] = field(default="volume", kw_only=True)
    option: ClassVar = Setting(
        "Volume rendering: extinction D at value V of quantity Q, linear between.",
        option="--volume",
        metavar="[Q=]V:D,V:D",
        parse="volume",
        repeatable=True,
    )


@dataclass(frozen=True, repr=False)
class Streamlines(Model, of="streamlines"):
    """Lines along a velocity, drawn as pixel-exact tubes or ribbons, without contours, mesh lines and lic."""

    seeds: Annotated[
        tuple[Seeds, ...],
        Setting(
            f"Seeds of the lines: {'; '.join(FORMS.values())} (boundaries: N in each direction on every face); "
            "or a table of points.",
            metavar="WHAT",
            repeatable=True,
            option_help="Seeds of the lines, such as line:P:Q:20, random:200, boundary:NAME:4 or a table of points "
            "(see elvis help geometry).",
        ),
    ] = ()
    velocity: Components = None
    direction: Annotated[
        Literal["forward", "backward", "both"],
        Setting(
            "Direction along the flow: downstream (forward), upstream (backward), or both.",
            names=("forward", "backward", "both"),
            metavar="forward|backward|both",
        ),
    ] = "forward"
    length: Annotated[
        float | None, Setting("Maximum length of a line.", **POSITIVE, default="10 diagonals of the box")
    ] = None
    duration: Annotated[float | None, Setting("Maximum time along a line.", **POSITIVE)] = None
    speed: Annotated[float, Setting("Speed below which lines end.", ge=0, default="lines end at rest")] = 0.0
    steps: Annotated[int, Setting("Maximum number of steps of a line.", ge=1)] = 10_000
    tolerance: Annotated[
        float | None, Setting("Error tolerance of a step, as a length.", **POSITIVE, default="1e-12 diagonals")
    ] = None
    random: Annotated[int, Setting("Seed of the random number generator for random seeds.", ge=0)] = 0
    wall: Annotated[
        str | None,
        Setting(
            "Boundary for skin friction lines, which follow the wall shear, or the velocity if one is given.",
            metavar="NAME",
            default="lines in the domain",
        ),
    ] = None
    radius: Annotated[
        float | None,
        Setting("Radius of the tubes, in world units.", **POSITIVE, default="0.003 diagonals of the box"),
    ] = None
    width: Annotated[
        float | None, Setting("Width of the lines in pixels at any depth, instead of a radius.", **POSITIVE)
    ] = None
    ribbon: Annotated[
        float | None,
        Setting("Width of ribbons that turn with the flow, in world units, instead of tubes.", **POSITIVE),
    ] = None
    across: Annotated[
        Vector | None,
        Setting(
            "Direction of a ribbon's width at the start of its line.",
            metavar="X,Y,Z",
            default="the axis with the smallest velocity component there",
        ),
    ] = None
    arrows: Annotated[float | None, Setting("Spacing of cones that point along the flow.", **POSITIVE)] = None
    arrows_by: Annotated[
        Literal["length", "time"],
        Setting("Whether the spacing of the cones is a length or a time.", names=("length", "time")),
    ] = "length"
    arrow_length: Annotated[
        float | None,
        Setting(
            "Length of the cones, in world units.",
            **POSITIVE,
            default="8 radii of tubes, 0.6 widths of ribbons, 0.02 diagonals for lines with a width in pixels",
        ),
    ] = None
    since: Annotated[
        float | None,
        Setting(
            "Time of a series at which the seeds release particles: draws their paths up to the time of the picture, "
            "instead of streamlines.",
        ),
    ] = None
    releases: Annotated[
        int | None,
        Setting(
            "Number of particles that each seed releases at even steps of time after since: draws streaklines, as of "
            "dye, as balls at the particles, instead of paths.",
            ge=2,
        ),
    ] = None
    cores: Annotated[
        Literal["acceleration", "vorticity"] | None,
        Setting(
            "Draw the cores of all vortices instead of lines from seeds: lines on which the velocity is parallel to "
            "this vector.",
            names=("acceleration", "vorticity"),
            metavar="acceleration|vorticity",
        ),
    ] = None
    along: Annotated[
        str | None,
        Setting(
            "Draw a curve on a wall instead of lines from seeds: boundary:NAME in 2D data, or section:NAME:plane:P:N, "
            "the cut of a boundary of 3D data with a plane.",
            metavar="CURVE",
        ),
    ] = None
    min_swirl: Annotated[float, Setting("Minimum swirl rate of cores, in radians per unit of time.", ge=0)] = 0.0
    min_length: Annotated[float, Setting("Minimum length of cores.", ge=0)] = 0.0
    style: Annotated[Style, Setting("Appearance of the lines.")] = field(default_factory=Style)
    kind: Literal["streamlines"] = field(default="streamlines", kw_only=True)
    option: ClassVar = Setting(
        "Streamlines from seeds, such as line:P:Q:20 or random:100 (see elvis help geometry), or cores=acceleration "
        "for all vortex cores; other keys follow after semicolons, such as radius=0.01.",
        option="--streamlines",
        metavar="SEEDS[;KEY=VALUE]",
        parse="streamlines",
        repeatable=True,
    )

    def check(self) -> None:
        """Raise SceneError if there are no seeds, for an unknown direction, and if more than one size is given."""
        check(len(self.seeds) or self.cores or self.along, "seeds of streamlines", "at least one", "none")
        directions = ("forward", "backward", "both")
        check(self.direction in directions, "direction of streamlines", " or ".join(directions), self.direction)
        sizes = [name for name in ("radius", "width", "ribbon") if getattr(self, name) is not None]
        check(len(sizes) < 2, "streamlines", "a radius, a width or a ribbon", " and ".join(sizes))
        check(self.across is None or any(self.across), "across of streamlines", "a direction", "zero")
        check(self.across is None or self.ribbon, "across of streamlines", "also the width of a ribbon", "none")
        check(self.arrows_by in ("length", "time"), "arrows_by of streamlines", "length or time", self.arrows_by)
        alone = self.arrow_length is None and self.arrows_by == "length"
        check(self.arrows or alone, "arrows of streamlines", "their spacing", "nothing")
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
        """Raise SceneError if seeds are combined with cores, or if settings of cores are given without cores."""
        if self.cores is None:
            alone = not self.min_swirl and not self.min_length
            check(alone, "streamlines", "cores with min_swirl and min_length", "none")
            if self.along is not None:
                self._check_no_seeds("along")
                check(self.velocity is None, "along of streamlines", "no velocity", self.velocity)
            return
        check(self.along is None, "cores of streamlines", "no curve along a wall", "some")
        self._check_no_seeds("cores")

    def _check_no_seeds(self, kind: str) -> None:
        """Raise SceneError for settings of lines from seeds that are combined with a replacement of seeds."""
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
    """Arrows or cones along a vector at exact points, without contours, mesh lines and lic."""

    points: Annotated[
        tuple[Seeds, ...],
        Setting(
            f"Base points: {'; '.join(FORMS.values())} (boundaries: N in each direction on every face); "
            "or a table of points.",
            metavar="WHAT",
            repeatable=True,
        ),
    ]
    vector: Annotated[
        Quantity | None,
        Setting(
            "Components of the vector: any quantities, separated by commas.",
            metavar="U,V,W",
            default="the velocity: u,v,w, rhou/rho, … as named",
        ),
    ] = None
    random: Annotated[int, Setting("Seed of the random number generator for random points.", ge=0)] = 0
    shape: Annotated[Literal["arrow", "cone"], Setting("Shape of the glyphs.")] = "arrow"
    lengths: Annotated[
        Literal["magnitude", "equal"], Setting("Whether lengths are proportional to the magnitude, or equal.")
    ] = "magnitude"
    length: Annotated[
        float | None,
        Setting(
            "Length of a glyph of the given magnitude, in world units.", **POSITIVE, default="0.05 diagonals of the box"
        ),
    ] = None
    magnitude: Annotated[
        float | None,
        Setting("Magnitude of the vector that has this length.", **POSITIVE, default="the maximum at the points"),
    ] = None
    thickness: Annotated[
        float,
        Setting("Maximum radius, as a share of the length.", gt=0, le=0.3, expected="a number from 0 to 0.3"),
    ] = 0.12
    key: Annotated[
        bool, Setting("Whether a glyph of a round magnitude is drawn below the picture as a key to the lengths.")
    ] = True
    unit: Annotated[str | None, Setting("Unit of the magnitude, written in the key.")] = None
    style: Annotated[Style, Setting("Appearance of the glyphs.")] = field(default_factory=Style)
    kind: Literal["glyphs"] = field(default="glyphs", kw_only=True)
    option: ClassVar = Setting(
        "Arrows at points, such as plane:P:N:30 or a table (see elvis help geometry); other keys follow after "
        "semicolons, such as length=0.1 or shape=cone.",
        option="--glyphs",
        metavar="POINTS[;KEY=VALUE]",
        parse="glyphs",
        repeatable=True,
    )

    def check(self) -> None:
        """Raise SceneError if there are no points, and for an unknown shape or an unknown kind of lengths."""
        check(len(self.points), "points of glyphs", "at least one", "none")
        check(self.shape in ("arrow", "cone"), "shape of glyphs", "arrow or cone", self.shape)
        check(self.lengths in ("magnitude", "equal"), "lengths of glyphs", "magnitude or equal", self.lengths)
        check(not self.style.on_surfaces, "style of glyphs", "no contours, no mesh lines and no lic", "some")


SceneObject: TypeAlias = CutSurface | Faces | Isosurface | VolumeRendering | Streamlines | Glyphs
