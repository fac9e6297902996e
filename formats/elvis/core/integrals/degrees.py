"""The degree of an integrand as a polynomial on a piece, from which an exact rule is chosen.

On an element, an expression of fields, coordinates and first derivatives is P / det^k, with P a polynomial and det the
determinant of the map's derivative J, since du/dx = (cof J grad u) / det.  Multiplied by the measure |det|, it is a
polynomial if k is at most 1.  On a side, the outward unit normal is N / |N| with a polynomial N, and the measure is
|N|; an expression linear in the normal is therefore a polynomial there, even on a curved side.  If J is constant, so is
det; if the direction of N is constant, so is the normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from elvis.core.data.dataset import Expansion
from elvis.core.integrals.reference_cells import Piece
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import Node, fold, whole_exponent
from elvis.core.shapes import Shape

#: the highest power that is treated as a polynomial
_MOST_POWER = 64
_NORMALS = ("nx", "ny", "nz")

#: degrees of a polynomial in each direction of eta
Degrees = tuple[int, ...]


class Form(NamedTuple):
    """P / det^below, of order ``normals`` in the components of the normal, with P of ``degrees``."""

    degrees: Degrees
    below: int = 0
    normals: int = 0


@dataclass(frozen=True, eq=False)
class DegreeRules:
    """The degrees of polynomials on a piece with uniform elements.

    names      of the patch's fields
    is_affine  whether J is constant
    is_flat    whether the direction of N is constant
    is_valid   whether det is proved to keep its sign, or enters with its sign
    """

    piece: Piece
    names: Sequence[str]
    is_affine: bool
    is_flat: bool
    is_valid: bool

    def counts(self, expression: Expression) -> tuple[int, ...] | None:
        """Gauss points in each direction of eta that integrate an expression exactly; None without an exact rule."""
        if self.piece.patch.homogeneous is not None or not self.is_valid:
            return None
        form = fold(expression.root, self._leaf, self._inner)
        total = None if form is None else self._with_measure(form)
        if total is None:
            return None
        powers = COLLAPSE[self.piece.shape]
        return tuple((degree + power) // 2 + 1 for degree, power in zip(total, powers, strict=True))

    def measure_is_exact(self, counts: Sequence[int]) -> bool:
        """Whether the measure is a polynomial that Gauss rules with ``counts`` points integrate exactly."""
        total = self._with_measure(Form(self._none)) if self.is_valid else None
        if total is None:
            return False
        degrees = _plus(total, COLLAPSE[self.piece.shape])
        return all(degree < 2 * count for degree, count in zip(degrees, counts, strict=True))

    def _with_measure(self, form: Form) -> Degrees | None:
        """Degrees of an integrand times the measure; None if the product is not a polynomial."""
        if not self.piece.is_side:
            if self.is_affine:
                return form.degrees
            if form.below > 1 or not (self.piece.patch.is_flat or self.is_flat):
                return None
            return form.degrees if form.below else _plus(form.degrees, self._determinant)
        if form.below or not (form.normals == 1 or (self.is_flat and form.normals == 0)):
            return None
        return _plus(form.degrees, self._normal)

    @property
    def _none(self) -> Degrees:
        return (0,) * self.piece.shape.dimension

    def _degrees(self, expansion: Expansion) -> Degrees:
        """Degrees of an expansion on the piece; on a side, each is the maximum over the element's directions."""
        own = box_degrees(bernstein_space(expansion))
        return (max(own),) * self.piece.shape.dimension if self.piece.is_side else own

    def _gradient(self, expansion: Expansion) -> list[Degrees]:
        """Degrees of the derivatives of an expansion in each direction of xi."""
        degrees = self._degrees(expansion)
        if self.piece.patch.shape is Shape.PYRAMID:
            return [degrees] * self.piece.shape.dimension
        return [_lowered(degrees, which) for which in _LOWERED[self.piece.shape]]

    @property
    def _columns(self) -> list[Degrees]:
        return self._gradient(self.piece.patch.geometry)

    @property
    def _determinant(self) -> Degrees:
        return self._none if self.is_affine else _plus(*self._columns)

    @property
    def _normal(self) -> Degrees:
        """Degrees of N, from the tangents of the side."""
        return self._none if self.is_affine else _plus(*self._columns)

    def _derivative(self, expansion: Expansion) -> Form | None:
        """A derivative of a field in the world."""
        parts = self._gradient(expansion)
        if self.is_affine:
            return Form(_greatest(*parts))
        if self.piece.is_side or not self.piece.patch.is_flat:
            return None
        columns = self._columns
        terms = [_plus(part, *(own for j, own in enumerate(columns) if j != i)) for i, part in enumerate(parts)]
        return Form(_greatest(*terms), below=1)

    def _leaf(self, node: Node) -> Form | None:
        patch = self.piece.patch
        if node.op == "number":
            return Form(self._none)
        if node.op == "coordinate":
            return Form(self._degrees(patch.geometry))
        if node.op == "attribute":
            return self._attribute(node.name)
        expansion = patch.fields[self.names.index(node.name)]
        if expansion is None:
            return None
        if not node.axes:
            return Form(self._degrees(expansion))
        if len(node.axes) == 1:
            return self._derivative(expansion)
        return Form(self._degrees(expansion)) if self.is_affine else None

    def _attribute(self, name: str) -> Form | None:
        if name in _NORMALS and self.piece.is_side:
            return Form(self._none, normals=0 if self.is_flat else 1)
        return Form(self._none) if name in ("element", "order", "shape") else None

    def _inner(self, node: Node, operands: list[Form | None]) -> Form | None:
        known = [form for form in operands if form is not None]
        if len(known) < len(operands):
            return None
        first, last = known[0], known[-1]
        if node.op in ("+", "-"):
            return self._sum(node, first, last)
        if node.op == "*":
            return _product(first, last)
        if node.op == "/" and last == Form(self._none):
            return first
        exponent = whole_exponent(node)
        if exponent is not None and 0 <= exponent <= _MOST_POWER:
            return Form(tuple(exponent * d for d in first.degrees), exponent * first.below, exponent * first.normals)
        return first if all(form == Form(self._none) for form in known) else None

    def _sum(self, node: Node, first: Form, last: Form) -> Form | None:
        """Degrees of a sum over a common denominator; -f is represented as 0 - f."""
        if node.operands[0].op == "number" and node.operands[0].value == 0:
            return last
        if first.normals != last.normals:
            return None
        below = max(first.below, last.below)
        raised = [_plus(form.degrees, *[self._determinant] * (below - form.below)) for form in (first, last)]
        return Form(_greatest(*raised), below, first.normals)


#: for each direction of xi, the directions of eta in which a derivative lowers the degree by one (total degrees on
#: simplices)
_LOWERED: dict[Shape, tuple[tuple[int, ...], ...]] = {
    Shape.SEGMENT: ((0,),),
    Shape.TRIANGLE: ((0, 1), (0, 1)),
    Shape.QUADRILATERAL: ((0,), (1,)),
    Shape.TETRAHEDRON: ((0, 1, 2),) * 3,
    Shape.PYRAMID: ((), (), ()),
    Shape.PRISM: ((0, 2), (1,), (0, 2)),
    Shape.HEXAHEDRON: ((0,), (1,), (2,)),
}


def _product(first: Form, last: Form) -> Form:
    return Form(_plus(first.degrees, last.degrees), first.below + last.below, first.normals + last.normals)


def _plus(*parts: Degrees) -> Degrees:
    return tuple(map(sum, zip(*parts, strict=True)))


def _greatest(*parts: Degrees) -> Degrees:
    return tuple(map(max, zip(*parts, strict=True)))


def _lowered(degrees: Degrees, which: tuple[int, ...]) -> Degrees:
    return tuple(max(degree - (i in which), 0) for i, degree in enumerate(degrees))
