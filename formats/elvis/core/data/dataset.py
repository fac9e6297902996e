"""Fields and datasets in memory: coefficients in arrays by block of like elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as default
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.hints import perhaps
from elvis.core.base.lazy import public
from elvis.core.base.texts import check_name
from elvis.core.data import describing
from elvis.core.data.mesh import Mesh
from elvis.core.data.moments import Instant
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape

if TYPE_CHECKING:
    from elvis.core.differences.common_elements import CommonElements
    from elvis.core.distances import Surface
    from elvis.core.quantities.callables import DatasetField, Quantity
    from elvis.core.streamlines.moving import Interval

#: key of the metadata that names the fields which hold the map of the elements
MAP_KEY = "GeometryMap"
#: names of these fields if the metadata give none
MAP_FIELDS = ("map_x", "map_y", "map_z")


@dataclass(frozen=True)
class Homogeneous:
    """Fourier directions in addition to the modal ones (quasi-3D data; format notes 3 and 5).

    bases    one Fourier-like basis for each direction
    lengths  of the periodic directions: (LZ,) or (LY, LZ)
    y_ids, z_ids  Fourier mode number of each plane (1D; y_ids empty) or line (2D), in data order
    strips   ids of the strips, empty if there are none
    """

    bases: tuple[Basis, ...]
    lengths: tuple[float, ...]
    z_ids: tuple[int, ...]
    y_ids: tuple[int, ...] = ()
    strips: tuple[int, ...] = ()


@dataclass(frozen=True)
class Expansion:
    """The polynomial space of a block: factor bases and number of modes (degree + 1) in each direction of the shape.

    With homogeneous directions, coefficients are ordered plane (or line) first, modal index fastest.
    """

    shape: Shape
    bases: tuple[Basis, ...]
    modes: tuple[int, ...]
    homogeneous: Homogeneous | None = None


@dataclass(frozen=True, eq=False)
class Block:
    """Elements of one expansion.

    element_ids   (n,)    ids in the file
    coefficients  (n, m)  in the order of format notes 4
    """

    expansion: Expansion
    element_ids: Ints
    coefficients: Floats

    def __len__(self) -> int:
        return len(self.element_ids)

    def of(self, rows: Ints) -> Block:
        """Some of its elements, by their rows."""
        return Block(self.expansion, frozen_ints(self.element_ids[rows]), frozen_floats(self.coefficients[rows]))

    def __repr__(self) -> str:
        return describing.line_of_block(self)


@dataclass(frozen=True, eq=False)
class Field:
    """A scalar field; ``continuous`` is None if the file doesn't say."""

    name: str
    blocks: tuple[Block, ...]
    continuous: bool | None = None

    def __post_init__(self) -> None:
        check_name(self.name, "a field")

    def __repr__(self) -> str:
        return describing.line_of_field(self)


@dataclass(frozen=True)
class ExpansionRule:
    """An entry of the EXPANSIONS section: how a solver would discretise composites (format notes 3).

    kind    MODIFIED, GLL_LAGRANGE, …; or comma-separated bases in the long form
    modes   number of modes, one for all directions or one for each
    points  number of quadrature points in each direction, empty if the default holds
    """

    composites: tuple[int, ...]
    kind: str
    modes: tuple[int, ...]
    fields: tuple[str, ...] = ()
    points: tuple[int, ...] = ()
    point_types: tuple[str, ...] = ()


def rate_name(name: str) -> str:
    """The name of a field's derivative in time."""
    return f"d({name},t)"


def is_rate(name: str) -> bool:
    """Whether a name denotes a field's derivative in time."""
    return name.startswith("d(") and name.endswith(",t)")


class Rates(Protocol):
    """Derivatives in time of the fields of a dataset that is a moment of a series."""

    @property
    def remark(self) -> str:
        """Description of these derivatives; empty until one is requested."""

    @property
    def times(self) -> Floats:
        """(n,) of the steps of the series."""

    def field(self, name: str) -> Field:
        """The derivative of a field, named as `rate_name` says; raises ElvisError if there is none."""

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """The parts of time between steps from one time to another.

        Raises ElvisError if these are not of the series.
        """


