"""Modes of an expansion: their number, order, values and gradients on every shape (format notes 2.2 and 4).

A mode is a product of one-dimensional factors in the collapsed coordinates.  Gradients are taken in the reference
coordinates xi; the factors 1/(1 - eta) of the chain rule are cancelled before anything is evaluated, so gradients are
finite and right, also at collapsed vertices and edges.  On a pyramid the gradient at the apex depends on the direction:
the one given belongs to the guarded eta of `collapse`.

With homogeneous directions the points carry one extra coordinate zeta in [-1, 1] for each; z = LZ (1 + zeta)/2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import Expansion, Homogeneous
from elvis.core.polynomials import factors as f
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import collapse
from elvis.core.shapes import TENSOR, Shape

#: bases of homogeneous directions
FOURIER = (Basis.FOURIER, Basis.FOURIER_SINGLE_MODE, Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM)
_MODIFIED = (Basis.MODIFIED_A,)
_ORTHO = (Basis.ORTHO_A, Basis.LEGENDRE)
_LAGRANGE = (Basis.GLL_LAGRANGE, Basis.GAUSS_LAGRANGE)
#: bases of one coordinate
LINE = (*_MODIFIED, *_ORTHO, *_LAGRANGE, Basis.CHEBYSHEV, Basis.MONOMIAL, *FOURIER)

#: families a shape can carry: for each direction the bases that go together
FAMILIES: Mapping[Shape, tuple[tuple[tuple[Basis, ...], ...], ...]] = {
    Shape.SEGMENT: ((LINE,),),
    Shape.QUADRILATERAL: ((LINE, LINE),),
    Shape.HEXAHEDRON: ((LINE, LINE, LINE),),
    Shape.TRIANGLE: ((_MODIFIED, (Basis.MODIFIED_B,)), (_ORTHO, (Basis.ORTHO_B,))),
    Shape.PRISM: ((_MODIFIED, LINE, (Basis.MODIFIED_B,)), (_ORTHO, LINE, (Basis.ORTHO_B,))),
    Shape.PYRAMID: (
        (_MODIFIED, _MODIFIED, (Basis.MODIFIED_PYR_C,)),
        (_ORTHO, _ORTHO, (Basis.ORTHO_PYR_C,)),
    ),
    Shape.TETRAHEDRON: (
        (_MODIFIED, (Basis.MODIFIED_B,), (Basis.MODIFIED_C,)),
        (_ORTHO, (Basis.ORTHO_B,), (Basis.ORTHO_C,)),
    ),
}

#: pairs of directions whose numbers of modes must not decrease
ASCENDING: Mapping[Shape, tuple[tuple[int, int], ...]] = {
    Shape.SEGMENT: (),
    Shape.QUADRILATERAL: (),
    Shape.HEXAHEDRON: (),
    Shape.TRIANGLE: ((0, 1),),
    Shape.PRISM: ((0, 2),),
    Shape.PYRAMID: ((0, 2), (1, 2)),
    Shape.TETRAHEDRON: ((0, 1), (1, 2)),
}


def check(expansion: Expansion) -> None:
    """Raise FormatError with the reason if bases or orders do not fit the shape."""
    shape, bases, modes = expansion.shape, expansion.bases, expansion.modes
    place = f"{shape.label} expansion"
    if len(bases) != shape.dimension or len(modes) != shape.dimension:
        found = f"{len(bases)} and {len(modes)}"
        raise FormatError(f"expected {shape.dimension} bases and orders, found {found}", place=place)
    if not any(all(b in some for b, some in zip(bases, family, strict=True)) for family in FAMILIES[shape]):
        names = ", ".join(basis.label for basis in bases)
        raise FormatError(f"expected bases that belong together on this shape, found {names}", place=place)
    if min(modes) < 1:
        raise FormatError(f"expected at least one mode in each direction, found {_modes_text(modes)}", place=place)
    for first, second in ASCENDING[shape]:
        if modes[first] > modes[second]:
            rule = f"no more modes in direction {first + 1} than in direction {second + 1}"
            raise FormatError(f"expected {rule}, found {_modes_text(modes)}", place=place)
    for basis, count in zip(bases, modes, strict=True):
        _check_count(basis, count, place)
    if expansion.homogeneous is not None:
        _check_homogeneous(expansion.homogeneous, place)


def _check_count(basis: Basis, count: int, place: str) -> None:
    if basis is Basis.GLL_LAGRANGE and count < 2:
        raise FormatError(f"expected at least two GLL_Lagrange modes, found {count}", place=place)
    if basis is Basis.FOURIER and count % 2:
        raise FormatError(f"expected an even number of Fourier modes, found {count}", place=place)


def _check_homogeneous(planes: Homogeneous, place: str) -> None:
    directions = len(planes.bases)
    if planes.strips:
        raise FormatError("expected no homogeneous strips, which this project does not read", place=place)
    if directions not in (1, 2) or len(planes.lengths) != directions:
        found = f"{directions} bases and {len(planes.lengths)} lengths"
        raise FormatError(
            f"expected one basis and one length for each homogeneous direction, found {found}", place=place
        )
    if any(basis not in FOURIER for basis in planes.bases):
        names = ", ".join(basis.label for basis in planes.bases)
        raise FormatError(f"expected Fourier bases in homogeneous directions, found {names}", place=place)
    if not planes.z_ids or len(planes.y_ids) != (len(planes.z_ids) if directions == 2 else 0):
        found = f"{len(planes.z_ids)} z and {len(planes.y_ids)} y numbers"
        raise FormatError(f"expected a Fourier number for each plane or line, found {found}", place=place)


def _modes_text(modes: tuple[int, ...]) -> str:
    return "x".join(map(str, modes))


@dataclass(frozen=True, eq=False)
class ProductPlan:
    """The structure of modes, independent of points: mode j is the product over directions i of factor ``index[i][j]``.

    modes    (m, d) indices of the modes of the shape, without homogeneous directions
    factors  distinct factor functions of each direction
    index    (m,)    for each direction, the factor of each mode
    """

    modes: Ints
    factors: tuple[f.Factors, ...]
    index: tuple[Ints, ...]

    @cached_property
    def lines(self) -> tuple[Ints, ...]:
        """For each direction the factor of each index (k,): on tensor shapes modes are all products of these."""
        return tuple(
            own[np.unique(mode, return_index=True)[1]] for own, mode in zip(self.index, self.modes.T, strict=True)
        )


@bounded_cache
def product_plan(expansion: Expansion) -> ProductPlan:
    """The modes as products of factors; raises FormatError for an expansion that cannot be."""
    check(expansion)
    modes = _spatial_modes(expansion.shape, expansion.modes)
    pairs = [_direction(expansion, modes, i) for i in range(expansion.shape.dimension)]
    return ProductPlan(modes, tuple(pair[0] for pair in pairs), tuple(pair[1] for pair in pairs))


def _spatial_modes(shape: Shape, counts: tuple[int, ...]) -> Ints:
    """(m, d) indices of all modes, in the order of format notes 4."""
    if shape in TENSOR:  # the first index is fastest
        return frozen_ints(np.indices(counts[::-1]).reshape(len(counts), -1)[::-1].T)
    index = np.indices(counts).reshape(len(counts), -1)
    if shape is Shape.TRIANGLE:
        keep = index[1] < counts[1] - index[0]
    elif shape is Shape.PRISM:
        keep = index[2] < counts[2] - index[0]
    elif shape is Shape.PYRAMID:
        keep = index[2] < counts[2] - np.maximum(index[0], index[1])
    else:
        keep = (index[1] < counts[1] - index[0]) & (index[2] < counts[2] - index[0] - index[1])
    return frozen_ints(index[:, keep].T)


def _direction(expansion: Expansion, modes: Ints, i: int) -> tuple[f.Factors, Ints]:
    """The distinct factors of direction i and the (m,) factor of each mode."""
    basis, p = expansion.bases[i], modes[:, i]
    if basis not in _ROWS:
        return f.LineFactors(basis, expansion.modes[i]), p
    rows = _ROWS[basis](modes, i)
    if expansion.bases[0] is Basis.MODIFIED_A:
        corrected = _constant_modes(expansion.shape, modes, i)
        rows[corrected] = f.constant(int(corrected.sum()))
    distinct, index = np.unique(rows, axis=0, return_inverse=True)
    return f.JacobiFactors(frozen_ints(distinct)), frozen_ints(index.reshape(-1))


#: factors of the modes (m, d) in direction i
_ROWS: Mapping[Basis, Callable[[Ints, int], Ints]] = {
    Basis.MODIFIED_A: lambda modes, i: f.modified_a(modes[:, i]),
    Basis.ORTHO_A: lambda modes, i: f.ortho_a(modes[:, i]),
    Basis.LEGENDRE: lambda modes, i: f.ortho_a(modes[:, i]),
    Basis.MODIFIED_B: lambda modes, i: f.modified_b(modes[:, 0], modes[:, i]),
    Basis.ORTHO_B: lambda modes, i: f.ortho_b(modes[:, 0], modes[:, i]),
    Basis.MODIFIED_C: lambda modes, i: f.modified_c(*modes.T),
    Basis.MODIFIED_PYR_C: lambda modes, i: f.modified_pyr_c(*modes.T),
    Basis.ORTHO_C: lambda modes, i: f.ortho_c(*modes.T),
    Basis.ORTHO_PYR_C: lambda modes, i: f.ortho_c(*modes.T),
}


def _constant_modes(shape: Shape, modes: Ints, i: int) -> Bools:
    """(m,) modes of a Modified expansion with factor 1 in direction i: the modes of collapsed vertices and edges."""
    p, last = modes[:, 0], modes[:, -1]
    nothing = np.zeros(len(modes), bool)
    if shape in (Shape.TRIANGLE, Shape.PRISM):
        return (p == 0) & (last == 1) if i == 0 else nothing
    if shape not in (Shape.PYRAMID, Shape.TETRAHEDRON):
        return nothing
    apex = (p == 0) & (modes[:, 1] == 0) & (last == 1)
    edge = (p == 0) & (modes[:, 1] == 1) if shape is Shape.TETRAHEDRON else nothing
    return (apex | edge, apex, nothing)[i]


def mode_count(expansion: Expansion) -> int:
    """Number of coefficients of one element, over all planes; raises FormatError for an expansion that cannot be."""
    planes = expansion.homogeneous
    return len(product_plan(expansion).modes) * (len(planes.z_ids) if planes else 1)


def mode_indices(expansion: Expansion) -> Ints:
    """(m, d) indices of the modes in coefficient order; homogeneous directions give Fourier numbers, last."""
    modes, planes = product_plan(expansion).modes, expansion.homogeneous
    if planes is None:
        return modes
    numbers = np.array(_numbers(planes), np.int64).T
    return frozen_ints(np.hstack([np.tile(modes, (len(numbers), 1)), np.repeat(numbers, len(modes), axis=0)]))


def _numbers(planes: Homogeneous) -> tuple[tuple[int, ...], ...]:
    """Fourier numbers of all planes for each homogeneous direction, y before z."""
    return (planes.y_ids, planes.z_ids) if len(planes.bases) == 2 else (planes.z_ids,)


def is_factored(expansion: Expansion) -> bool:
    """Whether an expansion is a tensor product in the coordinates of its shape, without homogeneous directions."""
    return expansion.shape in TENSOR and expansion.homogeneous is None


def dimension(expansion: Expansion) -> int:
    """Number of reference coordinates: of the shape, and one for each homogeneous direction."""
    return expansion.shape.dimension + (len(expansion.homogeneous.bases) if expansion.homogeneous else 0)


def values(expansion: Expansion, points: Floats) -> Floats:
    """(n, m) values of all modes at the reference points xi (n, d)."""
    plan, xi, zeta = _split(expansion, points)
    eta = collapse(expansion.shape, xi)
    tables = [part.values(eta[:, i]) for i, part in enumerate(plan.factors)]
    if expansion.shape in TENSOR:
        modes = _lattice_product(*_taken(tables, plan.lines))
    else:
        modes = _product(*_taken(tables, plan.index))
    spatial = np.ascontiguousarray(modes.T)
    if expansion.homogeneous is None:
        return spatial
    return _outer(wave_values(expansion.homogeneous, zeta), spatial)


def wave_values(planes: Homogeneous, zeta: Floats) -> Floats:
    """(n, l) values of the Fourier factor of each plane or line at coordinates zeta (n, p)."""
    return _product(*(pair[0] for pair in _waves(planes, zeta)))


def line_values(expansion: Expansion, lines: Sequence[Floats]) -> list[Floats]:
    """For each direction i of the shape, the factors (n_i, m) of all modes at collapsed coordinates (n_i,).

    On the lattice of such lines modes are their products.
    """
    plan = product_plan(expansion)
    tables = [part.values(line) for part, line in zip(plan.factors, lines, strict=True)]
    return [np.ascontiguousarray(table.T) for table in _taken(tables, plan.index)]


def values_and_gradients(expansion: Expansion, points: Floats) -> tuple[Floats, Floats]:
    """(n, m) values and (n, d, m) gradients in xi of all modes at the reference points xi (n, d)."""
    plan, xi, zeta = _split(expansion, points)
    eta = collapse(expansion.shape, xi)
    tables = [part.tables(eta[:, i]) for i, part in enumerate(plan.factors)]
    if expansion.shape in TENSOR:
        modes, slopes = _of_lattice(*(_taken([table[k] for table in tables], plan.lines) for k in range(2)))
    else:
        v, s, w = (_taken([table[k] for table in tables], plan.index) for k in range(3))
        modes, slopes = _product(*v), _GRADIENTS[expansion.shape]((1 + eta.T) / 2, v, s, w)
    spatial = np.ascontiguousarray(modes.T)
    gradients = np.empty((len(spatial), len(slopes), len(modes)))
    for i, slope in enumerate(slopes):
        gradients[:, i] = slope.T
    if expansion.homogeneous is None:
        return spatial, gradients

    # product rule with the Fourier factors
    waves = _waves(expansion.homogeneous, zeta)
    plane = _product(*(pair[0] for pair in waves))
    columns = [_outer(plane, gradients[:, i]) for i in range(gradients.shape[1])]
    for i in range(len(waves)):
        columns.append(_outer(_product(*(pair[int(i == j)] for j, pair in enumerate(waves))), spatial))
    return _outer(plane, spatial), np.stack(columns, axis=1)


def _split(expansion: Expansion, points: Floats) -> tuple[ProductPlan, Floats, Floats]:
    """The plan, the spatial and the homogeneous coordinates."""
    plan, coordinates = product_plan(expansion), np.asarray(points, np.float64)
    expected = dimension(expansion)
    if coordinates.ndim != 2 or coordinates.shape[1] != expected:
        raise ElvisError(f"expected points (n, {expected}), found an array of shape {coordinates.shape}")
    return plan, coordinates[:, : expansion.shape.dimension], coordinates[:, expansion.shape.dimension :]


def _waves(planes: Homogeneous, zeta: Floats) -> list[tuple[Floats, Floats]]:
    """(n, planes) values and derivatives of the Fourier factor of each plane, for each homogeneous direction."""
    numbers = zip(planes.bases, _numbers(planes), strict=True)
    return [f.fourier(basis, ids, zeta[:, i]) for i, (basis, ids) in enumerate(numbers)]


def _taken(tables: Sequence[Floats], numbers: Sequence[Ints]) -> list[Floats]:
    """The rows with the given numbers (m,) of each direction's table (k, n)."""
    return [np.take(table, own, axis=0) for table, own in zip(tables, numbers, strict=True)]


