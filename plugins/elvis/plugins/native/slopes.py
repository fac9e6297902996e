"""Bounds of the derivatives of expressions in reference coordinates, over neighbourhoods of elements, and of rounding.

With leaves l_k (coordinates, fields, derivatives of fields in the world) and their own derivatives, by the chain rule

    f_i = sum_k f_k l_k,i        f_ij = sum_k f_k l_k,ij + sum_km f_km l_k,i l_m,j

where f_k and f_km, graphs again, are enclosed by interval arithmetic.  The gradient g of a field with the derivatives s
follows from J^T g = s, and its derivatives from the derivatives of this equation:

    J^T g_i = s_i - J_i^T g        J^T g_ij = s_ij - J_i^T g_j - J_j^T g_i - J_ij^T g

in coordinates in which J is nearly the identity 1 + R: |(1 + R)^-T y| <= (1 - |R|)^-1 |y| if the norm of |R| is less
than 1 (Neumaier 1990, Interval methods for systems of equations, section 4.1).  Bernstein coefficients bound R, s and
all derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement, permutations, product

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients
from elvis.core.polynomials.rounding import UNIT
from elvis.core.quantities import Expression
from elvis.core.quantities.functions import function, partials
from elvis.core.quantities.intervals import Interval, minus, number
from elvis.core.quantities.tree import LEAVES, Node, leaves, ordered, whole_exponent
from elvis.core.quantities.tree import partial as partial_derivative
from elvis.core.shapes import Shape
from elvis.plugins.native.regions import Neighbourhood, PyramidBoxes, Region
from elvis.plugins.native.rounding import operations
from elvis.plugins.runtime.volume import Slopes

#: regions of polynomials of a space
_Regions = Callable[[BernsteinSpace], Region]
#: operators and functions that are analytic wherever the intervals of their derivatives are finite
_OPERATORS, _ROOTS = frozenset("+-*/"), frozenset(("sqrt", "log", "asin", "acos"))
_SMOOTH = _OPERATORS | _ROOTS | {"exp", "sin", "cos", "tan", "atan", "sinh", "cosh", "tanh"}
#: operations with a kink at equal or zero operands: only first derivatives are bounded there
_KINKED = frozenset(("abs", "min", "max"))
#: leaves of expressions whose second derivatives are bounded
_MOST_LEAVES = 24
#: roundings of an operation; factor by which errors next to the elements exceed those inside
_ROUNDINGS, _BESIDE = 8, 4.0


@dataclass(frozen=True, eq=False)
class Polynomials:
    """Nets (n, count) of a polynomial on n elements, and how far computed values may be from the true ones (n,)."""

    space: BernsteinSpace
    nets: Floats
    error: Floats


@dataclass(frozen=True, eq=False)
class ElementSlopes:
    """Slopes of an expression with `has_slopes`, on the elements of a part, patch by patch.

    geometry, names  space of the map; names of the patches' fields
    space            of the expression's fields
    errors           (n, 3 + fields) error bounds of computed coordinates and fields in each element
    """

    patches: Sequence[Patch]
    geometry: BernsteinSpace
    names: Sequence[str]
    expression: Expression
    space: BernsteinSpace
    errors: Callable[[], Floats]

    def of(self, elements: Ints, beyond: float) -> Slopes:
        """Slopes of elements (n,), see `SlopeBounds`."""
        if self.geometry.shape is Shape.PYRAMID:
            return Slopes(*np.full((3, len(elements)), np.inf))
        return self._of(elements, lambda rows: partial(Neighbourhood, beyond=beyond))

    def in_boxes(self, elements: Ints, middle: Floats, half: Floats) -> Slopes:
        """Slopes in boxes of pyramids (n,), see `SlopeBounds`."""
        return self._of(elements, lambda rows: partial(PyramidBoxes, middle=middle[rows], half=half[rows]))

    def _of(self, elements: Ints, regions: Callable[[Ints], _Regions]) -> Slopes:
        """Slopes of elements (n,) in the regions of their rows."""
        found, first = np.full((3, len(elements)), np.inf), 0
        for patch in self.patches:
            mine = np.flatnonzero((elements >= first) & (elements < first + len(patch)))
            if len(mine) and all(patch.fields[self.names.index(name)] for name in self.expression.fields):
                own = self._in(patch, elements[mine] - first, self.errors()[elements[mine]], regions(mine))
                found[:, mine] = own.gradient, own.curvature, own.noise
            first += len(patch)
        return Slopes(*found)

    def _in(self, patch: Patch, rows: Ints, error: Floats, regions: _Regions) -> Slopes:
        """Slopes of some of a patch's elements."""
        controls = bernstein_coefficients(patch.geometry, patch.geometry_coefficients[rows], self.geometry)
        fields = {}
        for column, name in enumerate(self.expression.fields):
            number = self.names.index(name)
            expansion, modal = patch.fields[number], patch.coefficients[number]
            assert expansion is not None
            assert modal is not None
            net = bernstein_coefficients(expansion, modal[rows], self.space)
            fields[name] = Polynomials(self.space, net, error[:, 3 + column])
        return slopes(self.expression.root, Polynomials(self.geometry, controls, error[:, :3]), fields, regions)


