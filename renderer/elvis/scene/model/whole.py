"""Cameras and scenes."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import inf
from typing import TYPE_CHECKING, Annotated, Literal

from elvis.core.base.hints import nearest, perhaps
from elvis.core.data.complex_fields import COMPLEX_HELP, PHASE_HELP, ComplexChoice
from elvis.core.data.moments import BETWEEN, Moment
from elvis.core.deformed.deformation import (
    DISPLACEMENT_HELP,
    GRADIENTS,
    GRADIENTS_HELP,
    HEIGHT_HELP,
    SCALE_HELP,
    Deformation,
)
from elvis.scene.model.copies import Copies
from elvis.scene.model.errors import SceneError
from elvis.scene.model.objects import CutSurface, Faces, SceneObject, VolumeRendering
from elvis.scene.model.settings import (
    FilePath,
    Memory,
    Model,
    OtherFiles,
    PaletteName,
    Quantity,
    Setting,
    check,
    settings,
)
from elvis.scene.model.style import COLOR, POSITIVE, ColorBar, Style, check_range
from elvis.scene.model.surfaces import Plane, Surface, Vector, cross, unit

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats


#: sine of the angle between a view and ``up`` below which another direction is upwards
ALONG_UP = 1e-12
#: ambient light on objects coloured by a map, and on those of one colour
AMBIENT_OF_MAPS = 0.5
AMBIENT_OF_COLORS = 0.3


@lru_cache(maxsize=64)
def _basis(eye: Vector, at: Vector, up: Vector) -> "tuple[Floats, Floats, Floats]":
    """See Camera.basis."""
    import numpy as np

    from elvis.core.base.arrays import frozen_floats

    forward = unit(np.subtract(at, eye), "the view of the camera (at - eye)")
    if np.abs(cross(forward, unit(up, "up of the camera"))).max() < ALONG_UP:
        up = (0.0, 0.0, 1.0) if abs(forward[1]) > 0.9 else (0.0, 1.0, 0.0)
    right = unit(cross(forward, np.asarray(up, np.float64)), "up × view of the camera")
    return frozen_floats(right), frozen_floats(cross(right, forward)), frozen_floats(forward)


@dataclass(frozen=True, repr=False)
class Camera(Model):
    """The camera: perspective if it has a field of view, otherwise orthographic."""

    eye: Annotated[Vector, Setting("Position of the eye, in world coordinates.")]
    at: Annotated[Vector, Setting("Point that the camera looks at, in world coordinates.")]
    up: Annotated[Vector, Setting("Upward direction; it need not be perpendicular to the view.")] = (0.0, 0.0, 1.0)
    fov: Annotated[
        float | None,
        Setting(
            "Vertical field of view of a perspective camera.", gt=0, lt=180, unit="degrees", default="orthographic"
        ),
    ] = None
    height: Annotated[
        float | None,
        Setting(
            "Height of an orthographic view, in world units.",
            gt=0,
            expected="a length",
            default="fitted to the visible objects",
        ),
    ] = None

    def basis(self) -> "tuple[Floats, Floats, Floats]":
        """Unit vectors right, up and forward.

        If the camera looks along ``up``, y is upward, or z if it looks along y.
        Raises SceneError if the view or ``up`` has no direction.
        """
        return self._axes

    @cached_property
    def _axes(self) -> "tuple[Floats, Floats, Floats]":
        """See basis, which each pass of a picture asks many times."""
        return _basis(*(tuple(map(float, vector)) for vector in (self.eye, self.at, self.up)))


#: suffixes of pictures that hold lines and texts as such
VECTORS = (".svg", ".pdf")
#: the direction that a named view looks along, and its upward direction
NAMED_VIEWS: dict[str, tuple[Vector, Vector]] = {
    "+x": ((1, 0, 0), (0, 0, 1)),
    "-x": ((-1, 0, 0), (0, 0, 1)),
    "+y": ((0, 1, 0), (0, 0, 1)),
    "-y": ((0, -1, 0), (0, 0, 1)),
    "+z": ((0, 0, 1), (0, 1, 0)),
    "-z": ((0, 0, -1), (0, 1, 0)),
    "iso": ((-1, -1, -1), (0, 0, 1)),
    "top": ((0, 0, -1), (0, 1, 0)),
    "bottom": ((0, 0, 1), (0, 1, 0)),
    "front": ((0, 1, 0), (0, 0, 1)),
    "back": ((0, -1, 0), (0, 0, 1)),
    "left": ((1, 0, 0), (0, 0, 1)),
    "right": ((-1, 0, 0), (0, 0, 1)),
}


@dataclass(frozen=True, repr=False)
class Reference(Model, of="the reference values"):
    """Reference values of the flow for quantities and expressions; the data provide the defaults."""

    mu: Annotated[float | None, Setting("Dynamic viscosity.", **POSITIVE)] = None
    nu: Annotated[float | None, Setting("Kinematic viscosity.", **POSITIVE)] = None
    density: Annotated[float | None, Setting("Density of an incompressible flow.", **POSITIVE)] = None
    gamma: Annotated[float | None, Setting("Ratio of specific heats.", gt=1)] = None
    R: Annotated[float | None, Setting("Specific gas constant.", **POSITIVE)] = None
    rho_ref: Annotated[float | None, Setting("Reference density.", **POSITIVE)] = None
    u_ref: Annotated[float | None, Setting("Reference speed.", **POSITIVE)] = None
    p_ref: Annotated[float | None, Setting("Reference pressure.", finite=True)] = None
    x_ref: Annotated[float | None, Setting("x coordinate of the reference point of moments.", finite=True)] = None
    y_ref: Annotated[float | None, Setting("y coordinate of the reference point of moments.", finite=True)] = None
    z_ref: Annotated[float | None, Setting("z coordinate of the reference point of moments.", finite=True)] = None
    length: Annotated[float | None, Setting("Reference length of moments.", **POSITIVE)] = None
    area: Annotated[float | None, Setting("Reference area of forces; a length in 2D.", **POSITIVE)] = None

    @property
    def values(self) -> dict[str, float]:
        """The given reference values by name."""
        return {name: value for name in settings(Reference) if (value := getattr(self, name)) is not None}


#: ways to draw the undeformed geometry next to the deformed one
UNDEFORMED = ("outline", "mesh", "faces")


@dataclass(frozen=True, repr=False)
class Deform(Model, of="the deformation"):
    """A deformed geometry: a displacement is added to the coordinates of every element."""

    displacement: Annotated[
        Quantity,
        Setting(
            "Components of the displacement (fields or polynomials of fields, separated by commas) or name of a vector "
            "field."
        ),
    ] = ""
    scale: Annotated[float, Setting(SCALE_HELP, finite=True, option="--scale")] = 1.0
    gradients: Annotated[
        Literal["undeformed", "deformed"],
        Setting(GRADIENTS_HELP, option="--gradients", metavar="|".join(GRADIENTS), names=GRADIENTS),
    ] = "undeformed"
    height: Annotated[Quantity, Setting(HEIGHT_HELP, option="--height", metavar="EXPR")] = ""
    undeformed: Annotated[
        Literal["outline", "mesh", "faces"] | None,
        Setting(
            "Also draw the undeformed geometry: its outline, the borders of its elements, or translucent faces.",
            option="--undeformed",
            metavar="|".join(UNDEFORMED),
            names=UNDEFORMED,
            default="only the deformed geometry",
        ),
    ] = None
    walls: Annotated[
        bool, Setting("Close the jumps of a height with vertical strips, which are drawn in grey.", option="--walls")
    ] = False

    def check(self) -> None:
        """Raise SceneError unless there is one displacement or height, and for unknown settings."""
        given = [name for name in ("displacement", "height") if getattr(self, name).strip()]
        check(len(given) == 1, "the deformation", "either displacement or height", " and ".join(given) or "neither")
        check(self.gradients in GRADIENTS, "gradients", " or ".join(GRADIENTS), repr(self.gradients))
        is_known = self.undeformed is None or self.undeformed in UNDEFORMED
        check(is_known, "undeformed", "outline, mesh or faces", repr(self.undeformed))
        check(not self.walls or self.height.strip(), "walls", "a height", "a displacement")

    @property
    def deformation(self) -> Deformation:
        """The deformation in the form that readers of files use."""
        return Deformation(self.displacement, self.scale, self.gradients, self.height)

    @property
    def at_rest(self) -> "Deform":
        """The same deformation with scale 0, which leaves the geometry as it was."""
        return replace(self, scale=0.0, undeformed=None, walls=False)


@dataclass(frozen=True, repr=False)
class Light(Model, of="a light"):
    """A distant light."""

    direction: Annotated[
        Vector | None, Setting("Direction from the data towards the light.", default="behind the eye")
    ] = None
    intensity: Annotated[float, Setting("Intensity of the light.", ge=0)] = 0.75

    def check(self) -> None:
        """Raise SceneError if the direction is zero."""
        if self.direction is not None:
            unit(self.direction, "the direction of a light")


@dataclass(frozen=True, repr=False)
class Caption(Model, of="a text"):
    """A text at a point of the picture."""

    text: Annotated[str, Setting("The text, with mathematics between dollar signs.")]
    at: Annotated[Vector, Setting("Point in world coordinates.")]
    shift: Annotated[
        tuple[float, float],
        Setting(
            "Distance of the text to the right of the point and above it, relative to the smaller side of the picture; "
            "an arrow leads from the text to the point."
        ),
    ] = (0.0, 0.0)


@dataclass(frozen=True, repr=False)
class Clip(Model, of="a clip"):
    """A region in which nothing is shown."""

    surface: Annotated[
        Surface, Setting("Surface that bounds the region; the inside of a plane is the side behind its normal.")
    ]
    away: Annotated[Literal["inside", "outside"], Setting("Side of the surface that is hidden.")] = "inside"

    def check(self) -> None:
        """Raise SceneError for an unknown side."""
        check(self.away in ("inside", "outside"), "away of a clip", "inside or outside", self.away)


@dataclass(frozen=True, repr=False)
class Scene(Model):
    """One picture."""

    field: Annotated[
        Quantity,
        Setting(
            "Field, expression or predefined quantity that colours the picture.",
            option="--field -f",
            default="the first field",
        ),
    ] = ""
    plane: Annotated[
        Plane | None,
        Setting(
            "Cut plane: short for a cut listed before all objects.  2D data are drawn in their own plane.",
            option="--plane",
            metavar="POINT:NORMAL|z=V|z",
            parse="cutting_plane",
            repeatable=True,
            option_help="Cut plane, such as 0,0,0.2:0,0,1 or z=0.2; z goes through the middle of the data.",
        ),
    ] = None
    camera: Annotated[
        Camera | str,
        Setting(
            "A camera, or a named view, which is fitted to the visible objects: fit (perpendicular to 2D data or to a "
            "single plane, else iso), +x, -x, +y, -y, +z, -z (look along an axis), iso, top, bottom, front, back, "
            "left, right (look from that side: top looks down z, front along y, left along x).",
            names=("fit", *NAMED_VIEWS),
            option="--camera",
            metavar="VIEW",
            parse="camera",
            option_help="Named view or eye:at[:up[:degrees]]; with degrees a perspective view, else orthographic and "
            "fitted.  Views: fit (perpendicular to 2D data or a single plane, else iso), +x, -x, +y, -y, +z, -z (along "
            "an axis), iso, top, bottom, front, back, left, right.",
        ),
    ] = "fit"
    size: Annotated[
        tuple[int, int] | None,
        Setting(
            "Width and height of the picture.",
            ge=1,
            le=32768,
            unit="pixels a side",
            option="--size",
            metavar="WxH|N",
            parse="size",
            default="1000 wide or 800 high",
        ),
    ] = None
    palette: Annotated[
        PaletteName,
        Setting(
            "Colour map: a name of the cmap catalogue, elvis:NAME, or a file of ParaView or of the original ElVis.",
            option="--colormap --palette",
            metavar="NAME|FILE.xml",
        ),
    ] = "viridis"
    range: Annotated[
        tuple[float, float] | Literal["visible", "all", "series"] | None,
        Setting(
            "Ends of the colour map: two values, visible (in the picture), all (certified bounds) or series (over all "
            "steps).",
            option="--range",
            metavar="LOW:HIGH|visible|all|series",
            parse="color_range",
            default="visible",
        ),
    ] = None
    bar: Annotated[
        ColorBar | None,
        Setting(
            "Colour bar of the scene's field, and the scale of its colours.",
            option="--bar",
            metavar="KEY=VALUE,...",
            parse="bar",
            option_help="Colour bar: title=TEXT, unit=TEXT, scale=linear|log|symlog, bands=N, "
            "ticks=V V, position=right|left|top|bottom|none.",
        ),
    ] = None
    background: Annotated[
        tuple[float, ...],
        Setting(
            "Background colour; a fourth number is its opacity, 0 for a transparent background.",
            option="--background",
            default="white",
            **{**COLOR, "parse": "background", "expected": "red, green, blue and opacity from 0 to 1"},
        ),
    ] = (1.0, 1.0, 1.0)
    objects: Annotated[
        tuple[SceneObject, ...], Setting("Objects of the picture.", default="all outer faces of 3D data")
    ] = ()
    samples: Annotated[
        int, Setting("Supersampling: average N x N samples per pixel.", ge=1, le=16, option="--samples")
    ] = 1
    lights: Annotated[
        tuple[Light, ...],
        Setting(
            "Lights of the scene.",
            option="--light",
            metavar="X,Y,Z[:I]",
            parse="light",
            default="one behind the eye",
            option_help="Light of intensity I from direction X,Y,Z, or from behind the viewer (eye).",
            repeatable=True,
        ),
    ] = (Light(),)
    ambient: Annotated[
        float | None,
        Setting(
            "Ambient light: share of its colour that a surface shows unlit.",
            ge=0,
            le=1,
            option="--ambient",
            default="0.5 with a colour map, 0.3 in one colour",
        ),
    ] = None
    clip: Annotated[
        tuple[Clip, ...],
        Setting(
            "Regions in which nothing is shown.",
            option="--clip",
            metavar="SURFACE",
            parse="clip",
            option_help="Hide everything inside a surface (see elvis help geometry), or outside it with outside:….",
            repeatable=True,
        ),
    ] = ()
    title: Annotated[
        str | None,
        Setting("Title above the picture; a series adds the time.", option="--title", default="the name of the field"),
    ] = None
    axes: Annotated[bool, Setting("Draw axes with ticks, next to the picture or along the box.", option="--axes")] = (
        False
    )
    scale_bar: Annotated[
        bool, Setting("Draw a scale bar of round length, in parallel views.", option="--scale-bar")
    ] = False
    box: Annotated[bool, Setting("Draw the edges of the box around the domain.", option="--box")] = False
    outline: Annotated[bool, Setting("Draw the outline of the visible objects.", option="--outline")] = False
    font: Annotated[str | None, Setting("Name of the font.", option="--font", default="DejaVu Sans")] = None
    font_size: Annotated[
        float | None,
        Setting("Font size.", gt=0, le=200, unit="points", option="--font-size", default="by the size of the picture"),
    ] = None
    dpi: Annotated[float, Setting("Resolution in pixels per inch.", gt=0, le=10000, option="--dpi")] = 200.0
    texts: Annotated[
        tuple[Caption, ...],
        Setting(
            "Texts at points, with or without arrows.",
            option="--text",
            metavar="POINT[@DX,DY]:TEXT",
            parse="caption",
            option_help="Write a text at a point, such as 1,0,0.2:tip; with @0.1,0.2 it lies this far to the right and "
            "above, in smaller sides of the picture, and an arrow leads to the point.",
            repeatable=True,
        ),
    ] = ()
    image: Annotated[
        FilePath | None,
        Setting("Image in a corner of the picture, such as a logo.", option="--image", metavar="FILE"),
    ] = None
    domain_outline: Annotated[
        bool | None,
        Setting(
            "Draw the outline of the domain, or of the bodies in it: sharp edges and silhouettes of its boundary.",
            option="--domain-outline/--no-domain-outline",
            default="drawn if no faces are shown, except around a plane that the view faces",
        ),
    ] = None
    panels: Annotated[
        tuple[int, int] | None,
        Setting(
            "Rows and columns of the panels in which the pictures of several scenes are arranged.",
            ge=1,
            le=20,
            unit="a side",
            option="--panels",
            metavar="ROWSxCOLUMNS",
            parse="panels",
        ),
    ] = None
    scenes: Annotated[tuple[FilePath, ...], Setting("Scene files, each drawn in a panel.")] = ()
    region: Annotated[
        tuple[float, float, float, float] | None,
        Setting(
            "Visible part of 2D data and plane cuts: ends along the width of the picture (x of 2D data), then along "
            "its height.",
            finite=True,
            expected="finite numbers",
            option="--region",
            metavar="X0:X1,Y0:Y1",
            parse="region",
            default="all",
        ),
    ] = None
    zoom: Annotated[float, Setting("Magnification of the middle of a fitted picture.", **POSITIVE, option="--zoom")] = (
        1.0
    )
    time: Annotated[
        float | None,
        Setting(
            "Value of t in expressions; in a series also the time that is shown.",
            finite=True,
            option="--time",
            default="the time of the data",
        ),
    ] = None
    step: Annotated[
        int | None,
        Setting(
            "Step of a series, counted from 0, or from the end if negative.",
            option="--step",
            default="the last",
        ),
    ] = None
    between: Annotated[
        Literal["linear", "cubic", "nearest"],
        Setting(
            "Data between the steps of a series: coefficients interpolated from two steps (linear) or four (cubic), or "
            "the nearest step.",
            option="--between",
            metavar="|".join(BETWEEN),
            names=BETWEEN,
        ),
    ] = "linear"
    timeout: Annotated[
        float | None,
        Setting(
            "Time after which drawing is abandoned.",
            gt=0,
            le=inf,
            unit="seconds",
            option="--timeout",
        ),
    ] = None
    memory: Memory = None
    data: Annotated[tuple[FilePath, ...], Setting("Files of the dataset: mesh and fields, in any order.")] = ()
    plugin: Annotated[
        str | None,
        Setting(
            "Name of the runtime plugin that opens the data; the option also accepts a Python file.",
            option="--plugin",
            metavar="NAME|FILE.py",
            option_help="Runtime plugin that opens DATA; a file may also define a converter.",
        ),
    ] = None
    reader: Annotated[
        tuple[str, ...],
        Setting(
            "Options of the converter that reads the data, as NAME=VALUE, such as step=3; from=NAME chooses the "
            "converter, fields=NAMES the fields to read.",
            option="--reader",
            metavar="NAME=VALUE",
            option_help="Option of the converter that reads DATA (see elvis convert --help), such as step=3; "
            "from=NAME chooses the converter.",
            repeatable=True,
        ),
    ] = ()
    others: Annotated[
        tuple[OtherFiles, ...],
        Setting(
            "Other solutions for use in expressions, on any mesh, of any order and format: with ref=b.xml,b.fld, "
            "p - ref:p is a quantity.",
            option="--other",
            metavar="NAME=FILE,...",
            option_help="Another solution for use in expressions, on any mesh, of any order and format: with "
            "ref=b.xml,b.fld, p - ref:p is a quantity.",
            repeatable=True,
        ),
    ] = ()
    reference: Annotated[
        Reference, Setting("Reference values of the flow for quantities and expressions.", default="the data's")
    ] = Reference()
    deform: Annotated[
        Deform | None,
        Setting(DISPLACEMENT_HELP, option="--deform", metavar="U,V,W|VECTOR", parse="deform", default="undeformed"),
    ] = None
    copies: Annotated[Copies | None, Setting("Copies of the data that are also drawn.", default="none")] = None
    complex: Annotated[
        tuple[str, ...],
        Setting(COMPLEX_HELP, option="--complex", metavar="E=RE,IM", repeatable=True),
    ] = ()
    phase: Annotated[
        float | None,
        Setting(
            PHASE_HELP,
            finite=True,
            option="--phase",
            metavar="DEGREES",
            unit="degrees",
            default="the parts of complex fields",
        ),
    ] = None
    device: Annotated[
        str,
        Setting("Device that draws (see elvis devices); reference computes in NumPy.", option="--device"),
    ] = "auto"
    outputs: Annotated[
        tuple[FilePath, ...],
        Setting(
            "Pictures and records to write: .png, .jpg, .svg, .pdf, .html, .exr, .npz.",
            option="--output -o",
            repeatable=True,
            default="the name of the scene or the first file, .png",
        ),
    ] = ()
    plain: Annotated[bool, Setting("Write the bare image without title and colour bar.", option="--plain")] = False
    stats: Annotated[
        FilePath | None, Setting("Write statistics (seconds, bytes, counts) as JSON.", option="--stats")
    ] = None

    @classmethod
    def elsewhere(cls, name: str) -> str:
        """A hint for names that are keywords of render and belong to a style or an object."""
        from elvis.scene.commandline.keywords import keywords

        near = nearest(name, [*cls.__dataclass_fields__, *keywords()])
        if not near or near in cls.__dataclass_fields__:
            return ""
        return f"use render(data, {near}=...), or a style of an object of the scene"

    def check(self) -> None:
        """Raise SceneError for an invalid size, an unknown view, or a range that isn't ascending."""
        size = settings(Scene)["size"]
        if self.size is not None and not size.holds(self.size):
            found = " x ".join(map(str, self.size))
            raise SceneError(f"the size of a picture is {size.values_text}, found {found}")
        if isinstance(self.camera, str) and self.camera != "fit" and self.camera not in NAMED_VIEWS:
            meant = perhaps(self.camera, NAMED_VIEWS)
            raise SceneError(f"unknown view {self.camera!r}{meant}: expected fit, {', '.join(NAMED_VIEWS)} or a camera")
        check(self.step is None or self.time is None, "step", "no time next to it", self.time)
        check(self.between in BETWEEN, "between", "linear, cubic or nearest", repr(self.between))
        ends = self.region
        good = ends is None or (ends[0] < ends[1] and ends[2] < ends[3])
        check(good, "region", "x0 < x1 and y0 < y1", ends)
        check(len(self.background) in (3, 4), "background", "3 numbers, or 4", len(self.background))
        if isinstance(self.range, str):
            check(self.range in ("visible", "all", "series"), "range", "visible, all, series or two values", self.range)
        else:
            check_range(self.range)

    @property
    def complexes(self) -> ComplexChoice:
        """Complex fields and their phase in the form that readers of files use."""
        return ComplexChoice(self.complex, self.phase)

    @property
    def companions(self) -> tuple[str, ...]:
        """Names of the geometries that are drawn next to the data."""
        deform = self.deform
        return () if deform is None else tuple(name for name in ("undeformed", "walls") if getattr(deform, name))

    @property
    def backdrop(self) -> Vector:
        """Red, green and blue of the background."""
        red, green, blue = self.background[:3]
        return red, green, blue

    @property
    def is_clear(self) -> bool:
        """Whether the background is transparent."""
        return len(self.background) == 4 and self.background[3] < 1.0

    @property
    def is_traced(self) -> bool:
        """Whether lines are drawn as curves over the pixels: in vector graphics, with labels, or as an outline."""
        items = self.every_object
        if any(isinstance(item, VolumeRendering) for item in items):
            return False
        styles = [item.style for item in items if not isinstance(item, VolumeRendering)]
        labelled = any(style.contours and style.contours.labels for style in styles)
        is_outlined = self.outline or self.undeformed == "outline"
        return is_outlined or labelled or any(name.lower().endswith(VECTORS) for name in self.outputs)

    @property
    def undeformed(self) -> str | None:
        """How the undeformed geometry is drawn next to the deformed one; None if it is not drawn."""
        return None if self.deform is None else self.deform.undeformed

    @cached_property
    def every_object(self) -> tuple[SceneObject, ...]:
        """The objects, the shortcut ``plane`` first."""
        return self.objects if self.plane is None else (CutSurface(self.plane), *self.objects)

    def ambient_on(self, style: Style) -> float:
        """Ambient light on an object of a style.

        Colours of a map are to be read from slanted surfaces too; in one colour, only shading shows the shape.
        """
        if self.ambient is not None:
            return self.ambient
        return AMBIENT_OF_MAPS if style.color is None else AMBIENT_OF_COLORS

    @property
    def moment(self) -> Moment:
        """Step, time and interpolation of the series that is shown."""
        return Moment(self.step, self.time, self.between)

    @property
    def only_plane(self) -> Plane | None:
        """The plane, if the picture shows only a cut by it."""
        objects = self.every_object
        only = objects[0] if len(objects) == 1 else None
        return only.surface if isinstance(only, CutSurface) and isinstance(only.surface, Plane) else None

    @property
    def shows_domain(self) -> bool:
        """Whether the outline of the domain is drawn around the objects."""
        if self.domain_outline is not None:
            return self.domain_outline
        if self._faces_plane or any(isinstance(item, Faces) for item in self.every_object):
            return False
        return bool(self.every_object)

    @property
    def _faces_plane(self) -> bool:
        """Whether the picture shows only a plane, from the front or from behind."""
        plane, camera = self.only_plane, self.camera
        if plane is None or camera == "fit":
            return plane is not None
        return plane.is_across(NAMED_VIEWS[camera][0] if isinstance(camera, str) else camera.basis()[2])

    @property
    def is_plain(self) -> bool:
        """Whether the picture shows only the colours of one unlit plane, with one sample per pixel."""
        usual = None if self.only_plane is None else (CutSurface(self.only_plane),)
        is_bare = not (self.clip or self.outline or self.undeformed or self.copies)
        return self.every_object == usual and is_bare and self.samples == 1
