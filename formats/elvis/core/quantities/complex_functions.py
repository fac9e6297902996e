"""Functions of complex fields, as expressions of their real and imaginary parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from elvis.core.base.errors import ElvisError
from elvis.core.data.complex_fields import Pairs, components_of, cosine_and_sine
from elvis.core.quantities.tree import Node, call, dot, field, number

#: a whole turn in degrees
_TURN = 360.0


def modulus(name: str, pairs: Pairs) -> Node:
    """|E| = sqrt(Re(E)^2 + Im(E)^2)."""
    real, imaginary = _parts(name, pairs)
    return call("sqrt", call("+", _square(real), _square(imaginary)))


def argument(name: str, pairs: Pairs) -> Node:
    """The angle of E in radians, from -pi to pi."""
    real, imaginary = _parts(name, pairs)
    return call("atan2", imaginary, real)


def real_part(name: str, pairs: Pairs) -> Node:
    """Re(E)."""
    return _parts(name, pairs)[0]


def imaginary_part(name: str, pairs: Pairs) -> Node:
    """Im(E)."""
    return _parts(name, pairs)[1]


def real_at(name: str, pairs: Pairs, degrees: float, phase: float | None) -> Node:
    """Re(E exp(i phase)), a linear combination of two fields.

    phase  in degrees, at which the dataset has fields of the complex names
    """
    if phase is not None and (degrees - phase) % _TURN == 0.0 and name in pairs:
        return field(name)
    real, imaginary = _parts(name, pairs)
    cosine, sine = cosine_and_sine(degrees)
    return call("-", call("*", number(cosine), real), call("*", number(sine), imaginary))


def amplitude(name: str, pairs: Pairs) -> Node:
    """The largest length of the vector Re(E exp(i phase)) over a period; for a scalar |E|.

    The vector runs around an ellipse.  With a = |Re E|^2, b = |Im E|^2 and c = Re E . Im E its squared length at a
    phase is (a + b)/2 + (a - b)/2 cos(2 phase) - c sin(2 phase), at most (a + b)/2 + sqrt(((a - b)/2)^2 + c^2).
    """
    if name in pairs:
        return modulus(name, pairs)
    names = _components(name, pairs)
    parts = [_parts(each, pairs) for each in names]
    reals, imaginaries = [real for real, _ in parts], [imaginary for _, imaginary in parts]
    a, b, c = dot(reals, reals), dot(imaginaries, imaginaries), dot(reals, imaginaries)
    half, apart = number(0.5), call("-", a, b)
    mean = call("*", half, call("+", a, b))
    swing = call("sqrt", call("+", _square(call("*", half, apart)), _square(c)))
    return call("sqrt", call("+", mean, swing))


#: functions of one complex field; of real ones they have the meaning of the other functions
OF_ONE: Mapping[str, Callable[[str, Pairs], Node]] = {
    "abs": modulus,
    "arg": argument,
    "real": real_part,
    "imag": imaginary_part,
    "amplitude": amplitude,
}


def is_complex(name: str, pairs: Pairs) -> bool:
    """Whether a name is a complex field or vector."""
    return name in pairs or bool(_components(name, pairs))


def _components(name: str, pairs: Pairs) -> list[str]:
    """Names of the components of a complex vector, three or two; none for other names."""
    return components_of(name, tuple(pairs), 3) or components_of(name, tuple(pairs), 2)


def _parts(name: str, pairs: Pairs) -> tuple[Node, Node]:
    if name not in pairs:
        names = ", ".join(_components(name, pairs))
        raise ElvisError(f"{name} is a vector: use one of its components {names}, or amplitude({name})")
    real, imaginary = pairs[name]
    return field(real), field(imaginary)


def _square(a: Node) -> Node:
    return call("*", a, a)
