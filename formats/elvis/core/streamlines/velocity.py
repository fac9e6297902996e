"""A velocity of a dataset at reference points: in the world, and in the elements' own coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.evaluation import evaluate_at
from elvis.core.polynomials.expansion import dimension, values_and_gradients
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import AXES
from elvis.core.shapes import Shape

#: values of an expression at points (n,), or one number
Values: TypeAlias = Floats | float
#: points whose coefficients are gathered together
_AT_ONCE = 1 << 10
_SIMPLICES = (Shape.TRIANGLE, Shape.TETRAHEDRON)


def velocity_expressions(dataset: Dataset, texts: Sequence[str] | None, names: Names | None = None) -> list[Expression]:
    """The components of a velocity of a dataset; ``names`` for the texts, None for the names of the dataset."""
    return components_in(names or Names.of(dataset), texts)


def components_in(names: Names, texts: Sequence[str] | None) -> list[Expression]:
    """The components of a velocity: given as texts, or the usual ones for such names.

    Raises ElvisError without any, and if the number of components differs from the number of coordinates.
    """
    if texts is None:
        nodes = names.flow.velocity()
        return [Expression(text, node) for text, node in zip("uvw", nodes, strict=False)]
    if len(texts) != names.dimension:
        axes = ", ".join(AXES[: names.dimension])
        expected = f"a velocity of {names.dimension} components, as the data have the coordinates {axes}"
        raise ElvisError(f"expected {expected}, found {len(texts)}: {', '.join(texts) or 'none'}")
    return [Expression.parse(text, names) for text in texts]


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion at n points.

    velocity   (n, 3)     in the world, tangential on surfaces in space
    reference  (n, D) derivatives of reference coordinates in time; including the clock if the velocity has one
    jacobians  (n, 3, D)  of the map
    """

    velocity: Floats
    reference: Floats
    jacobians: Floats

    @property
    def speed(self) -> Floats:
        """(n,) length of the velocity."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1))


class Velocity:
    """A velocity, ready to be evaluated on the elements of a dataset.

    patches  the elements, in the order of ``evaluator``
    others   additional quantities for `values`

    is_oriented  whether neighbours in the plane see it from the same side
    clocks       1 if a coordinate of time follows the coordinates of the element (`moving`), else 0
    """

    is_oriented = True
    clocks = 0

    def __init__(self, dataset: Dataset, expressions: Sequence[Expression], others: Sequence[Expression] = ()) -> None:
        self.evaluator = Evaluator(dataset, [*expressions, *others])
        self.expressions, self.others = tuple(expressions), tuple(others)
        self.patches = self.evaluator.patches
        self._constant = [_constant_gradients(patch) for patch in self.patches]
        self._fields = [self._own_fields(patch) for patch in self.patches]

    def is_straight(self, number: int) -> bool:
        """Whether the map is affine in all elements of a patch."""
        return self._constant[number] is not None

    def component_fields(self, number: int) -> tuple[int, ...] | None:
        """The numbers of the fields that the components are in a patch, with one expansion; None if they aren't."""
        return self._fields[number]

    def motion(self, patch: Ints, row: Ints, points: Floats) -> Motion:
        """The motion at reference points (n, D) of elements: patches (n,) and rows in them (n,)."""
        count, d = len(points), points.shape[1] - self.clocks
        found = Motion(np.zeros((count, 3)), np.empty((count, d)), np.empty((count, 3, d)))
        for number, here in rows_by_number(patch):
            velocity, jacobians = self._at(number, row[here], points[here])
            with np.errstate(all="ignore"):
                reference = np.einsum("nci,nc->ni", tangents.duals(jacobians), velocity)
            if d < 3:
                velocity = np.einsum("nci,ni->nc", jacobians, reference)
            found.velocity[here], found.reference[here], found.jacobians[here] = velocity, reference, jacobians
        return found

    def vectors(self, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n, 3) the velocity in the world at reference points (n, D) of elements: patches (n,) and rows (n,)."""
        if points.shape[1] - self.clocks < 3:
            return self.motion(patch, row, points).velocity
        found = np.zeros((len(points), 3))
        for number, here in rows_by_number(patch):
            found[here] = self._vectors(number, row[here], points[here])
        return found

    def in_world(self, element: Ints, reference: Floats) -> Floats:
        """(n, 3) the velocity in elements with these ids (n,) at their reference points (n, 3)."""
        found = np.full((len(element), 3), np.nan)
        for here, patch, rows, own in self._places_of(element, reference):
            found[here] = self.vectors(patch, rows, own)
        return found

    def at(self, expression: Expression, element: Ints, reference: Floats) -> Floats:
        """(n,) values of one of the evaluator's expressions at points given in the same way."""
        found = np.full(len(element), np.nan)
        for here, patch, rows, own in self._places_of(element, reference):
            found[here] = self.values(expression, patch, rows, own)
        return found

    def _places_of(self, element: Ints, reference: Floats) -> Iterator[tuple[Ints, Ints, Ints, Floats]]:
        """For each patch, its places among some places (n,): their numbers, patches, rows and points."""
        for number, patch in enumerate(self.patches):
            order = np.argsort(patch.element_ids, kind="stable")
            place = np.searchsorted(patch.element_ids, element, sorter=order).clip(0, len(patch) - 1)
            rows = order[place]
            here = np.flatnonzero(patch.element_ids[rows] == element)
            own = self.from_elements(number, reference[here, : patch.dimension])
            yield here, np.full(len(here), number), rows[here], own

    def positions(self, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n, 3) world coordinates."""
        found = np.empty((len(points), 3))
        for number, here in rows_by_number(patch):
            found[here] = pointwise.positions(self.patches[number], row[here], points[here])
        return found

    def in_elements(self, number: int, points: Floats) -> Floats:
        """(…, D) reference coordinates in the elements of a patch, of points (…, D): the same."""
        return points

    def from_elements(self, number: int, points: Floats) -> Floats:
        """(…, D) the points whose reference coordinates these (…, D) are in the elements of a patch: the same."""
        return points

    def together(self, expressions: Sequence[Expression], number: int, rows: Ints, points: Floats) -> Iterator[Values]:
        """(n,) values of some of the evaluator's expressions in elements (n,) of a patch, or one number."""
        return self.evaluator.values_at(expressions, self.places(number, rows, points))

    def values(self, expression: Expression, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n,) values of one of the evaluator's expressions."""
        found = np.empty(len(points))
        for number, here in rows_by_number(patch):
            found[here] = self.evaluator.values(expression, self.patches[number], row[here], points[here])
        return found

    def places(self, number: int, rows: Ints, points: Floats) -> ElementPoints:
        """Reference points (n, D) in elements (n,) of a patch, for the evaluator."""
        return ElementPoints(self.patches[number], rows, points)

    def _at(self, number: int, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World velocity (n, 3) and Jacobians (n, 3, D) on elements of one patch."""
        patch, constant = self.patches[number], self._constant[number]
        if self._fields[number] is None:
            # the components may need the Jacobians too
            places = self.places(number, rows, points)
            return self._evaluated(places), places.jacobians
        velocity = self._vectors(number, rows, points)
        if constant is None:
            return velocity, pointwise.jacobians(patch, rows, points[:, : patch.dimension])
        return velocity, patch.geometry_coefficients[rows] @ constant

    def _evaluated(self, places: ElementPoints) -> Floats:
        """(n, 3) the components at places."""
        velocity = np.zeros((len(places.rows), 3))
        for axis, value in enumerate(self.evaluator.values_at(self.expressions, places)):
            velocity[:, axis] = value
        return velocity

    def _vectors(self, number: int, rows: Ints, points: Floats) -> Floats:
        """(n, 3) world velocity on elements of one patch."""
        fields = self._fields[number]
        if fields is None:
            return self._evaluated(self.places(number, rows, points))

        # components that share an expansion share its table
        expansion = self.patches[number].fields[fields[0]]
        assert expansion is not None
        velocity = np.zeros((len(rows), 3))
        own = points[:, : dimension(expansion)]
        for first in range(0, len(rows), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            # points along lines share elements, unless each has a time of its own
            elements, which = rows[some], np.arange(len(own[some]))
            if not self.clocks:
                elements, which = np.unique(elements, return_inverse=True)
            nets = [self._coefficients(number, field, elements, points[some]) for field in fields]
            velocity[some, : len(fields)] = evaluate_at(expansion, np.stack(nets, axis=1), which, own[some])
        return velocity

    def _coefficients(self, number: int, field: int, rows: Ints, points: Floats) -> Floats:
        """(n, m) coefficients of a field in elements (n,) of a patch, for points (n, D)."""
        coefficients = self.patches[number].coefficients[field]
        assert coefficients is not None
        return np.asarray(coefficients[rows])

    def _own_fields(self, patch: Patch) -> tuple[int, ...] | None:
        """The numbers of the fields that are the components, where they are that and share an expansion."""
        if not all(each.is_field for each in self.expressions):
            return None
        fields = tuple(self.evaluator.names.index(each.root.name) for each in self.expressions)
        spaces = {patch.fields[number] for number in fields}
        return fields if len(spaces) == 1 and None not in spaces else None


def _constant_gradients(patch: Patch) -> Floats | None:
    """(m, d) gradients of the map's modes where they are the same all over the elements: on straight simplices."""
    if patch.shape not in _SIMPLICES or max(patch.geometry.modes) > 2 or patch.periods:
        return None
    centre = patch.shape.centre[None]
    return np.ascontiguousarray(values_and_gradients(patch.geometry, centre)[1][0].T)
