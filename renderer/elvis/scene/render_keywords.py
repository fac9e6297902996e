"""Types of the keywords of `elvis.render` and `elvis.view`, for editors and type checkers.

Made by tools/keyword_types.py from the models of scenes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict

from numpy.typing import ArrayLike

from elvis.scene.model.convolution import Lic
from elvis.scene.model.copies import Copies, Repeat, Turn
from elvis.scene.model.objects import (
    CutSurface,
    Faces,
    Glyphs,
    Isosurface,
    SceneObject,
    Streamlines,
    VolumeRendering,
)
from elvis.scene.model.style import ColorBar, Contours, MeshLines
from elvis.scene.model.surfaces import Plane, Surface
from elvis.scene.model.whole import Camera, Clip, Deform, Light, Reference


class SharedKeywords(TypedDict, total=False):
    """Keywords of both functions, all optional."""

    field: str | None
    """Field, expression or predefined quantity that colours the picture."""
    plane: Plane | Mapping[str, float] | ArrayLike | Sequence[Plane | str] | None
    """Cut plane, such as 0,0,0.2:0,0,1 or z=0.2; z goes through the middle of the data."""
    camera: Camera | str | Mapping[str, Any] | ArrayLike | None
    """Named view or eye:at[:up[:degrees]]; with degrees a perspective view, else orthographic and fitted."""
    size: ArrayLike | None
    """Width and height of the picture."""
    palette: str | None
    """Colour map: a name of the cmap catalogue, elvis:NAME, or a file of ParaView or of the original ElVis."""
    colormap: str | None
    """Colour map: a name of the cmap catalogue, elvis:NAME, or a file of ParaView or of the original ElVis."""
    range: str | ArrayLike | None
    """Ends of the colour map: two values, visible (in the picture), all (certified bounds) or series (over all
    steps)."""
    bar: ColorBar | str | Mapping[str, Any] | None
    """Colour bar: title=TEXT, unit=TEXT, scale=linear|log|symlog, bands=N, ticks=V V,
    position=right|left|top|bottom|none."""
    background: ArrayLike | None
    """Background colour; a fourth number is its opacity, 0 for a transparent background."""
    objects: Sequence[SceneObject] | None
    """Objects of the picture."""
    samples: int | None
    """Supersampling: average N x N samples per pixel."""
    lights: Light | str | ArrayLike | Sequence[Light | str] | None
    """Light of intensity I from direction X,Y,Z, or from behind the viewer (eye)."""
    light: Light | str | ArrayLike | Sequence[Light | str] | None
    """Light of intensity I from direction X,Y,Z, or from behind the viewer (eye)."""
    ambient: float | None
    """Ambient light: share of its colour that a surface shows unlit."""
    clip: Clip | Surface | str | Sequence[Clip | Surface | str] | None
    """Hide everything inside a surface (see elvis help geometry), or outside it with outside:…."""
    title: str | None
    """Title above the picture; a series adds the time."""
    axes: bool | None
    """Draw axes with ticks, next to the picture or along the box."""
    scale_bar: bool | None
    """Draw a scale bar of round length, in parallel views."""
    box: bool | None
    """Draw the edges of the box around the domain."""
    outline: bool | None
    """Draw the outline of the visible objects."""
    font: str | None
    """Name of the font."""
    font_size: float | None
    """Font size."""
    dpi: float | None
    """Resolution in pixels per inch."""
    texts: ArrayLike | None
    """Write a text at a point, such as 1,0,0.2:tip; with @0.1,0.2 it lies this far to the right and above, in
    smaller sides of the picture, and an arrow leads to the point."""
    text: ArrayLike | None
    """Write a text at a point, such as 1,0,0.2:tip; with @0.1,0.2 it lies this far to the right and above, in
    smaller sides of the picture, and an arrow leads to the point."""
    image: str | None
    """Image in a corner of the picture, such as a logo."""
    domain_outline: bool | None
    """Draw the outline of the domain, or of the bodies in it: sharp edges and silhouettes of its boundary."""
    region: ArrayLike | None
    """Visible part of 2D data and plane cuts: ends along the width of the picture (x of 2D data), then along its
    height."""
    zoom: float | None
    """Magnification of the middle of a fitted picture."""
    time: float | None
    """Value of t in expressions; in a series also the time that is shown."""
    step: int | None
    """Step of a series, counted from 0, or from the end if negative."""
    between: Literal["linear", "cubic", "nearest"] | None
    """Data between the steps of a series: coefficients interpolated from two steps (linear) or four (cubic), or the
    nearest step."""
    timeout: float | None
    """Time after which drawing is abandoned."""
    memory: float | str | None
    """Memory for the elements that are drawn, such as 2GiB, about four times the size of their coefficients:
    elements that the picture depends on are read in bricks of this size."""
    plugin: str | None
    """Runtime plugin that opens DATA; a file may also define a converter."""
    reader: str | Mapping[str, Any] | Sequence[str] | None
    """Option of the converter that reads DATA (see elvis convert --help), such as step=3; from=NAME chooses the
    converter."""
    others: str | Mapping[str, Any] | Sequence[str] | None
    """Another solution for use in expressions, on any mesh, of any order and format: with ref=b.xml,b.fld, p - ref:p
    is a quantity."""
    other: str | Mapping[str, Any] | Sequence[str] | None
    """Another solution for use in expressions, on any mesh, of any order and format: with ref=b.xml,b.fld, p - ref:p
    is a quantity."""
    reference: Reference | Mapping[str, float] | None
    """Reference values of the flow for quantities and expressions."""
    deform: Deform | str | Mapping[str, Any] | None
    """Draw and measure on the deformed geometry x + S d(x). The displacement d is given by its components (fields or
    polynomials of fields, separated by commas) or by the name of a vector field without its suffixes."""
    copies: Copies | Mapping[str, Any] | None
    """Copies of the data that are also drawn."""
    complex: str | Sequence[str] | None
    """Complex field in addition to pairs such as E_re and E_im: its name, real and imaginary part, which are fields
    or vectors."""
    phase: float | None
    """Phase in degrees at which complex fields are shown: the field E is then the real part of E exp(i phase), and
    phase a number in expressions."""
    outputs: str | Path | Sequence[str | Path] | None
    """Pictures and records to write: .png, .jpg, .svg, .pdf, .html, .exr, .npz."""
    output: str | Path | Sequence[str | Path] | None
    """Pictures and records to write: .png, .jpg, .svg, .pdf, .html, .exr, .npz."""
    plain: bool | None
    """Write the bare image without title and colour bar."""
    color: ArrayLike | None
    """Single colour for all objects."""
    opacity: float | None
    """Opacity of all objects."""
    lit: bool | None
    """Shade all objects with the lights, or none."""
    contours: Contours | Mapping[str, Any] | ArrayLike | None
    """About N contour lines at round values (N:even: exactly N), or given ones; :labels: values."""
    mesh_lines: MeshLines | Mapping[str, Any] | bool | None
    """Draw the borders of elements."""
    lic: Lic | Mapping[str, Any] | bool | None
    """Line integral convolution: streaks along the velocity on surfaces."""
    deform_scale: float | None
    """Factor S of the displacement."""
    scale: float | None
    """Factor S of the displacement."""
    deform_gradients: Literal["undeformed", "deformed"] | None
    """Configuration in which derivatives of quantities are taken on a deformed geometry."""
    gradients: Literal["undeformed", "deformed"] | None
    """Configuration in which derivatives of quantities are taken on a deformed geometry."""
    deform_height: str | None
    """Draw and measure 2D data on the surface z = S u(x, y): a field u, or a polynomial of fields."""
    deform_undeformed: Literal["outline", "mesh", "faces"] | None
    """Also draw the undeformed geometry: its outline, the borders of its elements, or translucent faces."""
    undeformed: Literal["outline", "mesh", "faces"] | None
    """Also draw the undeformed geometry: its outline, the borders of its elements, or translucent faces."""
    deform_walls: bool | None
    """Close the jumps of a height with vertical strips, which are drawn in grey."""
    walls: bool | None
    """Close the jumps of a height with vertical strips, which are drawn in grey."""
    copies_mirror: Plane | str | Mapping[str, float] | ArrayLike | Sequence[Plane | str] | None
    """Also draw the mirror image at a plane; vectors and derived quantities have the right signs."""
    mirror: Plane | str | Mapping[str, float] | ArrayLike | Sequence[Plane | str] | None
    """Also draw the mirror image at a plane; vectors and derived quantities have the right signs."""
    copies_turn: Turn | str | Sequence[Any] | None
    """Draw COUNT copies around an axis (x, y, z or a direction), evenly spaced over a full circle."""
    turn: Turn | str | Sequence[Any] | None
    """Draw COUNT copies around an axis (x, y, z or a direction), evenly spaced over a full circle."""
    copies_repeat: Repeat | str | Sequence[Any] | None
    """Draw COUNT copies in a row, each translated by a vector, such as 1,0,0:4; x, y or z is the period that the
    data declare."""
    repeat: Repeat | str | Sequence[Any] | None
    """Draw COUNT copies in a row, each translated by a vector, such as 1,0,0:4; x, y or z is the period that the
    data declare."""
    cut: CutSurface | Surface | str | Sequence[CutSurface | Surface | str] | None
    """Surface that cuts 3D data, such as sphere:0,0,0:0.5 or mesh:FILE (see elvis help geometry)."""
    faces: Faces | str | Sequence[Faces | str] | None
    """Element faces: all (outer), inner, names of boundaries, element:ID, shape:NAME, region:NAME."""
    isosurface: Isosurface | Mapping[str, Any] | ArrayLike | Sequence[Isosurface | str] | None
    """Isosurface(s) of quantity Q at value(s) V; Q defaults to --field."""
    volume: VolumeRendering | str | Sequence[VolumeRendering | str] | None
    """Volume rendering: extinction D at value V of quantity Q, linear between."""
    streamlines: Streamlines | str | Mapping[str, Any] | ArrayLike | Sequence[Streamlines | str] | None
    """Streamlines from seeds, such as line:P:Q:20 or random:100 (see elvis help geometry), or cores=acceleration for
    all vortex cores; other keys follow after semicolons, such as radius=0.01."""
    glyphs: Glyphs | str | Mapping[str, Any] | ArrayLike | Sequence[Glyphs | str] | None
    """Arrows at points, such as plane:P:N:30 or a table (see elvis help geometry); other keys follow after
    semicolons, such as length=0.1 or shape=cone."""
    slice: Plane | Mapping[str, float] | ArrayLike | Sequence[Plane | str] | None
    """Cut plane, such as 0,0,0.2:0,0,1 or z=0.2; z goes through the middle of the data."""
    scalars: str | None
    """Field, expression or predefined quantity that colours the picture."""
    cmap: str | None
    """Colour map: a name of the cmap catalogue, elvis:NAME, or a file of ParaView or of the original ElVis."""
    color_map: str | None
    """Colour map: a name of the cmap catalogue, elvis:NAME, or a file of ParaView or of the original ElVis."""
    clim: str | ArrayLike | None
    """Ends of the colour map: two values, visible (in the picture), all (certified bounds) or series (over all
    steps)."""
    levels: Contours | Mapping[str, Any] | ArrayLike | None
    """About N contour lines at round values (N:even: exactly N), or given ones; :labels: values."""
    isosurfaces: Isosurface | Mapping[str, Any] | ArrayLike | Sequence[Isosurface | str] | None
    """Isosurface(s) of quantity Q at value(s) V; Q defaults to --field."""
    boundary: Faces | str | Sequence[Faces | str] | None
    """Element faces: all (outer), inner, names of boundaries, element:ID, shape:NAME, region:NAME."""
    boundaries: Faces | str | Sequence[Faces | str] | None
    """Element faces: all (outer), inner, names of boundaries, element:ID, shape:NAME, region:NAME."""
    show_edges: MeshLines | Mapping[str, Any] | bool | None
    """Draw the borders of elements."""
    alpha: float | None
    """Opacity of all objects."""
    window_size: ArrayLike | None
    """Width and height of the picture."""
    image_size: ArrayLike | None
    """Width and height of the picture."""
    background_color: ArrayLike | None
    """Background colour; a fourth number is its opacity, 0 for a transparent background."""
    camera_position: Camera | str | Mapping[str, Any] | ArrayLike | None
    """Named view or eye:at[:up[:degrees]]; with degrees a perspective view, else orthographic and fitted."""
    cpos: Camera | str | Mapping[str, Any] | ArrayLike | None
    """Named view or eye:at[:up[:degrees]]; with degrees a perspective view, else orthographic and fitted."""
    show_axes: bool | None
    """Draw axes with ticks, next to the picture or along the box."""
    streamplot: Streamlines | str | Mapping[str, Any] | ArrayLike | Sequence[Streamlines | str] | None
    """Streamlines from seeds, such as line:P:Q:20 or random:100 (see elvis help geometry), or cores=acceleration for
    all vortex cores; other keys follow after semicolons, such as radius=0.01."""
    quiver: Glyphs | str | Mapping[str, Any] | ArrayLike | Sequence[Glyphs | str] | None
    """Arrows at points, such as plane:P:N:30 or a table (see elvis help geometry); other keys follow after
    semicolons, such as length=0.1 or shape=cone."""
    arrows: Glyphs | str | Mapping[str, Any] | ArrayLike | Sequence[Glyphs | str] | None
    """Arrows at points, such as plane:P:N:30 or a table (see elvis help geometry); other keys follow after
    semicolons, such as length=0.1 or shape=cone."""
    ssaa: int | None
    """Supersampling: average N x N samples per pixel."""
    filename: str | Path | Sequence[str | Path] | None
    """Pictures and records to write: .png, .jpg, .svg, .pdf, .html, .exr, .npz."""
    screenshot: str | Path | Sequence[str | Path] | None
    """Pictures and records to write: .png, .jpg, .svg, .pdf, .html, .exr, .npz."""
    savefig: str | Path | Sequence[str | Path] | None
    """Pictures and records to write: .png, .jpg, .svg, .pdf, .html, .exr, .npz."""
    timestep: int | None
    """Step of a series, counted from 0, or from the end if negative."""
    logo: str | None
    """Image in a corner of the picture, such as a logo."""
    annotate: ArrayLike | None
    """Write a text at a point, such as 1,0,0.2:tip; with @0.1,0.2 it lies this far to the right and above, in
    smaller sides of the picture, and an arrow leads to the point."""


class RenderKeywords(SharedKeywords, total=False):
    """Keywords of `elvis.render`."""

    height: str | None
    """Draw and measure 2D data on the surface z = S u(x, y): a field u, or a polynomial of fields."""


class ViewKeywords(SharedKeywords, total=False):
    """Keywords of `elvis.view`."""

    device: str | None
    """Device that draws (see elvis devices); reference computes in NumPy."""