@dataclass(frozen=True, eq=False)
class _Leaf:
    """A leaf's values, and bounds of its absolute derivatives: first (n, d) and second (n, d, d); its error (n,)."""

    ends: Interval
    first: Floats
    second: Floats
    error: Floats


def has_slopes(root: Node) -> bool:
    """Whether the derivatives of an expression can be bounded: no jumps, no second derivatives of fields."""
    found = leaves(root)
    if len(found) > _MOST_LEAVES or not found:
        return False
    known = all(leaf.op == "coordinate" or (leaf.op == "field" and len(leaf.axes) <= 1) for leaf in found)
    rest = [node for node in ordered(root) if node.op not in LEAVES]
    return known and all(node.op in _SMOOTH | _KINKED or whole_exponent(node) is not None for node in rest)


def slopes(root: Node, place: Polynomials, fields: Mapping[str, Polynomials], regions: _Regions) -> Slopes:
    """Bounds of an expression with `has_slopes`.

    place    of the coordinates: nets (n, 3, count), errors (n, 3)
    regions  domains of the bounds, for polynomials of a space
    """
    used = leaves(root)
    with np.errstate(all="ignore"):
        gradients = _Gradients(place, regions)
    with np.errstate(all="ignore"):
        about = {leaf: _leaf(leaf, place, fields, gradients, regions) for leaf in used}
        bounds = _Bounds(about)
        noise = _noise(root, about, bounds)
        parts = {leaf: partial_derivative(root, leaf) for leaf in used}
        steep = {leaf: bounds.size(part) for leaf, part in parts.items()}
        gradient = curvature = np.zeros(len(place.nets))
        for one in used:
            gradient = gradient + _times(steep[one], about[one].first.sum(axis=1))
            curvature = curvature + _times(steep[one], about[one].second.sum(axis=(1, 2)))
            for other in leaves(parts[one]):
                both = about[one].first.sum(axis=1) * about[other].first.sum(axis=1)
                curvature = curvature + _times(bounds.size(partial_derivative(parts[one], other)), both)
        curvature = np.where(_may_have_kinks(root, bounds), np.inf, curvature)
    noise = np.broadcast_to(noise, gradient.shape)
    return Slopes(_or_infinite(gradient), _or_infinite(curvature), _or_infinite(noise))


def _may_have_kinks(root: Node, bounds: _Bounds) -> Bools:
    """(n,), or (), whether the operands of a part with a kink may be equal, or zero, somewhere."""
    found: Bools = np.zeros((), bool)
    for node in ordered(root):
        if node.op not in _KINKED:
            continue
        operands = [bounds.ends(operand) for operand in node.operands]
        low, high = operands[0] if len(operands) == 1 else minus(*operands)
        found = found | ~((low > 0) | (high < 0))
    return found


def _or_infinite(some: Floats) -> Floats:
    return np.where(np.isnan(some), np.inf, some)


def _times(a: Floats, b: Floats) -> Floats:
    """a b; nought times anything is nought."""
    return np.where((a == 0) | (b == 0), 0.0, a * b)


class _Bounds:
    """Intervals of expressions of some leaves, cached."""

    def __init__(self, about: Mapping[Node, _Leaf]) -> None:
        self._known: dict[Node, Interval] = {leaf: own.ends for leaf, own in about.items()}

    def ends(self, root: Node) -> Interval:
        """Minimum and maximum value."""
        for node in ordered(root):
            if node in self._known:
                continue
            if node.op == "number":
                self._known[node] = number(node.value)
                continue
            self._known[node] = function(node).interval(*(self._known[operand] for operand in node.operands))
        return self._known[root]

    def size(self, root: Node) -> Floats:
        """The largest magnitude, infinite where nothing is known."""
        low, high = self.ends(root)
        return _or_infinite(np.maximum(np.abs(low), np.abs(high)))


def _noise(root: Node, about: Mapping[Node, _Leaf], bounds: _Bounds) -> Floats:
    """Error bounds of computed values: each operation adds its rounding to the propagated errors of its operands."""
    found: dict[Node, Floats] = {}
    for node in ordered(root):
        if node.op in LEAVES:
            found[node] = about[node].error if node in about else np.zeros(1)
            continue
        carried = [
            _times(bounds.size(rule()), found[operand])
            for rule, operand in zip(partials(node), node.operands, strict=True)
        ]
        found[node] = 1.01 * sum(carried) + _ROUNDINGS * _exponent(node) * UNIT * bounds.size(node)
    return found[root]


def _exponent(node: Node) -> float:
    """Roundings of a power grow with the exponent."""
    last = node.operands[-1]
    return 1.0 + abs(last.value) if node.op == "^" and last.op == "number" else 1.0


def _leaf(
    leaf: Node, place: Polynomials, fields: Mapping[str, Polynomials], gradients: _Gradients, regions: _Regions
) -> _Leaf:
    """Bounds of one leaf."""
    if leaf.op == "coordinate":
        axis = leaf.axes[0]
        return _polynomial(Polynomials(place.space, place.nets[:, axis], place.error[:, axis]), regions)
    field = fields[leaf.name]
    return gradients.leaf(field, leaf.axes[0]) if leaf.axes else _polynomial(field, regions)


