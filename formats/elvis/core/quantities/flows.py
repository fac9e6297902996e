"""The inputs of predefined quantities in a dataset: fields with customary names, metadata, given numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.complex_fields import Pairs
from elvis.core.quantities.configurations import derivative_before
from elvis.core.quantities.elements.sides import DUALS, SIDES
from elvis.core.quantities.predefined import PARAMETERS, QUANTITIES, STEPS, PredefinedQuantity
from elvis.core.quantities.tree import AXES, ZERO, Node, attribute, coordinate, field, number

#: names of quantities, and of their inputs
PUBLIC = tuple(dict.fromkeys(quantity.name for quantity in QUANTITIES))
_VELOCITIES = (
    ("u", "v", "w"),
    ("velocity_x", "velocity_y", "velocity_z"),
    ("Velocity_x", "Velocity_y", "Velocity_z"),
    ("VelocityX", "VelocityY", "VelocityZ"),
    ("v_x", "v_y", "v_z"),
    ("V_x", "V_y", "V_z"),
    ("U_x", "U_y", "U_z"),
    ("vx", "vy", "vz"),
)
_MOMENTA = (
    ("rhou", "rhov", "rhow"),
    ("rho_u", "rho_v", "rho_w"),
    ("momentum_x", "momentum_y", "momentum_z"),
    ("MomentumX", "MomentumY", "MomentumZ"),
)
#: customary names of the components of vectors
VECTORS = (*_VELOCITIES, *_MOMENTA)
_SINGLE = {
    "rho": ("rho", "density", "Density"),
    "p": ("p", "pressure", "Pressure"),
    "E": ("E", "rhoE", "energy", "Energy", "TotalEnergy", "EnergyStagnationDensity"),
    "T": ("T", "temperature", "Temperature"),
    # as `elvis average --wall` writes them
    **{name: (name,) for name in ("TAWSS", "shear_x", "shear_y", "shear_z")},
}
#: names of fields by their symbols in formulas
CUSTOMARY: Mapping[str, tuple[str, ...]] = {
    **{symbol: tuple(family[axis] for family in _VELOCITIES) for axis, symbol in enumerate("uvw")},
    **{f"rho{symbol}": tuple(family[axis] for family in _MOMENTA) for axis, symbol in enumerate("uvw")},
    **_SINGLE,
}
_SHEAR = ("TAWSS, shear_x, …", "statistics of a wall: TAWSS, shear_x, … (elvis average --wall writes them)")
_VELOCITY = ("a velocity", "a velocity: u, v, w, or velocity_x, …, or rho with rhou, …")
#: fields that formulas need: their description, and the description of what the data lack without them
_INGREDIENTS = {
    **dict.fromkeys("uvw", _VELOCITY),
    "rho": ("rho", "a density: rho"),
    "p": ("p or E", "a pressure: p, or E with rho, rhou, …"),
    "T": ("T, or p with rho", "a temperature: T, or p with rho"),
    **dict.fromkeys(("TAWSS", "shear_x", "shear_y", "shear_z"), _SHEAR),
}
#: attributes of elements that formulas may contain
_ATTRIBUTES = (*SIDES, *DUALS, "order")
#: names that are not called
_WORD = re.compile(r"\b[^\W\d]\w*\b(?!\()")


@dataclass(frozen=True, eq=False)
class Missing:
    """The missing inputs of a formula: messages about fields, and groups of parameters, one of each group."""

    fields: tuple[str, ...] = ()
    parameters: tuple[tuple[str, ...], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.fields or self.parameters)

    def __add__(self, other: Missing) -> Missing:
        fields = dict.fromkeys((*self.fields, *other.fields))
        return Missing(tuple(fields), tuple(dict.fromkeys((*self.parameters, *other.parameters))))


@dataclass(frozen=True, eq=False)
class Flow:
    """The ingredients that a dataset has.

    fields      its names
    dimension   number of coordinates that they depend on
    parameters  known numbers by name, as expressions
    undeformed, is_height  names of the fields along which derivatives are taken, see `derivative_before`
    """

    fields: tuple[str, ...]
    dimension: int
    parameters: Mapping[str, Node]
    undeformed: tuple[str, ...] = ()
    is_height: bool = False

    @property
    def shared(self) -> frozenset[str]:
        """See `others`."""
        return frozenset()

    @property
    def places(self) -> tuple[str, ...]:
        """Formulas name no coordinates before a deformation."""
        return ()

    @property
    def others(self) -> Mapping[str, object]:
        """No formula names other datasets."""
        return {}

    @property
    def complexes(self) -> Pairs:
        """No formula has complex fields."""
        return {}

    @property
    def phase(self) -> float | None:
        """No formula depends on a phase."""
        return None

    @property
    def is_incompressible(self) -> bool:
        """Whether the data contain a velocity and a pressure but no density."""
        return {"u", "p"} <= set(self._fields_by_symbol) and "rho" not in self._fields_by_symbol

    @cached_property
    def available(self) -> tuple[str, ...]:
        """The names of quantities for which the fields suffice, and the parameters that are known."""
        return tuple(name for name in self._suitable_names if not self._missing(name))

    @cached_property
    def waiting(self) -> tuple[str, ...]:
        """The names of those for which the fields suffice, that need further parameters."""
        return tuple(name for name in self._suitable_names if (lack := self._missing(name)) and not lack.fields)

    @property
    def _suitable_names(self) -> Iterator[str]:
        """The names of quantities of flows of this dimension, without names of fields."""
        return (name for name in PUBLIC if name not in self.fields and self._entry(name) is not None)

    def catalogue(self) -> list[dict[str, str | None]]:
        """The quantities of flows of this dimension: name, formula, meaning, source, description of missing inputs."""
        found: list[dict[str, str | None]] = []
        for name in self._suitable_names:
            entry, lack = self._entry(name), self._missing(name)
            assert entry is not None
            text = self._suitable(name)[0]
            facts = {"name": name, "formula": text, "meaning": entry.meaning, "source": entry.source or None}
            found.append({**facts, "missing": self._sentence(name, lack) if lack else None})
        return found

    def node(self, name: str, given: Mapping[str, Node]) -> Node:
        """A quantity as an expression of fields; raises ElvisError with its missing inputs.

        given  parameters that take precedence over the parameters of the data
        """
        for key in given:
            self._check(name, key)
        known = {key: node for key, node in self.parameters.items() if key != "mu" or "nu" not in given}
        flow = replace(self, parameters={**known, **given})
        if self._entry(name) is None:
            raise ElvisError(f"{name} needs {self._dimensions_text(name)}, and the data have {self.dimension}")
        lack = flow._missing(name)
        if lack:
            fields = f"the fields are {', '.join(self.fields)}" if self.fields else "the data contain no fields"
            raise ElvisError(flow._sentence(name, lack) + (f"; {fields}" if lack.fields else ""))
        return flow.meaning(name)

    def velocity(self) -> tuple[Node, ...]:
        """The components of the velocity, as many as there are dimensions.

        Raises ElvisError if the fields give none.
        """
        symbols = "uvw"[: self.dimension]
        if any(self._missing(symbol) for symbol in symbols):
            fields = f"the fields are {', '.join(self.fields)}" if self.fields else "the data contain no fields"
            raise ElvisError(f"the data lack {_VELOCITY[1]}; {fields}")
        return tuple(self.meaning(symbol) for symbol in symbols)

    def meaning(self, name: str) -> Node:
        """The meaning of a name in a formula without missing inputs."""
        from elvis.core.quantities.parsing import Parser

        if self._is_beyond(name):
            return ZERO
        if name in self._fields_by_symbol:
            return self._fields_by_symbol[name]
        if name in self.parameters:
            return self.parameters[name]
        default = PARAMETERS[name].default if name in PARAMETERS else None
        if default is not None:
            return number(default)
        if name in _ATTRIBUTES:
            return attribute(name)
        if name in AXES:
            return coordinate(AXES.index(name))
        text = next(text for text in self._formulas(name) if not self._lacking(text))
        return Parser(text, self).whole()

    def quantity(self, name: str, given: Mapping[str, Node]) -> Node:
        """As `node`."""
        return self.node(name, given)

    def unknown(self, name: str) -> str:
        """No name in a formula is unknown."""
        raise AssertionError(f"{name} in a formula")

    def distance(self, target: str) -> Node:
        """No formula has one."""
        raise AssertionError(f"a distance to {target} in a formula")

    def indicator(self, target: str, scale: float) -> Node:
        """No formula has one."""
        raise AssertionError(f"an indicator of {target} in a formula")

    def body_fitted(self, name: str, target: str, assist: Sequence[float]) -> Node:
        """No formula has one."""
        raise AssertionError(f"{name} at {target} in a formula")

    def rate(self, name: str) -> Node:
        """No formula has one."""
        raise AssertionError(f"a derivative of {name} in time in a formula")

    def derivative(self, of: Node, axis: int) -> Node:
        """The derivative along x, y or z."""
        return derivative_before(of, axis, self.undeformed, self.is_height)

    def parameters_of(self, name: str) -> tuple[str, ...]:
        """The parameters that a quantity may need of these data."""
        found: dict[str, None] = {}
        waiting, seen = [name], set[str]()
        while waiting:
            own = waiting.pop()
            if own in seen or own in self._fields_by_symbol:
                continue
            seen.add(own)
            if own in PARAMETERS:
                found[own] = None
            elif own not in _ATTRIBUTES:
                waiting += [word for text in self._suitable(own) for word in _words(text)]
        known = {"density"} if "rho" in self._fields_by_symbol else set()
        return tuple(key for key in PARAMETERS if key in found and key not in known)

    def _check(self, name: str, key: str) -> None:
        """Raise ElvisError if ``key`` is not a parameter of a quantity."""
        used = self.parameters_of(name)
        if key not in used:
            taken = ", ".join(used) or "no parameters"
            raise ElvisError(f"{name} takes {taken} of these data, found {key!r}{perhaps(key, used)}")

    @cached_property
    def _fields_by_symbol(self) -> Mapping[str, Node]:
        """Fields by their symbols in formulas."""
        found: dict[str, Node] = {}
        for symbols, families in (("u v w", _VELOCITIES), ("rhou rhov rhow", _MOMENTA)):
            for family in families:
                own = family[: self.dimension]
                if set(own) <= set(self.fields):
                    found |= dict(zip(symbols.split(), map(field, own), strict=False))
                    found |= dict.fromkeys("uvw"[self.dimension :], ZERO)
                    found |= dict.fromkeys(("rhou", "rhov", "rhow")[self.dimension :], ZERO)
                    break
        for symbol, names in _SINGLE.items():
            known = [name for name in names if name in self.fields]
            if known:
                found[symbol] = field(known[0])
        return found

    def _is_beyond(self, name: str) -> bool:
        """Whether a name is a derivative along an axis that fields don't depend on."""
        return len(name) == 2 and name[0] in "uvwT" and name[1] in AXES[self.dimension :]

    def _entry(self, name: str) -> PredefinedQuantity | None:
        """The quantity of a name in flows of this dimension."""
        return next((own for own in QUANTITIES if own.name == name and self.dimension in own.dimensions), None)

    def _dimensions_text(self, name: str) -> str:
        dimensions = sorted(n for own in QUANTITIES if own.name == name for n in own.dimensions)
        return " or ".join(map(str, dimensions)) + " coordinates"

    def _formulas(self, name: str) -> tuple[str, ...]:
        """The formulas of a step or a quantity, also in flows of fewer dimensions, if others use it."""
        entry = self._entry(name) or next((own for own in QUANTITIES if own.name == name), None)
        return STEPS.get(name, entry.formulas if entry else ())

    def _suitable(self, name: str) -> list[str]:
        """The formulas that the fields suffice for, all if they suffice for none."""
        every = list(self._formulas(name))
        return [text for text in every if not self._lacking(text).fields] or every

    def _missing(self, name: str) -> Missing:
        """The missing inputs of a name in a formula.

        If a name has several formulas, those that only lack parameters count.
        """
        if name not in self._missing_by_name:
            self._missing_by_name[name] = self._missing_now(name)
        return self._missing_by_name[name]

    @cached_property
    def _missing_by_name(self) -> dict[str, Missing]:
        """The results of `_missing`, because formulas of many quantities share their steps."""
        return {}

    def _missing_now(self, name: str) -> Missing:
        if name in self._fields_by_symbol or name in _ATTRIBUTES or self._is_beyond(name):
            return Missing()
        if name in PARAMETERS:
            return self._unset(name)
        every = [self._lacking(text) for text in self._formulas(name)]
        if not every:
            return Missing((name,))
        if any(not lack for lack in every):
            return Missing()
        if name in _INGREDIENTS and all(lack.fields for lack in every):
            return Missing((name,))
        several = [lack for lack in every if not lack.fields] or every[:1]
        if len(several) > 1 and all(len(lack.parameters) == 1 for lack in several):
            return Missing((), (tuple(key for lack in several for key in lack.parameters[0]),))
        return several[0]

    def _unset(self, name: str) -> Missing:
        """The missing inputs of a parameter.

        The density of an incompressible flow is not a parameter if the data have a density.
        """
        if name == "density" and "rho" in self._fields_by_symbol:
            return Missing(("rho",))
        known = name in self.parameters or PARAMETERS[name].default is not None
        return Missing() if known else Missing((), ((name,),))

    def _lacking(self, text: str) -> Missing:
        """The missing inputs of a formula."""
        return sum((self._missing(word) for word in _words(text)), Missing())

    def _sentence(self, name: str, lack: Missing) -> str:
        """A message about the inputs of a quantity and how to provide them."""
        if lack.fields:
            needed = dict.fromkeys(_INGREDIENTS[symbol][0] for symbol in self._ingredients(name))
            absent = dict.fromkeys(_INGREDIENTS[symbol][1] for symbol in lack.fields)
            return f"{name} needs {_in_words(list(needed))}; the data lack {', and '.join(absent)}"
        meanings = [" or ".join(f"{key} ({PARAMETERS[key].meaning})" for key in group) for group in lack.parameters]
        example = ", ".join(f"{group[0]}=…" for group in lack.parameters)
        settings = " ".join(f"{group[0]}=…" for group in lack.parameters)
        return f"{name} needs {_in_words(meanings)}: pass --set {settings}, or write {name}({example})"

    def _ingredients(self, name: str) -> list[str]:
        """The fields that the first formula of a quantity needs."""
        found, waiting = dict[str, None](), [name]
        while waiting:
            own = waiting.pop(0)
            if own in _INGREDIENTS and own != name:
                found[own] = None
            elif formulas := self._formulas(own):
                waiting += _words(formulas[0])
        return [symbol for symbol in _INGREDIENTS if symbol in found]


def _words(text: str) -> list[str]:
    """The names in a formula, but for functions and coordinates, each once."""
    return list(dict.fromkeys(word for word in _WORD.findall(text) if word not in AXES))


def _in_words(parts: list[str]) -> str:
    """With commas and a last "and"."""
    if len(parts) < 3:
        return " and ".join(parts)
    return f"{', '.join(parts[:-1])}, and {parts[-1]}"
