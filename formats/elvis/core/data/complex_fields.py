"""Complex fields: pairs of real fields that hold the real and the imaginary part.

A field E = E_re + i E_im stands for the oscillation Re(E exp(i phase)) = E_re cos(phase) - E_im sin(phase).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, fmod, isfinite, radians, sin

from elvis.core.base.errors import ElvisError

#: the sentences of options and keys
COMPLEX_HELP = (
    "Complex field in addition to pairs such as E_re and E_im: its name, real and imaginary part, which are fields or "
    "vectors."
)
PHASE_HELP = (
    "Phase in degrees at which complex fields are shown: the field E is then the real part of E exp(i phase), and "
    "phase a number in expressions."
)

#: a name with a mark of the real or imaginary part, before the suffix of a component; and the pairs of marks
_MARKED = re.compile(r"(.+?)_(re|real)(_\w+)?")
_IMAGINARY = {"re": "im", "real": "imag"}
#: how the components of a vector end in the files of solvers
_AXES = ("x", "y", "z")
SUFFIXES = (
    tuple(f"_{axis}" for axis in _AXES),
    _AXES,
    ("_1", "_2", "_3"),
    ("_0", "_1", "_2"),
    ("1", "2", "3"),
    ("0", "1", "2"),
)

#: names of the real and the imaginary part by the name of the complex field
Pairs = Mapping[str, tuple[str, str]]


@dataclass(frozen=True)
class ComplexChoice:
    """User settings of complex fields.

    named  texts ``E=Er,Ei``
    phase  in degrees, None if only the parts are wanted
    """

    named: tuple[str, ...] = ()
    phase: float | None = None

    def __post_init__(self) -> None:
        if self.phase is not None and not isfinite(self.phase):
            raise ElvisError(f"--phase: expected a finite number of degrees, found {self.phase:g}")

    def __bool__(self) -> bool:
        return bool(self.named) or self.phase is not None


def named_pairs(texts: Sequence[str], known: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Complex fields in texts ``E=Er,Ei``, where Er and Ei are fields, or both vectors.

    Raises
    ------
    ElvisError
        For another form, unknown fields, and names that are taken.
    """
    found: dict[str, tuple[str, str]] = {}
    for text in texts:
        name, equals, parts = (part.strip() for part in text.partition("="))
        real, comma, imaginary = (part.strip() for part in parts.partition(","))
        if not (name.isidentifier() and equals and comma and real and imaginary):
            raise ElvisError(f"--complex: expected NAME=REAL,IMAGINARY, such as E=Er,Ei, found {text!r}")
        for component, pair in _pairs_of(name, real, imaginary, known).items():
            if component in known or component in found:
                raise ElvisError(f"--complex: expected a name that no field has, found {component}")
            found[component] = pair
    return found


def _pairs_of(name: str, real: str, imaginary: str, known: Sequence[str]) -> dict[str, tuple[str, str]]:
    """A complex field, or the components of a complex vector, by name."""
    if real in known and imaginary in known:
        return {name: (real, imaginary)}
    for suffixes in SUFFIXES:
        present = [end for end in suffixes if real + end in known and imaginary + end in known]
        if present == list(suffixes[: len(present)]) and present:
            return {f"{name}_{axis}": (real + end, imaginary + end) for axis, end in zip(_AXES, present, strict=False)}
    absent = real if not any(each.startswith(real) for each in known) else imaginary
    raise ElvisError(f"--complex: expected fields or vectors, found {absent}; the fields are {', '.join(known)}")


def pairs_in(known: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Complex fields among names: ``E_re`` and ``E_im`` are E, ``E_re_x`` and ``E_im_x`` are E_x; so are real and imag.

    A name that a field has is left to that field.
    """
    found: dict[str, tuple[str, str]] = {}
    for real in known:
        marked = _MARKED.fullmatch(real)
        if marked is None:
            continue
        name, mark, suffix = marked[1], marked[2], marked[3] or ""
        imaginary = f"{name}_{_IMAGINARY[mark]}{suffix}"
        if imaginary in known and name + suffix not in known:
            found.setdefault(name + suffix, (real, imaginary))
    return found


def components_of(name: str, known: Sequence[str], count: int) -> list[str]:
    """Names of the first components of a vector, in the order of the coordinates; empty if there is none."""
    for suffixes in SUFFIXES:
        names = [name + suffix for suffix in suffixes[:count]]
        if set(known).issuperset(names):
            return names
    return []


def missing_components(name: str, known: Sequence[str], count: int) -> list[str]:
    """Names that a vector lacks of which other components are known; empty where none is known."""
    for suffixes in SUFFIXES:
        names = [name + suffix for suffix in suffixes[:count]]
        missing = [each for each in names if each not in known]
        if len(missing) < count:
            return missing
    return []


def cosine_and_sine(degrees: float) -> tuple[float, float]:
    """Cosine and sine of an angle, exact at multiples of 90 degrees; the same for all whole turns."""
    turned = fmod(degrees, 360.0)
    quarters = round(turned / 90.0)
    # |rest| <= 45 degrees
    rest = radians(turned - 90.0 * quarters)
    cosine, sine = cos(rest), sin(rest)
    for _ in range(quarters % 4):
        cosine, sine = -sine, cosine
    # no negative zeros
    return cosine + 0.0, sine + 0.0
