"""Runtime plugins: what a plugin hands to the renderer, in addition to its Slang module."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.mapping.boxes import outward
from elvis.core.shapes import Shape

if TYPE_CHECKING:
    from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
    from elvis.plugins.faces import Faces


@dataclass(frozen=True, eq=False)
class Solution:
    """Solutions for n pairs of an element and a point.

    status     (n,)    0 outside, 1 inside, 2 undecided
    margin     (n,)    distance to the border of the reference shape where inside, as IVolume.margin
    reference  (n, 3)  reference coordinates where inside
    field      (n,)    the field where inside
    """

    status: Ints
    margin: Floats
    reference: Floats
    field: Floats


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Composition of a quantity that is not a polynomial, so that its rendering is proved (``enclosures.slang``).

    type        the type that implements ILeaves
    fields      number of fields among the leaves
    degree      maximum degree of the leaves, including the map, in any one coordinate to which ``Part.degree`` refers
    base_degree as Part.base_degree, of the leaves
    map_degree  of the map
    is_total    whether ``degree`` is the total degree
    errors      (n, 3 + fields) error bounds of computed leaves in each element
    distances   whether there are distances among the leaves
    continuous  whether it has neither jumps nor poles; isosurfaces are proved only without them
    slopes      whether it also depends on derivatives of fields
    in_boxes    whether series in boxes approximate it near one level; ``degree`` is the degree of these series
    """

    type: str
    fields: int
    degree: int
    base_degree: int
    map_degree: int
    is_total: bool
    errors: Callable[[], Floats]
    distances: bool = False
    continuous: bool = True
    slopes: bool = True
    in_boxes: bool = False


class LevelSeries(Protocol):
    """Series of a quantity in boxes of elements that may have one value.

    nbytes  of all series found so far
    """

    nbytes: int

    @property
    def degree(self) -> int:
        """Degree of the series."""

    def of(self, elements: Ints) -> SeriesBoxes:
        """The boxes of some elements (n,)."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Bounds over neighbourhoods of n elements, infinite where nothing is known.

    gradient   (n,) sum of the absolute first derivatives in reference coordinates
    curvature  (n,) sum of the absolute second derivatives
    noise      (n,) how far computed values may be from the true ones
    """

    gradient: Floats
    curvature: Floats
    noise: Floats


@dataclass(frozen=True, eq=False)
class SlopeBounds:
    """Slopes of a quantity that is not a polynomial, so that its contours are proved.

    map_degree  of the map, as ``Part.degree``
    of          elements (n,), and the size of their neighbourhoods relative to them, to their slopes; infinite if the
                ``Part`` is ``collapsed``
    in_boxes    for these: elements (n,), and middles and half sides (n, 3) of boxes in collapsed coordinates, to slopes
                in these boxes, in reference coordinates
    """

    map_degree: int
    of: Callable[[Ints, float], Slopes]
    in_boxes: Callable[[Ints, Floats, Floats], Slopes]


