"""How many coefficients an element has, in closed form: sizes are known before anything is read (format notes 4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from elvis.core.arrays import Ints
from elvis.core.errors import FormatError
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape

#: more modes in one direction than any solver uses; a bound on what a damaged file can ask for
MOST_MODES = 1024

_LINE = frozenset(Basis) - {
    Basis.NONE,
    Basis.ORTHO_B,
    Basis.MODIFIED_B,
    Basis.ORTHO_C,
    Basis.MODIFIED_C,
    Basis.ORTHO_PYR_C,
    Basis.MODIFIED_PYR_C,
}
_B = frozenset({Basis.ORTHO_B, Basis.MODIFIED_B})
_C = frozenset({Basis.ORTHO_C, Basis.MODIFIED_C})
_PYRAMID_C = frozenset({Basis.ORTHO_PYR_C, Basis.MODIFIED_PYR_C})
_FACTORS: Mapping[Shape, tuple[frozenset[Basis], ...]] = {
    Shape.SEGMENT: (_LINE,),
    Shape.TRIANGLE: (_LINE, _B),
    Shape.QUADRILATERAL: (_LINE, _LINE),
    Shape.TETRAHEDRON: (_LINE, _B, _C),
    Shape.PYRAMID: (_LINE, _LINE, _PYRAMID_C),
    Shape.PRISM: (_LINE, _LINE, _B),
    Shape.HEXAHEDRON: (_LINE, _LINE, _LINE),
}

#: pairs of directions whose numbers of modes must ascend, by shape
_ASCENDING: Mapping[Shape, tuple[tuple[int, int], ...]] = {
    Shape.TRIANGLE: ((0, 1),),
    Shape.PRISM: ((0, 2),),
    Shape.PYRAMID: ((0, 2), (1, 2)),
    Shape.TETRAHEDRON: ((0, 1), (1, 2)),
}


def _triangle(p: Ints, q: Ints) -> Ints:
    return p * (p + 1) // 2 + p * (q - p)


def _tetrahedron(p: Ints, q: Ints, r: Ints) -> Ints:
    """The sum over i < p, j < q - i of r - i - j."""
    twelvefold: Ints = 12 * p * q * r - 6 * p * q * (q - 1) - 3 * (2 * r + 1) * p * (p - 1) + p * (p - 1) * (2 * p - 1)
    return twelvefold // 12


def _pyramid(p: Ints, q: Ints, r: Ints) -> Ints:
    """The sum over i < p, j < q of r - max(i, j)."""
    low, high = np.minimum(p, q), np.maximum(p, q)
    square: Ints = low * low * r - low * (low - 1) * (4 * low + 1) // 6
    rest: Ints = low * ((high - low) * r - (high * (high - 1) - low * (low - 1)) // 2)
    return square + rest


_COUNTS: Mapping[Shape, Callable[..., Ints]] = {
    Shape.SEGMENT: lambda p: p,
    Shape.TRIANGLE: _triangle,
    Shape.QUADRILATERAL: lambda p, q: p * q,
    Shape.TETRAHEDRON: _tetrahedron,
    Shape.PYRAMID: _pyramid,
    Shape.PRISM: lambda p, q, r: q * _triangle(p, r),
    Shape.HEXAHEDRON: lambda p, q, r: p * q * r,
}


def coefficient_counts(shape: Shape, modes: Ints) -> Ints:
    """(k,) numbers of coefficients for the numbers of modes (k, d), one row an element.

    FormatError where a number isn't in 1 to MOST_MODES, or they don't ascend on a collapsed shape.
    """
    outside = (modes < 1) | (modes > MOST_MODES)
    if outside.any():
        raise FormatError(f"expected 1 to {MOST_MODES} modes in a direction, found {modes[outside].flat[0]}")
    for low, high in _ASCENDING.get(shape, ()):
        wrong = np.flatnonzero(modes[:, low] > modes[:, high])
        if len(wrong):
            found = ",".join(map(str, modes[wrong[0]].tolist()))
            raise FormatError(f"expected ascending numbers of modes on a {shape.label.lower()}, found {found}")
    return _COUNTS[shape](*modes.T.astype(np.int64))


def check_bases(shape: Shape, bases: tuple[Basis, ...]) -> None:
    """FormatError where a shape can't have these bases; data from before 5.0 on pyramids are named as such."""
    if shape is Shape.PYRAMID and Basis.MODIFIED_C in bases:
        message = "expected ModifiedPyr_C on pyramids, found Modified_C: written before version 5.0, in another layout"
        raise FormatError(message)
    allowed = _FACTORS[shape]
    if len(bases) != len(allowed) or any(b not in set_ for b, set_ in zip(bases, allowed, strict=True)):
        found = ",".join(basis.label for basis in bases) or "none"
        raise FormatError(f"expected {len(allowed)} bases that fit a {shape.label.lower()}, found {found}")
