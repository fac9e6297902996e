"""The meaning of names in an expression: fields, coordinates, time, constants, predefined quantities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as field_of
from functools import cached_property

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.complex_fields import Pairs, pairs_in
from elvis.core.data.dataset import Dataset, Deformed, Rates, is_rate
from elvis.core.distances.boundaries import ALL, sides_by_name
from elvis.core.distances.triangle_files import SUFFIXES
from elvis.core.files.plain import check_plain
from elvis.core.quantities.body_fitted import VELOCITIES, body_fitted
from elvis.core.quantities.complex_functions import is_complex
from elvis.core.quantities.configurations import derivative_before
from elvis.core.quantities.derived import DERIVED, derived_rate
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.flows import PUBLIC, Flow
from elvis.core.quantities.indicators import indicator
from elvis.core.quantities.reference_values import REFERENCE, noted_values, over
from elvis.core.quantities.tree import AXES, MEASURES, TIME, Node, attribute, coordinate, field, number

#: predefined quantities by symbols, in lower case, that users know them by
SYMBOLS = {
    "u": "velocity_x",
    "v": "velocity_y",
    "w": "velocity_z",
    "p": "pressure",
    "t": "temperature",
    "ma": "mach",
    "cp": "pressure_coefficient",
    "cf": "skin_friction",
    "yplus": "y_plus",
    "utau": "u_tau",
    "q": "q_criterion",
}

CONSTANTS = {"pi": math.pi, "e": math.e}
#: attributes of elements (see `attributes`), defined in every dataset, with their meaning
ATTRIBUTES: Mapping[str, str] = {
    "element": "id of the element in the file",
    "composite": "id of the first composite or region that contains the element",
    "order": "highest degree of a field on the element",
    "h": "size of the element: the root of its area, the cube root of its volume",
    "shape": "0 segment, 1 triangle, 2 quadrilateral, 3 tetrahedron, 4 pyramid, 5 prism, 6 hexahedron",
    "quality": "mean ratio to the element with equal edges: 1 where it is alike, 0 where it is degenerate or inverted",
    "jacobian": "determinant of the derivative of the element's map",
    "scaled_jacobian": "Jacobian in parts of the lengths of its columns, -1 to 1",
    "jacobian_sign": "1 where the Jacobian is proved to be positive, -1 where it is not, 0 undecided",
    **{f"n{axis}": "component of the outward unit normal; on faces of elements, NaN elsewhere" for axis in AXES},
    "face_height": "height of the element above a face; on faces of elements, NaN elsewhere",
}


@dataclass(frozen=True)
class Names:
    """The names that the expressions of one dataset may use.  A field takes precedence over other meanings of its name.

    fields      names, in the order of the file
    dimension   number of coordinates that fields depend on
    time        time of the data; the value of the name ``t``, if known
    parameters  of the flow, for predefined quantities (`predefined.PARAMETERS`)
    boundaries  names of boundaries to which distances may be measured
    rates       derivatives in time of the fields, if the data are a moment of a series
    others      names in other datasets, by the names of these
    shared      names of the datasets on the same mesh
    deformation how the geometry was deformed, which determines the coordinates of derivatives
    is_moving   whether ``t`` is a variable, as along the path of a particle
    complexes   names of the real and the imaginary part of complex fields
    phase       in degrees, at which fields with these names are real parts; None: there are no such fields
    """

    fields: tuple[str, ...]
    dimension: int = 3
    time: float | None = None
    parameters: Mapping[str, float] = field_of(default_factory=dict)
    boundaries: tuple[str, ...] = ()
    rates: Rates | None = None
    others: Mapping[str, Names] = field_of(default_factory=dict)
    shared: frozenset[str] = frozenset()
    deformation: Deformed | None = None
    is_moving: bool = False
    complexes: Pairs = field_of(default_factory=dict)
    phase: float | None = None

    @staticmethod
    def of(dataset: Dataset) -> Names:
        """The names that a dataset gives."""
        waves = [b.expansion.homogeneous for one in dataset.fields for b in one.blocks if b.expansion.homogeneous]
        dimension = dataset.mesh.space + (len(waves[0].lengths) if waves else 0)
        mesh = dataset.mesh
        named = tuple(sides_by_name(mesh))
        sides = (ALL, *named) if mesh.dimension > 1 else ()
        fields = tuple(one.name for one in dataset.solution)
        others = {name: Names.of(other) for name, other in dataset.others.items()}
        noted, rates = over(noted_values(dataset.metadata), dataset.reference), dataset.rates
        own = Names(fields, dimension, dataset.time, noted, sides, rates, others, frozenset(dataset.shared))
        complexes = dataset.complexes if dataset.phase is not None else {**pairs_in(fields), **dataset.complexes}
        return replace(own, deformation=dataset.deformation, complexes=complexes, phase=dataset.phase)

    @property
    def places(self) -> tuple[str, ...]:
        """Names of the fields that hold the coordinates before a deformation."""
        return () if self.deformation is None else self.deformation.coordinates

    @property
    def _is_height(self) -> bool:
        """Whether 2D data are shown on a surface in space."""
        return self.deformation is not None and self.deformation.is_height

    @property
    def _along(self) -> tuple[str, ...]:
        """Names of the fields along which derivatives are taken; none where the coordinates of the map are these."""
        known = self.deformation
        return known.coordinates if known is not None and known.gradients == "undeformed" else ()

    @cached_property
    def flow(self) -> Flow:
        """The inputs of predefined quantities."""
        known = {name: number(value) for name, value in self.parameters.items()}
        # a height over 2D data is no coordinate of the flow
        dimension = 2 if self._is_height else self.dimension
        return Flow(self.fields, dimension, known, self._along, self._is_height)

    def meaning(self, name: str) -> Node | None:
        """The meaning of a name, None for an unknown name; raises ElvisError if its inputs are missing."""
        if name in self.fields:
            return field(name)
        if name in self.places:
            return field(name)
        if name in AXES:
            return coordinate(AXES.index(name))
        if name == "t" and self.time is not None:
            return TIME if self.is_moving else number(self.time)
        if name in CONSTANTS:
            return number(CONSTANTS[name])
        if name in PUBLIC:
            return self.flow.node(name, {})
        if name in self.parameters:
            return number(self.parameters[name])
        if name == "phase" and self.phase is not None:
            return number(self.phase)
        if is_complex(name, self.complexes):
            raise ElvisError(f"{name} is complex: use abs({name}), arg({name}), real({name}, DEGREES) or --phase")
        return attribute(name) if name in ATTRIBUTES else None

    def derivative(self, of: Node, axis: int) -> Node:
        """The derivative along x, y or z; ElvisError where a part has none that can be evaluated."""
        return derivative_before(of, axis, self._along, self._is_height)

    def quantity(self, name: str, given: Mapping[str, Node]) -> Node:
        """A predefined quantity with some of its parameters; raises ElvisError if it isn't known, or takes others."""
        return self.flow.node(name, given)

    def rate(self, name: str) -> Node:
        """The derivative of a field in time; raises ElvisError if there is none."""
        derived = None if name in self.fields else derived_rate(name, self.rate)
        if derived is not None:
            return derived
        if is_rate(name) and name not in self.fields:
            raise ElvisError(f"expected one derivative in time, found another one of {name}")
        if self.is_moving:
            raise ElvisError(f"there is no derivative of {name} in time along paths")
        if self.rates is None:
            raise ElvisError(f"there is no derivative of {name} in time: expected a series, found one state")
        return field(self.rates.field(name).name)

    def distance(self, target: str) -> Node:
        """The distance to a boundary or to a file's triangles; raises ElvisError if there are none."""
        if target not in self.boundaries:
            if not target.lower().endswith(SUFFIXES):
                known = f"; there are {', '.join(self.boundaries)}" if self.boundaries else ""
                meant = perhaps(target, [name for name in self.boundaries if name != ALL])
                raise ElvisError(
                    f"there is no boundary {target!r}{meant}{known}; files of triangles end in {', '.join(SUFFIXES)}"
                )
            check_plain(target)
        return attribute(f"distance({target})")

    def indicator(self, target: str, scale: float) -> Node:
        """The smoothed indicator of a closed file of triangles; raises ElvisError for others."""
        return indicator(self.distance(target), target, scale)

    def body_fitted(self, name: str, target: str, assist: Sequence[float]) -> Node:
        """A component of the velocity, or of a direction, at a wall; raises ElvisError if there is none."""
        self.distance(target)
        velocity = self.flow.velocity() if name in VELOCITIES else ()
        return body_fitted(name, target, assist, self.flow.dimension, velocity)

    def unknown(self, name: str) -> str:
        """A message about an unknown name."""
        if name == "t":
            return "the data don't contain the time t"
        if name in REFERENCE:
            return f"the data don't contain {name} ({REFERENCE[name]}): pass --set {name}=…"
        if name in self.others:
            first = (*self.others[name].fields, "x")[0]
            return f"expected : after {name}and a quantity, such as {name}:{first}"
        known = [*self.fields, *self.flow.available, *self.flow.waiting, *ATTRIBUTES]
        symbol = SYMBOLS.get(name.lower(), "")
        is_near = any(own.lower() == name.lower() for own in known)
        meant = f" (perhaps {symbol})" if symbol in known and not is_near else perhaps(name, known)
        return f"there is no {name!r}{meant}; {self._in_words}"

    def attributes(self) -> list[dict[str, str | None]]:
        """Rows of the quantities of elements whose names no field has, in the form of `Flow.catalogue`."""
        rest = {"formula": None, "source": None, "missing": None}
        own = ((name, meaning) for name, meaning in ATTRIBUTES.items() if name not in self.fields)
        return [{"name": name, "meaning": meaning, **rest} for name, meaning in own]

    @property
    def of_elements(self) -> tuple[str, ...]:
        """Names of the quantities that every point of an element has, without fields."""
        return tuple(name for name in ATTRIBUTES if name not in (*self.fields, *SIDES))

    @property
    def of_resolution(self) -> tuple[str, ...]:
        """Functions of single fields that show how well these are resolved."""
        plain = [name for name in self.fields if name.isidentifier()]
        return tuple(f"{function}({name})" for name in plain for function in (*MEASURES, *DERIVED))

    @property
    def _in_words(self) -> str:
        """All names as text, without predefined quantities, which are many."""
        known = f"the fields are {', '.join(self.fields)}" if self.fields else "the data contain no fields"
        others = (
            *AXES,
            *(("t",) if self.time is not None else ()),
            *CONSTANTS,
            *ATTRIBUTES,
            *(f"{name}:…" for name in self.others),
        )
        listed = ", and what elvis info --quantities lists" if self.flow.available or self.flow.waiting else ""
        return f"{known}; there are also {', '.join(others)}{listed}"