def _product(first: Floats, *others: Floats) -> Floats:
    """Product of arrays of one shape."""
    for other in others:
        first = first * other
    return first


def _lattice_product(first: Floats, *others: Floats) -> Floats:
    """(m, n) all products of factors (k, n) of each direction; the first direction's run fastest."""
    for other in others:
        first = (other[:, None] * first[None]).reshape(-1, first.shape[1])
    return first


def _of_lattice(v: Sequence[Floats], s: Sequence[Floats]) -> tuple[Floats, list[Floats]]:
    """(m, n) all products of values (k, n) of each direction, and their derivatives in each direction."""
    slopes = []
    for i in range(len(v)):
        slopes.append(_lattice_product(*(s[j] if i == j else v[j] for j in range(len(v)))))
    return _lattice_product(*v), slopes


def _outer(plane: Floats, spatial: Floats) -> Floats:
    """(n, planes * m): plane slowest."""
    return (plane[:, :, None] * spatial[:, None, :]).reshape(len(spatial), -1)


# Gradients by shape: h = (1 + eta)/2 (d, n); values v, derivatives s and values over c w of each direction, (m, n).

_Rows = Sequence[Floats]


def _triangle(h: Floats, v: _Rows, s: _Rows, w: _Rows) -> list[Floats]:
    first = s[0] * w[1]
    return [first, h[0] * first + v[0] * s[1]]


def _prism(h: Floats, v: _Rows, s: _Rows, w: _Rows) -> list[Floats]:
    first = s[0] * v[1] * w[2]
    return [first, v[0] * s[1] * v[2], h[0] * first + v[0] * v[1] * s[2]]


def _pyramid(h: Floats, v: _Rows, s: _Rows, w: _Rows) -> list[Floats]:
    first, second = s[0] * v[1] * w[2], v[0] * s[1] * w[2]
    return [first, second, h[0] * first + h[1] * second + v[0] * v[1] * s[2]]


def _tetrahedron(h: Floats, v: _Rows, s: _Rows, w: _Rows) -> list[Floats]:
    first, second = s[0] * w[1] * w[2], v[0] * s[1] * w[2]
    common = h[0] * first
    return [first, common + second, common + h[1] * second + v[0] * v[1] * s[2]]


_GRADIENTS: Mapping[Shape, Callable[[Floats, _Rows, _Rows, _Rows], list[Floats]]] = {
    Shape.TRIANGLE: _triangle,
    Shape.PRISM: _prism,
    Shape.PYRAMID: _pyramid,
    Shape.TETRAHEDRON: _tetrahedron,
}
