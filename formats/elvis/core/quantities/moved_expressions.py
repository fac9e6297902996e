"""Quantities of data that an isometry moves, as quantities of the data themselves.

A copy X = R x + s of data has the fields U(X) = R u(x) for vectors, A(X) = det(R) R a(x) for axial vectors such as the
vorticity, T(X) = R t(x) R^T for tensors, and f(x) for scalars.  By the chain rule ∂/∂X_i = sum_j R_ij ∂/∂x_j.  If an
expression is given these for its leaves, its value at x is the value of the original expression at X in the copy: the
parity of derived quantities follows, and nothing about them needs to be known.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.complex_fields import SUFFIXES, pairs_in
from elvis.core.data.dataset import is_rate
from elvis.core.deformed.isometries import Isometry
from elvis.core.quantities.derived import derived_name, derived_of
from elvis.core.quantities.elements.sides import DUALS, SIDES
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.flows import VECTORS
from elvis.core.quantities.functions import function
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import (
    AXES,
    ZERO,
    Node,
    attribute,
    call,
    coordinate,
    direction_of,
    field,
    fold,
    leaves,
    measure_name,
    measured_of,
    negative,
    number,
    ordered,
    other_of,
    target_of,
)

#: names of vectors that don't change sign in a mirror like others: curls of vectors, and what these make
_AXIAL = re.compile(r"(vorticity|vort|omega|curl|W|B)_?", re.I)
#: endings of the components of tensors, after the name or after the name and an underscore
_TENSOR = re.compile(r"(.*?)_?(xx|xy|xz|yx|yy|yz|zx|zy|zz|uu|uv|uw|vu|vv|vw|wu|wv|ww)", re.S)
#: functions that are not analytic: two of these may agree at all points but few
_KINKED = {"abs", "sign", "step", "min", "max", "atan2"}
#: random points at which two expressions are compared, and those of them that must have a value
_TRIALS, _FEWEST = 24, 8
#: part of the largest part of a sum to which two equal expressions agree
_EQUAL = 1e-9


@dataclass(frozen=True)
class Component:
    """A component of a vector or of a tensor.

    names  of all components by their axes
    axes   of this one
    """

    names: dict[tuple[int, ...], str]
    axes: tuple[int, ...]
    is_axial: bool = False


@dataclass(frozen=True, eq=False)
class MovedLeaves:
    """Leaves of expressions on data that are moved."""

    isometry: Isometry
    names: Names

    @cached_property
    def components(self) -> dict[str, Component]:
        """The components of vectors and tensors among the fields, by their names."""
        return components(self.names.fields, self.names.dimension)

    def leaf(self, node: Node) -> Node:
        """What a leaf is on the copy; ElvisError if nobody knows."""
        if node.op == "coordinate" and node.axes[0] < len(AXES):
            return self._position([coordinate(axis) for axis in range(len(AXES))], node.axes[0])
        if node.op == "attribute":
            return self._attribute(node)
        return self._field(node) if node.op == "field" else node

    def _row(self, axis: int) -> list[tuple[int, float]]:
        """Axes and factors of a row of R, zeros left out."""
        row = self.isometry.rotation[axis]
        return [(other, factor) for other, factor in enumerate(row) if factor != 0.0]

    def _position(self, places: Sequence[Node], axis: int) -> Node:
        """A coordinate of the image of a place."""
        terms = [(factor, places[other]) for other, factor in self._row(axis) if other < len(places)]
        return call("+", _combined(terms), number(self.isometry.shift[axis]))

    def _attribute(self, node: Node) -> Node:
        """An attribute of elements."""
        if node.name in SIDES[: len(AXES)]:
            terms = [(factor, attribute(SIDES[other])) for other, factor in self._row(SIDES.index(node.name))]
            return _combined(terms)
        if node.name in DUALS:
            terms = [
                (factor, attribute(f"{node.name[:-1]}{AXES[k]}")) for k, factor in self._row("xyz".index(node.name[-1]))
            ]
            return _combined(terms)
        measured = measured_of(node.name)
        if measured is not None:
            return self._measure(*measured)
        target = target_of(node.name)
        if other_of(node.name) is not None or (target is not None and target not in self.names.boundaries):
            raise ElvisError(f"copies: {node.name} is not known on copies of the data")
        direction = direction_of(node.name)
        if direction is not None:
            terms = [(factor, replace(direction, axis=other).attribute) for other, factor in self._row(direction.axis)]
            return _combined(terms)
        return node

    def _measure(self, of: str, name: str) -> Node:
        """A number of each element made of a field, whose sign does not count."""
        component = self.components.get(name)
        if component is None:
            return attribute(measure_name(of, name))
        terms = list(self._terms(component))
        if len(terms) > 1:
            raise ElvisError(f"copies: {of}({name}) is not known on copies that turn {name}")
        return attribute(measure_name(of, terms[0][1]))

    def _field(self, node: Node) -> Node:
        """A field, or a derivative of one."""
        places = self.names.places
        slopes = [self._row(axis) for axis in node.axes]
        if node.name in places:
            along = [(factor, places[j]) for j, factor in self._row(places.index(node.name)) if j < len(places)]
            found = _derivatives(along, slopes)
            is_place = not node.axes
            return call("+", found, number(self.isometry.shift[places.index(node.name)])) if is_place else found
        return _derivatives(list(self.fields(node.name)), slopes)

    def fields(self, name: str) -> Iterator[tuple[float, str]]:
        """Factors and names of the fields whose sum a field is on the copy."""
        owner, colon, rest = name.partition(":")
        if colon and owner in self.names.shared:
            yield from ((factor, f"{owner}:{own}") for factor, own in self.fields(rest))
        elif is_rate(name):
            yield from ((factor, f"d({own},t)") for factor, own in self.fields(name[2:-3]))
        elif (made := derived_of(name)) is not None:
            wrap, inner, axes = made
            for factor, own in self.fields(inner):
                for slope, along in _products([self._row(axis) for axis in axes]):
                    yield factor * slope, derived_name(wrap, own, along)
        elif name in self.components:
            yield from self._terms(self.components[name])
        else:
            yield 1.0, name

    def _terms(self, component: Component) -> Iterator[tuple[float, str]]:
        """Factors and names of the components whose sum a component is on the copy."""
        sign = -1.0 if component.is_axial and not self.isometry.is_proper else 1.0
        if not component.axes:
            # the only component of an axial vector of plane data
            yield sign, component.names[()]
            return
        for factor, axes in _products([self._row(axis) for axis in component.axes]):
            if axes in component.names:
                yield sign * factor, component.names[axes]


def moved(expression: Expression, isometry: Isometry, names: Names) -> Expression:
    """A quantity at X = R x + s in a copy of data, as a quantity of the data at x.

    Parameters
    ----------
    expression : Expression
        The quantity, whose text is kept.
    isometry : Isometry
        It makes the copy.
    names : Names
        Of the data.

    Returns
    -------
    Expression
        The same expression if it does not depend on the isometry, as pressure, Q and the speed.

    Raises
    ------
    ElvisError
        For values that are not known on copies: data on other meshes, distances to files.
    """
    moved_leaves = MovedLeaves(isometry, names)
    root = fold(expression.root, moved_leaves.leaf, lambda node, operands: call(node.op, *operands))
    if root is expression.root or _agree(root, expression.root):
        return expression
    opposite = negative(expression.root)
    return Expression(expression.text, opposite if _agree(root, opposite) else root)


def components(fields: Sequence[str], dimension: int) -> dict[str, Component]:
    """The components of vectors and tensors among fields, by their names.

    Vectors are the customary names of velocities and momenta, and names that end in _x, _y, _z or the like; tensors are
    names that end in two axes.  If a component of the first axes is missing, it is no vector.  The parts of a complex
    field, such as u_re or E_x_im, belong to the vector or tensor that its name belongs to.
    """
    found = _components(fields, dimension)
    pairs = pairs_in(fields)
    for name, own in _components(tuple(pairs), dimension).items():
        for part, field_name in enumerate(pairs[name]):
            names = {axes: pairs[other][part] for axes, other in own.names.items()}
            found[field_name] = replace(own, names=names)
    return found


def _components(fields: Sequence[str], dimension: int) -> dict[str, Component]:
    """The components of vectors and tensors, in which parts of complex fields are fields of their own."""
    found: dict[str, Component] = {}
    for family in (*VECTORS, *_suffixed(fields)):
        known: dict[tuple[int, ...], str] = {(axis,): name for axis, name in enumerate(family) if name in fields}
        stem = _AXIAL.fullmatch(family[0][:-1])
        if len(known) >= dimension and all((axis,) in known for axis in range(dimension)):
            found |= {name: Component(known, axes, stem is not None) for axes, name in known.items()}
        elif stem is not None and dimension == 2 and (2,) in known:
            # the vorticity of a plane flow
            found[known[2,]] = Component({(): known[2,]}, (), True)
    return {**found, **_tensors(fields, dimension)}


def _suffixed(fields: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Names of three components for each stem of fields."""
    for suffixes in SUFFIXES[:2]:
        stems = [name.removesuffix(end) for end in suffixes[:3] for name in fields if name.endswith(end)]
        for stem in dict.fromkeys(stems):
            if stem:
                yield tuple(stem + end for end in suffixes[:3])