@dataclass(frozen=True)
class Deformed:
    """How the geometry of a dataset was deformed (`elvis.core.deformed.deforming`).

    displacement  texts of the components
    scale         their factor
    gradients     where derivatives of quantities are taken: undeformed or deformed
    coordinates   names of the fields that hold the coordinates before the deformation
    told          remarks of the dataset on the deformation
    is_height     whether 2D data became a surface in space, of which the displacement is the height
    folds         whether elements are inverted or folded
    joined        the mesh before elements were separated where the displacement jumps; None if none were
    """

    displacement: tuple[str, ...]
    scale: float
    gradients: str
    coordinates: tuple[str, ...]
    told: tuple[str, ...] = ()
    is_height: bool = False
    folds: bool = False
    joined: Mesh | None = None

    def __str__(self) -> str:
        where = f"gradients are taken in the {self.gradients} configuration"
        if self.is_height:
            return f"the data are drawn on the surface z = {self.scale:.10g} · ({self.displacement[0]}); {where}"
        moved = f"{self.scale:.10g} · ({', '.join(self.displacement)})"
        return f"the geometry is deformed by {moved}; {where}"


@dataclass(frozen=True, eq=False)
class Dataset:
    """A mesh with its fields, time and metadata (free key/text pairs, as in the file).

    expansions  the discretisation of composites that a solver would use
    session  further sections of a native session by tag, such as CONDITIONS, as XML
    remarks  sentences about the origin of the data, which apply to everything derived from them
    rates    derivatives in time of the fields, None if the data are not a moment of a series
    instant  the moment of a series of several steps that the data represent, else None
    others   datasets that expressions may refer to, by name: `ref:p`
    shared   names of the datasets that hold all elements of this one (`differences.common_elements`); their fields
             are also fields of this one, as `field("ref:p")`
    borrowed  names of fields of other datasets, derivatives in time, or jumps, as parts of a dataset hold them
    surfaces  surfaces of the whole by names of boundaries, to which its parts measure distances
    reference  reference values of the flow by name, such as mu (`quantities.reference_values`), which take precedence
               over the metadata
    deformation  how the geometry was deformed, None if it is that of the files
    complexes  names of the real and imaginary parts of complex fields that the user names; at a phase, of all
    phase    in degrees, at which the fields with the names of complex ones are real parts; None: there are none
    """

    mesh: Mesh
    fields: tuple[Field, ...] = ()
    time: float | None = None
    metadata: Mapping[str, str] = default(default_factory=dict)
    expansions: tuple[ExpansionRule, ...] = ()
    session: Mapping[str, str] = default(default_factory=dict)
    remarks: tuple[str, ...] = ()
    rates: Rates | None = None
    instant: Instant | None = None
    others: Mapping[str, Dataset] = default(default_factory=dict)
    shared: Mapping[str, CommonElements] = default(default_factory=dict)
    borrowed: frozenset[str] = frozenset()
    surfaces: Mapping[str, Surface] = default(default_factory=dict)
    reference: Mapping[str, float] = default(default_factory=dict)
    deformation: Deformed | None = None
    complexes: Mapping[str, tuple[str, str]] = default(default_factory=dict)
    phase: float | None = None

    @property
    def map_names(self) -> tuple[str, ...]:
        """Names of the fields that define the map of the elements, empty if only the mesh does."""
        if MAP_KEY not in self.metadata:
            return ()
        return tuple(name.strip() for name in self.metadata[MAP_KEY].split(",") if name.strip()) or MAP_FIELDS

    @property
    def map_fields(self) -> tuple[Field, ...]:
        """The fields that define the map of the elements, see `map_names`."""
        names = self.map_names
        return tuple(own for own in self.fields if own.name in names)

    @property
    def solution(self) -> tuple[Field, ...]:
        """The fields, except borrowed ones and those of the geometry: the map, positions before deformation."""
        places = () if self.deformation is None else self.deformation.coordinates
        apart = {*self.map_names, *self.borrowed, *places}
        return tuple(own for own in self.fields if own.name not in apart)

    def with_others(self, **others: Dataset) -> Dataset:
        """The dataset with others that expressions may use: after ``with_others(ref=other)``, p - ref:p is one."""
        from elvis.core.differences.common_elements import common_elements

        shared = {name: own for name, own in self.shared.items() if name not in others}
        for name, other in others.items():
            common = common_elements(self, other)
            if common.is_whole:
                shared[name] = common
        return replace(self, others={**self.others, **others}, shared=shared)

    def field(self, name: str) -> Field:
        """The field of this name, or a derivative in time; raises KeyError, with a similar name, for an unknown one."""
        for candidate in self.fields:
            if candidate.name == name:
                return candidate
        if self.rates is not None and is_rate(name):
            return self.rates.field(name[2:-3])
        if name.endswith(")"):
            derived = self._derived(name)
            if derived is not None:
                return derived
        owner, _, own = name.partition(":")
        if owner in self.shared:
            return self.shared[owner].field(self.others[owner].field(own), name)
        names = list(self)
        known = f"the fields are {', '.join(names)}" if names else "the data contain no fields"
        raise KeyError(f"there is no field {name!r}{perhaps(str(name), names)}; {known}")

    def __getitem__(self, name: str) -> DatasetField | Quantity:
        """The field of this name, or the quantity that a text says, as a function of the coordinates.

        ``ds["p"](0.4, 0.3, 0.2)`` is a value, ``ds["vorticity"].range`` a certified range.  Raises KeyError, with a
        similar name, for an unknown one.
        """
        from elvis.core.quantities.callables import function_of

        return function_of(self, name)

    def _derived(self, name: str) -> Field | None:
        """The field that a function makes of another one; None for other names."""
        from elvis.core.quantities.derived import derived_of
        from elvis.core.resolution.derived_fields import derived_field

        found = derived_of(name)
        return None if found is None else derived_field(self, name, *found)

    def _ipython_key_completions_(self) -> list[str]:
        """Names that IPython completes after ``ds["``."""
        from elvis.core.quantities.callables import names_of_functions

        return names_of_functions(self)

    @property
    def bounds(self) -> Floats:
        """(2, d) lowest and highest coordinates of the elements, certified: no point of them is outside."""
        from elvis.core.mapping.geometry import geometry
        from elvis.core.quantities.names import Names
        from elvis.core.summary.summary import box

        found = box(self, geometry(self))
        return frozen_floats([found[end][: Names.of(self).dimension] for end in ("lower", "upper")])

    @property
    def n_elements(self) -> int:
        """Number of elements in the domain."""
        return len(self.mesh.domain_ids())

    @property
    def order(self) -> int | None:
        """Highest polynomial order of the fields; None if there are no fields."""
        blocks = (block for field in self.solution for block in field.blocks)
        return max((count - 1 for block in blocks for count in block.expansion.modes), default=None)

    @property
    def boundaries(self) -> tuple[str, ...]:
        """Names of the boundaries, as accepted by ``faces=`` and ``over=``; the id if a boundary has no name."""
        from elvis.core.distances.boundaries import names_of_boundaries

        return tuple(names_of_boundaries(self.mesh))

    @property
    def times(self) -> Floats:
        """(n,) times of the steps of the series that the data are a moment of; otherwise their own time, or empty."""
        if self.rates is not None:
            return frozen_floats(self.rates.times)
        return frozen_floats([] if self.time is None else [self.time])

    def plot(self, quantity: str | None = None, *, ax: Any = None, **keywords: Any) -> Any:
        """A picture, as `render` makes it; notebooks show it, ``.show()`` opens it elsewhere.

        Parameters
        ----------
        quantity : str, optional
            Quantity that colours the picture; by default the first field.
        ax : matplotlib axes, optional
            Axes to draw the picture into (see `Frame.plot`).
        keywords
            Options of `render`.

        Returns
        -------
        Frame
        """
        frame = public("render")(self, *([] if quantity is None else [quantity]), **keywords)
        if ax is not None:
            frame.plot(ax)
        return frame

    def view(self, quantity: str | None = None, **keywords: Any) -> Any:
        """The interactive picture in a notebook, as the function `view` makes it."""
        return public("view")(self, *([] if quantity is None else [quantity]), **keywords)

    def save(self, path: str | Path, **options: Any) -> tuple[Path, ...]:
        """Write the data by the suffix of the name, as the function `write` does; returns the files written."""
        found: tuple[Path, ...] = public("write")(self, path, **options)
        return found

    def __iter__(self) -> Iterator[str]:
        """The names of the fields, without the fields that define the map."""
        return (field.name for field in self.solution)

    def __contains__(self, name: object) -> bool:
        """Whether there is a field of this name."""
        return any(field.name == name for field in self.fields)

    def __repr__(self) -> str:
        return describing.line_of_dataset(self)

    def _repr_html_(self) -> str:
        """The dataset as notebooks show it."""
        return describing.table_of_dataset(self)
