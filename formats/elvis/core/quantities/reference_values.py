"""Reference values of a flow, such as its viscosity: numbers that belong to the data as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf, isfinite

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.quantities.predefined import PARAMETERS

#: values that coefficients of forces need, in addition to the values for quantities
_OF_COEFFICIENTS = {"length": "reference length of moments", "area": "reference area of forces, in 2D a length"}
#: all values by name, with their meaning
REFERENCE: Mapping[str, str] = {**{name: own.meaning for name, own in PARAMETERS.items()}, **_OF_COEFFICIENTS}
#: values that may be zero or negative
_SIGNED = frozenset({"p_ref", "x_ref", "y_ref", "z_ref"})


def checked_reference(values: Mapping[str, object], place: str) -> dict[str, float]:
    """Values as numbers; ElvisError, which begins with ``place``, for unknown names and for impossible numbers."""
    found: dict[str, float] = {}
    for name, value in values.items():
        if name not in REFERENCE:
            known = f"{perhaps(name, REFERENCE)}; there are {', '.join(REFERENCE)}"
            raise ElvisError(f"{place}: there is no reference value {name!r}{known}")
        least, expected = _limit(name)
        number = _number(value)
        if number is None or not number > least:
            raise ElvisError(f"{place}: {name} ({REFERENCE[name]}): expected {expected}, found {value!r}")
        found[name] = number
    return found


def _limit(name: str) -> tuple[float, str]:
    """Lower bound of a value, and a description of valid values."""
    if name in _SIGNED:
        return -inf, "a finite number"
    return (1.0, "a number above 1") if name == "gamma" else (0.0, "a positive number")


def reference_in(texts: Iterable[str]) -> dict[str, float]:
    """``NAME=VALUE`` texts, or several of them with commas or blanks between.

    Raises ElvisError as `checked_reference`.
    """
    given: dict[str, object] = {}
    for part in (part for text in texts for part in text.replace(",", " ").split()):
        name, equals, value = part.partition("=")
        if not equals:
            raise ElvisError(f"--set: expected NAME=VALUE, such as mu=2e-4, found {part!r}")
        given[name] = value
    return checked_reference(given, "--set")


def over(known: Mapping[str, float], given: Mapping[str, float]) -> dict[str, float]:
    """Known values, replaced by given ones; one given viscosity also replaces the other."""
    viscosities = {"mu", "nu"}
    is_new = bool(viscosities & given.keys())
    return {**{name: value for name, value in known.items() if not (is_new and name in viscosities)}, **given}


def noted_values(notes: Mapping[str, str]) -> dict[str, float]:
    """The values that a solver has noted by customary names, as far as they make sense."""
    noted = {key.lower(): text for key, text in notes.items()}
    found: dict[str, float] = {}
    for name, parameter in PARAMETERS.items():
        for key in parameter.keys:
            value = _number(noted.get(key))
            if value is not None and 0 < value < inf and (name != "gamma" or 1 < value < 10):
                found.setdefault(name, value)
    return found


def _number(value: object) -> float | None:
    """A finite number, None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if isfinite(number) else None