def _tensors(fields: Sequence[str], dimension: int) -> dict[str, Component]:
    """The components of tensors, which are symmetric where only one of two is there."""
    stems: dict[str, dict[tuple[int, ...], str]] = {}
    for name in fields:
        match = _TENSOR.fullmatch(name)
        if match is not None:
            axes = tuple("xyzuvw".index(letter) % 3 for letter in match[2])
            stems.setdefault(name[: -len(match[2])], {})[axes] = name
    found: dict[str, Component] = {}
    for known in stems.values():
        every = {(j, i): name for (i, j), name in known.items()} | known
        if all(axes in every for axes in product(range(dimension), repeat=2)):
            found |= {name: Component(every, axes) for axes, name in known.items()}
    return found


def _products(rows: Sequence[Sequence[tuple[int, float]]]) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Products of one factor of each row, with the axes that they belong to."""
    for choice in product(*rows):
        yield float(np.prod([factor for _, factor in choice])), tuple(axis for axis, _ in choice)


def _derivatives(terms: Sequence[tuple[float, str]], slopes: Sequence[Sequence[tuple[int, float]]]) -> Node:
    """The derivative of a sum of fields along combinations of the axes."""
    every = [(a * b, field(name, axes)) for a, name in terms for b, axes in _products(slopes)]
    return _combined(every)


def _combined(terms: Sequence[tuple[float, Node]]) -> Node:
    """A sum of multiples; equal terms count together."""
    sums: dict[Node, float] = {}
    for factor, node in terms:
        sums[node] = sums.get(node, 0.0) + factor
    total = ZERO
    for node, factor in sums.items():
        if factor == 0.0:
            continue
        term = node if abs(factor) == 1.0 else call("*", number(abs(factor)), node)
        total = call("-" if factor < 0.0 else "+", total, term)
    return total


def _agree(one: Node, other: Node) -> bool:
    """Whether two analytic expressions are the same function of their leaves.

    Analytic functions that agree at random points are the same, except with probability zero (as Schwartz 1980 and
    Zippel 1979 for polynomials).  Expressions with kinks are never taken for the same.
    """
    if any(node.op in _KINKED for node in ordered(one, other)):
        return False
    known = leaves(one, other)
    chance = np.random.default_rng(1)
    signs = np.where(np.arange(_TRIALS) % 2, 1.0, -1.0)
    points = {leaf: np.abs(chance.normal(size=_TRIALS)) for leaf in known}
    # at every other point all values are positive, as roots and logarithms want them
    points = {leaf: np.where(signs > 0.0, own, chance.normal(size=_TRIALS)) for leaf, own in points.items()}
    first, second = (_values(root, points.__getitem__) for root in (one, other))
    both = np.isfinite(first) & np.isfinite(second)
    if np.any(np.isfinite(first) != np.isfinite(second)) or both.sum() < _FEWEST:
        return False
    apart = np.abs(first - second)[both]
    return bool((apart <= _EQUAL * np.maximum(np.abs(first[both]), 1.0)).all())


def _values(root: Node, leaf: Callable[[Node], np.ndarray]) -> np.ndarray:
    """(n,) values of an expression, from those of its leaves."""

    def at(node: Node) -> np.ndarray:
        return np.full(_TRIALS, node.value) if node.op == "number" else leaf(node)

    with np.errstate(all="ignore"):
        return np.asarray(fold(root, at, lambda node, operands: function(node).numpy(*operands)))