def _polynomial(field: Polynomials, regions: _Regions) -> _Leaf:
    """A coordinate, or a field's value."""
    region = regions(field.space)
    dimension = field.space.shape.dimension
    nets = field.nets[:, None]
    first, second = (_magnitudes(region, dimension, nets, order)[..., 0] for order in (1, 2))
    return _Leaf(region.ends(field.nets, ()), first, second, _BESIDE * field.error)


def _size(ends: Interval) -> Floats:
    """The largest magnitude."""
    return np.asarray(np.maximum(np.abs(ends[0]), np.abs(ends[1])))


def _magnitudes(region: Region, dimension: int, nets: Floats, order: int) -> Floats:
    """(n, d, …, d, c) bounds of all derivatives of an order of polynomials with nets (n, c, count)."""
    found = np.empty((len(nets), *[dimension] * order, nets.shape[1]))
    for directions in combinations_with_replacement(range(dimension), order):
        size = _size(region.ends(nets, directions))
        for other in set(permutations(directions)):
            np.moveaxis(found, 0, -2)[other] = size
    return found


class _Gradients:
    """Derivatives of fields in the world, on the elements of a map."""

    def __init__(self, place: Polynomials, regions: _Regions) -> None:
        self._regions = regions
        self._degree = max(place.space.degrees)
        d = self._d = place.space.shape.dimension
        region = regions(place.space)
        axes, nets = range(d), place.nets[:, :d]
        middles = [np.add(*region.ends(nets, (a,))) / 2 for a in axes]
        jacobian = np.stack(middles, axis=2)
        known = np.abs(np.linalg.det(jacobian)) > 0
        self._inverse = np.linalg.inv(np.where(known[:, None, None], jacobian, np.nan))

        # X = A x: R, and the second and third derivatives
        own = np.einsum("nck,nkm->ncm", self._inverse, nets)
        rest = np.empty((len(nets), d, d))
        for a, c in product(axes, axes):
            rest[:, a, c] = _size(region.ends(own[:, c], (a,), float(a == c)))
        self._second = _magnitudes(region, d, own, 2)
        self._third = _magnitudes(region, d, own, 3)
        norm = rest.sum(axis=2).max(axis=1)
        is_near = (norm < 1)[:, None, None]
        self._rest = np.where(is_near, rest, np.nan)
        self._solve = np.linalg.inv(np.eye(d) - np.where(is_near, rest, 0.0))
        self._solve = np.where(is_near, self._solve, np.inf)

        # errors of the derivatives of X; and by how much cofactors and determinant magnify rounding
        size = np.abs(self._inverse)
        moved = np.einsum("nck,nk->nc", size, place.error[:, :d])
        self._error = 2 * self._degree * moved + operations(place.space) * UNIT * (1 + norm)[:, None]
        lengths = np.linalg.norm(jacobian, axis=1).prod(axis=1) / np.abs(np.linalg.det(jacobian))
        self._skewed = lengths * ((1 + norm) / (1 - norm)) ** 3

    def leaf(self, field: Polynomials, axis: int) -> _Leaf:
        """The derivative of a field along x, y or z."""
        d, region = self._d, self._regions(field.space)
        nets = field.nets[:, None]
        ends = [region.ends(field.nets, (a,)) for a in range(d)]
        low, high = (np.stack([end[k] for end in ends], axis=1) for k in range(2))
        sizes = [_magnitudes(region, d, nets, order)[..., 0] for order in (1, 2, 3)]

        # h relative to the inverse A, its first derivatives (n, i, c) and its second (n, i, j, c)
        size = np.einsum("nac,nc->na", self._solve, sizes[0])
        off = np.einsum("nac,nc->na", self._rest, size)
        low, high = low - off, high + off
        turned = np.einsum("niac,nc->nia", self._second, size)
        slope = np.einsum("nac,nic->nia", self._solve, sizes[1] + turned)
        mixed = np.einsum("niac,njc->nija", self._second, slope)
        bend = sizes[2] + mixed + mixed.swapaxes(1, 2) + np.einsum("nijac,nc->nija", self._third, size)
        curvature = np.einsum("nac,nijc->nija", self._solve, bend)

        # errors of s and J, and of solving
        degree = max(self._degree, *field.space.degrees)
        noise = 2 * degree * field.error[:, None] + operations(field.space) * UNIT * sizes[0]
        noise = noise + (self._error * size).sum(axis=1, keepdims=True)
        error = np.einsum("nac,nc->na", self._solve, noise) + 16 * self._skewed[:, None] * UNIT * size

        # and along the axis in the world
        weights = self._inverse[:, :, axis]
        least, greatest = ((np.where(weights > 0, a, b) * weights).sum(axis=1) for a, b in ((low, high), (high, low)))
        parts = np.abs(weights)
        along = np.einsum("nc,nic->ni", parts, slope)
        across = np.einsum("nc,nijc->nij", parts, curvature)
        return _Leaf((least, greatest), along, across, _BESIDE * (parts * error).sum(axis=1))