@dataclass(frozen=True, eq=False)
class Quantity:
    """Another field on the elements of a part: the same map and the same numbers, other values and gradients.

    type     the type that implements IVolume
    source   Slang text to insert before the type is used, instead of the part's
    buffers  the module's global buffers that differ from the part's, or that the part doesn't have
    degree   as Part.degree, of the part's map and the quantity's values
    bounds   optional: certified minimum and maximum of each element, (n,) each, NaN where it is not a number
    is_distance  whether its value is the distance to the first of the surfaces in its buffers (`distances`)
    level    optional, where degree is 0: for a value, a quantity with a degree, and its value with the same level set,
             except at poles; None if none is known
    rounding optional: error bounds of computed values in each element, (n,), 0 where the field is constant; by default
             1e-13 of the maximum value
    enclosure optional, where degree is 0: its composition
    condition optional, of straight tetrahedra with a degree: a function that is positive where its level 0 isn't to be
             shown; with the same map and numbers, bounds and rounding
    slopes   optional, where degree is 0: bounds of its derivatives
    base_degree as Part.base_degree level_boxes optional, with an enclosure: for a value, boxes of elements that may
    have it, with series that approximate
             map and quantity
    """

    type: str
    source: str = ""
    buffers: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    degree: int = 0
    bounds: Callable[[], tuple[Floats, Floats]] | None = None
    is_distance: bool = False
    level: Callable[[float], tuple[Quantity, float] | None] | None = None
    rounding: Callable[[], Floats] | None = None
    enclosure: Enclosure | None = None
    condition: Quantity | None = None
    slopes: SlopeBounds | None = None
    base_degree: int = 0
    level_boxes: Callable[[float], LevelSeries] | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """Elements of one kind, all served by one Slang type.

    module       name of the Slang module (a file in the volume's shader folder)
    type         the type in it that implements IVolume, e.g. ``Hexahedron<2, 3>``
    element_ids  (n,) ids in the file
    boxes        (n, 6) low and high corner of a box that contains each element, float32 rounded outwards
    buffers      the module's global buffers by name: arrays of float64, float32 or uint32
    solve        optional last resort on the host: elements (n,) and world points (n, 3) to a Solution, for the few
                 points that the kernels could not decide
    bends        optional: whether elements (n,) are curved so strongly that straight-line steps of Newton's method may
                 end
                 at a root outside although there is one inside; then `solve` also decides the pixels next to them
    source       Slang text to insert before the type is used: imports, or declarations made only for this part
    evaluate     optional host evaluation of the type in NumPy: elements (n,) of this part and reference points (n, 3)
                 to world positions (n, 3) and values (n,)
    quantities   other fields of the same elements, by name
    degree       maximum degree of map and field in any one reference coordinate, if they are polynomials on
                 [-1, 1]^3; 0 otherwise: isosurfaces are then found without proof
    collapsed    ``degree`` refers to the coordinates of a collapsed cube, (a, b, c) with
                 r = ((1 + a) (1 - c) / 2 - 1, (1 + b) (1 - c) / 2 - 1, c), instead of the reference coordinates
    bounds       optional, as Quantity.bounds, of the part's own field
    affine       the elements are straight tetrahedra, (-1, -1, -1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1) in reference
                 coordinates; their hull points are these corners
    shape        the reference shape, if it is a known one; with ``evaluate`` the rest follows in NumPy
                 (`host_evaluation`)
    is_distance  as Quantity.is_distance, of the part's own field; the same applies to ``level``, ``rounding``,
                 ``enclosure``, ``slopes`` and ``level_boxes``
    base_degree  optional, if they are collapsed: as ``degree``, in the first two coordinates only
    unit         the shape is scaled to coordinates from 0 to 1, instead of -1 to 1
    """

    module: str
    type: str
    element_ids: Ints
    boxes: NDArray[np.float32]
    buffers: Mapping[str, NDArray[Any]]
    solve: Callable[[Ints, Floats], Solution] | None = None
    source: str = ""
    evaluate: Callable[[Ints, Floats], tuple[Floats, Floats]] | None = None
    bends: Callable[[Ints], Bools] | None = None
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    degree: int = 0
    collapsed: bool = False
    affine: bool = False
    bounds: Callable[[], tuple[Floats, Floats]] | None = None
    shape: Shape | None = None
    unit: bool = False
    is_distance: bool = False
    level: Callable[[float], tuple[Quantity, float] | None] | None = None
    rounding: Callable[[], Floats] | None = None
    enclosure: Enclosure | None = None
    slopes: SlopeBounds | None = None
    base_degree: int = 0
    level_boxes: Callable[[float], LevelSeries] | None = None

    def __len__(self) -> int:
        return len(self.element_ids)

    def quantity(self, name: str | None) -> Part | Quantity:
        """One of the quantities; None is the part itself, for its own field."""
        return self if name is None else self.quantities[name]


def basis_part(
    module: str,
    type: str,
    boxes: NDArray[np.float32],
    buffers: Mapping[str, NDArray[Any]],
    element_ids: Ints | None = None,
    evaluate: Callable[[Ints, Floats], tuple[Floats, Floats]] | None = None,
    **others: Any,
) -> Part:
    """A part whose Slang type implements IBasis: Jacobians come from automatic differentiation, bounds from the boxes.

    element_ids  (n,) ids in the file, 0 to n - 1 by default; these and ``others`` as in Part
    """
    ids = np.arange(len(boxes)) if element_ids is None else element_ids
    every = {**buffers, "element_boxes": np.ascontiguousarray(boxes, np.float32)}
    adapted, source = f"Differentiated<{type}>", "import differentiated;"
    return Part(module, adapted, ids, boxes, every, source=source, evaluate=evaluate, **others)


def boxes_between(low: Floats, high: Floats, margin: float = 1e-9) -> NDArray[np.float32]:
    """Boxes (n, 6) for a Part that contain everything between the corners ``low`` and ``high`` (n, 3).

    margin  share of the diagonal by which a box is enlarged on all sides; rounding of the coordinates adds to it
    """
    return outward(low, high, margin)


@dataclass(frozen=True, eq=False)
class PartsVolume:
    """A Volume made of parts.

    shader_folder  where the Slang modules of the parts stand
    dimension      3, or 2 for elements in the plane z = 0
    faces          gives the elements' faces (see `elvis.plugins.faces`), where pictures of them can be made
    """

    parts: Sequence[Part]
    shader_folder: Path
    dimension: int = 3
    faces: Callable[[], Faces] | None = None


class Volume(Protocol):
    """Elements with one field, ready for a device."""

    @property
    def dimension(self) -> int:
        """3, or 2 for elements in the plane z = 0."""
        ...

    @property
    def shader_folder(self) -> Path:
        """Folder of the Slang modules of the parts."""
        ...

    @property
    def parts(self) -> Sequence[Part]:
        """The elements, by kind."""
        ...


def corners_of_volume(volume: Volume) -> Floats:
    """(2, 3) corners of the box of the boxes of all elements."""
    boxes = np.concatenate([np.asarray(part.boxes, np.float64) for part in volume.parts])
    return np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


def interface_folder() -> Path:
    """The folder of ``volume.slang``, the published interface."""
    return Path(__file__).parents[1] / "shaders"
