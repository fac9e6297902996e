"""Conversion plugins: what the author of a converter writes.

A converter is a subclass of `Converter`.  It says which files it opens, lists blocks of elements and fields, and
evaluates both at reference points.  Projection, numbering, curves, continuity, error measurement and file formats are
the project's.

Reference points come in the coordinates of `elvis.core.shapes`, [-1, 1] each way, with local vertices in that order.
A block whose source uses other coordinates declares a ``frame``; the points then come in the source's.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import ExpansionRule, Homogeneous
from elvis.core.data.mesh import Mesh
from elvis.core.polynomials.kronecker import RowMap
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared

#: relative spacing of float64, float32 and of text with eight digits
DOUBLE, SINGLE, EIGHT_DIGITS = 2.0**-52, 2.0**-23, 1e-8


class PyramidSpace(Enum):
    """Which functions of order p live on the pyramids of a source; e is a collapsed coordinate, c = (1 - e3)/2.

    POLYNOMIAL  x^i y^j z^k, k <= p - max(i, j)                  (PyFR)
    RATIONAL    e1^i e2^j c^max(i,j) e3^k, k <= p - max(i, j)    (Bergot; Gmsh, NGSolve)
    TENSOR      e1^i e2^j e3^k, i, j, k <= p                     (MFEM, VTK, anything else)
    NATIVE      the modified pyramid of Nektar++
    """

    POLYNOMIAL = "polynomial"
    RATIONAL = "rational"
    TENSOR = "tensor"
    NATIVE = "native"


@dataclass(frozen=True, eq=False)
class Elements:
    """A block of elements: one shape, one order of the map.

    shape     of the elements
    count     number of elements
    order     degree of the map from the reference element
    vertices  (count, n_vertices) the source's own numbers of the vertices, in the local order of ``shape``; None if
              the source has no such numbers, in which case vertices at the same position are equal
    frame     (n_vertices, d) the source's reference coordinates of the vertices, None if they equal ``shape``'s
    ids       (count,) the source's numbers of the elements, kept as ids if they are unique over all blocks
    region    name of the part of the domain to which they belong
    other_regions  names of overlapping parts to which they also belong
    pyramid   the functions on pyramids, of the map and of the fields
    is_polynomial  whether the map is in the space of that order; False for example for NURBS
    key       any value by which the converter identifies the block
    rows      elements of the block that are meant; `Converter.positions` and `Converter.sample` index by it
    """

    shape: Shape
    count: int
    order: int = 1
    vertices: Ints | None = None
    frame: Floats | None = None
    ids: Ints | None = None
    region: str = ""
    other_regions: tuple[str, ...] = ()
    pyramid: PyramidSpace = PyramidSpace.TENSOR
    is_polynomial: bool = True
    key: Any = None
    rows: slice | Ints = field(default_factory=lambda: slice(None))

    def __len__(self) -> int:
        return self.count

    def take(self, rows: slice | Ints) -> Elements:
        """The elements ``rows`` of this block, counted from its beginning."""
        count = len(range(*rows.indices(self.count))) if isinstance(rows, slice) else len(rows)
        vertices = None if self.vertices is None else self.vertices[rows]
        ids = None if self.ids is None else self.ids[rows]
        return replace(self, count=count, vertices=vertices, ids=ids, rows=rows)


@dataclass(frozen=True)
class SourceField:
    """A scalar field of a source; a vector ``v`` becomes three of them: ``v_x``, ``v_y``, ``v_z``.

    order          polynomial degree in the reference element, one for all blocks or one per block; None for a block
                   without the field
    is_continuous  whether elements that share a face agree there
    is_polynomial  whether the field is in the space of that order; False for derived, rational, H(div) ... fields
    key            any value by which the converter identifies the field
    homogeneous    Fourier directions of quasi-3D data: then fields of one name follow that are the coefficients of its
                   planes, in their order, and together form one field
    modes          numbers of native modes in each direction, on each block; for sources whose directions differ
    """

    name: str
    order: int | Sequence[int | None]
    is_continuous: bool = False
    is_polynomial: bool = True
    key: Any = None
    homogeneous: Homogeneous | None = None
    modes: Sequence[tuple[int, ...] | None] = ()

    def order_on(self, block: int) -> int | None:
        """The degree on a block, None where it lacks the field."""
        return self.order if isinstance(self.order, int) else self.order[block]

    def is_on(self, block: int) -> bool:
        """Whether a block has the field."""
        return self.order_on(block) is not None


@dataclass(frozen=True, eq=False)
class Boundary:
    """A named set of faces (of edges in 2D, of vertices in 1D).

    vertices  arrays (n, k) of the source's vertex numbers, in any order, each for faces of k vertices
    sides     triples of a block's number, rows (n,) of elements in it, and the local face (n,) of each, as in `Shape`
    number    by which the source calls it in addition, which becomes the id of its composite unless several have it;
              None for that in a name such as ``boundary5``, if it has one
    """

    name: str
    vertices: Sequence[Ints] = ()
    sides: Sequence[tuple[int, Ints, Ints]] = ()
    number: int | None = None


@dataclass(frozen=True)
class Option:
    """A choice that the user has: ``elvis convert --name VALUE`` becomes a keyword of the converter's constructor.

    choices  the values it may take, empty where any text will do, None for a flag
    """

    name: str
    help: str
    choices: tuple[str, ...] | None = ()
    default: str | None = None


@dataclass(frozen=True)
class Reads:
    """Capabilities of a converter, in a few words each: the columns of the table of formats.

    shapes          of elements
    orders          of the map and of the fields
    bases           of the fields
    boundaries      how they are named
    series          forms of series
    parts           forms of parallel output
    nonconforming   whether hanging nodes are read
    complex         treatment of complex functions
    """

    shapes: str = ""
    orders: str = ""
    bases: str = ""
    boundaries: str = ""
    series: str = ""
    parts: str = ""
    nonconforming: str = ""
    complex: str = ""


class Converter(ABC):
    """Reads the data of one format; the entry points ``elvis.converters`` name subclasses.

    Class attributes:
    format   description of the format
    keeps, loses   contents of a file that are converted, and contents that are lost
    reads    capabilities by shapes, orders and so on, for the table of formats
    needs    packages to import beyond ElVis's own, installed by the extra ``converters``
    options  choices of the user, keywords of the constructor

    Instance attributes, set by the constructor:
    blocks, fields, boundaries   the data; fields and boundaries may be empty
    time, metadata               of the dataset
    precision                    relative rounding of the source's numbers
    errors                       known errors of the source itself, and their derivative in space (infinite if
                                 unknown): of the map, whose name is empty, and of fields by name
    is_conforming                False if faces of elements meet parts of others (hanging nodes)
    mortars                      sides of elements that meet parts of others, if the source lists them; others are found
                                 by position
    notes                        sentences for the report: decisions made in reading
    warnings                     sentences that every command prints: skipped and doubtful contents
    declared                     numbers that the files state, for comparison with the converted data
    expansions, session          of sources of the native format: see `elvis.core.data.dataset.Dataset`
    mesh                         of sources that have one of the native format, which is used unchanged: then blocks
                                 contain elements of it by ``ids``, in its frame and order of vertices; None else
    further_files                files that the constructor read in addition to the given ones, such as the pieces
                                 listed in an index: conversions are cached until one of all these files changes.
                                 None if they are not known, which disables caching; () for classes that read no others
    """

    format: ClassVar[str] = ""
    keeps: ClassVar[str] = ""
    loses: ClassVar[str] = ""
    reads: ClassVar[Reads] = Reads()
    needs: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[tuple[Option, ...]] = ()

    blocks: Sequence[Elements] = ()
    fields: Sequence[SourceField] = ()
    boundaries: Sequence[Boundary] = ()
    time: float | None = None
    metadata: Mapping[str, str] = {}
    precision: float = DOUBLE
    errors: Mapping[str, tuple[float, float]] = {}
    is_conforming: bool = True
    mortars: Sequence[tuple[int, Ints, Ints]] = ()
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()
    declared: Declared = Declared()
    expansions: tuple[ExpansionRule, ...] = ()
    session: Mapping[str, str] = {}
    mesh: Mesh | None = None
    further_files: Sequence[Path] | None = None

    @classmethod
    @abstractmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether all these files are for this converter; decided by content, quickly, without raising."""

    @classmethod
    def hint(cls, path: Path) -> str:
        """Description of a related file that it doesn't open, and advice; empty for all other files.

        Such as ``a Nek5000 mesh (.re2) without a field: give a field file too``; as fast as `opens`.
        """
        return ""

    @classmethod
    def needs_of(cls, paths: Sequence[Path]) -> tuple[str, ...]:
        """The packages of ``needs`` that these files require; in some formats only some files do."""
        return cls.needs

    @classmethod
    def whole(cls, path: Path) -> Path:
        """The name of the state that a file is a part of, by the format's own marks in names; else its own name.

        Parts of a state have one such name, steps of a series have names that differ in a number.
        """
        return path

    @classmethod
    def joins(cls, paths: Sequence[Path]) -> bool:
        """Whether files without such marks, whose names differ in a number, form one state: parts, or other fields.

        Otherwise each is a state of its own.  Called only for files without different times, some of which may be
        damaged.  FormatError if they are neither.
        """
        return False

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The times of the steps in its files, by the numbers of its option ``step``; or the time of their only step.

        Missing steps have the time nan.  None if the files contain no times, or need a complete reading; FormatError if
        they are damaged.
        """
        return ()

    @abstractmethod
    def __init__(self, paths: Sequence[Path], **options: Any) -> None:
        """Read the files; FormatError for invalid files."""

    @abstractmethod
    def positions(self, block: Elements, points: Floats) -> Floats:
        """(len(block), n, 3) world coordinates at reference points (n, d) of the elements ``block.rows``; or (…, 2)."""

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """(len(block), n) values of a field at reference points (n, d) of the elements ``block.rows``."""
        raise NotImplementedError(f"{type(self).__name__} lists fields but doesn't sample them")

    def at_nodes(self, block: Elements, field: SourceField | None) -> tuple[Floats, Callable[[Floats], RowMap]] | None:
        """Values of a field (len(block), k), or positions (len(block), 3, k) for None, at k nodes of ``block.rows``.

        They come with a function that gives the map from values at the nodes to those at reference points (n, d), so
        that a projection goes directly from nodes to coefficients.  None if samples aren't made from values at nodes.
        """
        return None

    def summary(self) -> str:
        """One line for messages: how many elements and fields there are."""
        counts = ", ".join(f"{len(block)} {block.shape.label.lower()}" for block in self.blocks if len(block))
        return f"{counts or 'no elements'}; {len(self.fields)} fields"
