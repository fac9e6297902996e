"""Quantities of a scene by name, evaluated from the modal expansions in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, every_pair
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.mapping.boxes import Boxes, element_boxes
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.evaluation import evaluate, evaluate_at_with_gradients
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.streamlines.flow_data import FlowSource
from elvis.reference.scenes.equations import Equation
from elvis.reference.selection import selected_faces
from elvis.scene import CutSurface, Implicit, Isosurface, Scene, VolumeRendering
from elvis.scene.model.time_limit import check_time
from elvis.scene.record.frame import Frame

#: values of a quantity in elements ``rows`` (n,) of a patch, all at the same reference points (k, D): (n, k)
Corners = Callable[[Patch, Ints, Floats], Floats]
#: step of central differences in reference coordinates, for gradients of expressions
_STEP = 1e-5
#: rounding of values relative to their terms
_ROUNDING = 4e-15


def names_of(scene: Scene) -> tuple[str, ...]:
    """The names of all quantities that a scene needs, its field first."""
    names = [scene.field]
    for shown in scene.every_object:
        if isinstance(shown, (Isosurface, VolumeRendering)):
            names.append(shown.quantity or scene.field)
        if isinstance(shown, CutSurface) and isinstance(shown.surface, Implicit):
            names.append(shown.surface.expression)
        if not isinstance(shown, VolumeRendering):
            style = shown.style
            names.append(style.quantity or scene.field)
            names.append((style.contours.quantity if style.contours else None) or scene.field)
            names += style.lic.components if style.lic else ()
    names += [clip.surface.expression for clip in scene.clip if isinstance(clip.surface, Implicit)]
    return tuple(dict.fromkeys(names))


class Quantities:
    """Fields and expressions of one dataset.

    names    of the quantities in scenes
    patches  the elements that carry the first of them
    dataset  that they are of; None if a runtime plugin has opened the data
    flow     data in which lines are traced
    """

    dataset: Dataset | None = None
    flow: FlowSource

    def __init__(self, dataset: Dataset, names: Sequence[str]) -> None:
        """Raises ElvisError for a name that means nothing of these data."""
        self.names, self._mesh, self.dataset = tuple(names), dataset.mesh, dataset
        self.flow = dataset
        self._expressions = {name: Expression.of(dataset, name) for name in names}
        self._evaluator = Evaluator(dataset, list(self._expressions.values()))
        every = range(len(self._evaluator.names))
        needed = [number for number in every if self._evaluator.names[number] in self._expressions[names[0]].fields]
        found = self._evaluator.patches
        self.patches = [patch for patch in found if all(patch.fields[number] is not None for number in needed)]

    @property
    def boxes(self) -> list[Boxes]:
        """(n, 6) boxes of the elements of each patch."""
        return [element_boxes(patch) for patch in self.patches]

    @property
    def stored(self) -> list[Patch]:
        """The patches of the data: copies of them are not stored."""
        return self.patches

    def data_ids(self, element: Ints) -> Ints:
        """Ids in the data of elements, by those of `patches`; -1 stays."""
        return element

    def outward(self, frame: Frame) -> Frame:
        """The frame with the reference coordinates that others use for these elements."""
        return frame

    def expansion(self, name: str, patch: Patch) -> Expansion | None:
        """The modes of a quantity in a patch; None for what isn't a field."""
        number = self._number(name)
        return None if number is None else patch.fields[number]

    def equation(self, name: str, value: float) -> Equation | None:
        """The equation for a quantity to have a value; None if its terms are unknown."""
        return Equation.of(self._expressions[name].root, value)

    def modes(self, names: Sequence[str], patch: Patch) -> dict[str, int] | None:
        """The numbers of fields in a patch; None if map or fields are no polynomials there, or aren't known."""
        numbers = {name: self._evaluator.names.index(name) for name in names}
        waves = bool(patch.periods) or any(patch.fields[number] is None for number in numbers.values())
        return None if waves or not patch.geometry_coefficients.shape[2] else numbers

    def selected_faces(self, number: int, select: Sequence[str]) -> Bools:
        """(e, local faces) of the faces of a patch that a selection names.

        Raises SceneError for a name that isn't known.
        """
        return selected_faces(self._mesh, self.patches[number], select)

    def guessed_degree(self, name: str, patch: Patch) -> int:
        """The highest degree of an expression's fields and map, in any direction; at least 2."""
        own = [patch.fields[self._evaluator.names.index(field)] for field in self._expressions[name].fields]
        return max(2, *(modes - 1 for each in (patch.geometry, *own) if each is not None for modes in each.modes))

    def corners(self) -> Mapping[str, Corners]:
        """Each quantity at the same points of many elements."""
        return {name: self._at_corners(name) for name in self.names}

    def values(self, name: str, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """(n,) values in elements ``rows`` (n,) at reference points (n, D)."""
        check_time()
        return self._evaluator.values(self._expressions[name], patch, rows, points)

    def values_and_gradients(self, name: str, patch: Patch, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and their derivatives (n, D) in the reference coordinates.

        Derivatives of fields are exact derivatives of the modes; derivatives of expressions are central differences.
        """
        number = self._number(name)
        if number is not None and patch.homogeneous is None:
            expansion, coefficients = patch.fields[number], patch.coefficients[number]
            if expansion is None or coefficients is None:
                return np.full(len(rows), np.nan), np.full(points.shape, np.nan)
            return evaluate_at_with_gradients(expansion, coefficients, rows, points)
        gradients = np.empty(points.shape)
        for axis in range(points.shape[1]):
            step = _STEP * np.eye(points.shape[1])[axis]
            after, before = (self.values(name, patch, rows, points + way) for way in (step, -step))
            gradients[:, axis] = (after - before) / (2 * _STEP)
        return self.values(name, patch, rows, points), gradients

    def rounding(self, name: str, patch: Patch, rows: Ints) -> Floats:
        """(k,) rounding of values in elements (k,), relative to the sum of all modes.

        For expressions, whose terms are unknown, it is relative to the largest value at some places of the element.
        """
        elements, place = np.unique(rows, return_inverse=True)
        number = None if self.expansion(name, patch) is None else self._number(name)
        if number is not None:
            coefficients = patch.coefficients[number]
            assert coefficients is not None
            own = np.abs(coefficients[elements])
            sizes = own.sum(axis=tuple(range(1, own.ndim)))
        else:
            vertices = np.pad(patch.shape.vertices, ((0, 0), (0, patch.dimension - patch.shape.dimension)))
            values = self.corners()[name](patch, elements, np.concatenate([vertices, 0.5 * vertices]))
            sizes = np.abs(np.nan_to_num(values)).max(axis=1)
        return np.asarray(_ROUNDING * sizes[place])

    def _number(self, name: str) -> int | None:
        """The number of the field among those of the patches; None for an expression."""
        expression = self._expressions[name]
        return self._evaluator.names.index(expression.fields[0]) if expression.is_field else None

    def _at_corners(self, name: str) -> Corners:
        number = self._number(name)

        def field(patch: Patch, rows: Ints, points: Floats) -> Floats:
            assert number is not None
            expansion, coefficients = patch.fields[number], patch.coefficients[number]
            if expansion is None or coefficients is None:
                return np.full((len(rows), len(points)), np.nan)
            return evaluate(expansion, coefficients[rows], points)

        def expression(patch: Patch, rows: Ints, points: Floats) -> Floats:
            every = self.values(name, patch, *every_pair(rows, points))
            return every.reshape(len(rows), len(points))

        return expression if number is None else field
