"""Functions of NGSolve at quadrature points (`IntegrationRuleSpace`), as polynomials."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from elvis.converters.mfem.quadrature import PointFunctions
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape


class PointValues:
    """A function with values only at the quadrature points of elements: the library does not define it between them.

    parts     the library's name for elements inside the mesh, or of a surface
    elements  shapes and numbers of the elements, by the library's names of shapes
    order     order of the polynomials that interpolate its values (`PointFunctions`)

    Raises ElvisError for complex values.
    """

    def __init__(self, name: str, function: Any, parts: Any, elements: Mapping[str, tuple[Shape, Ints]]) -> None:
        import ngsolve

        space = function.space
        if space.is_complex:
            raise ElvisError(f"{name}: expected real values at quadrature points, found complex ones")
        rules = space.GetIntegrationRules()
        self._vector = np.asarray(function.vec, np.float64).reshape(space.ndof, -1)
        self._functions: dict[Shape, PointFunctions] = {}
        self._dofs: dict[int, tuple[Shape, Ints]] = {}
        for name_of_shape, (shape, numbers) in elements.items():
            points = np.array(rules[getattr(ngsolve.ET, name_of_shape.upper())].points, np.float64)
            self._functions[shape] = PointFunctions(shape, points.reshape(-1, shape.dimension))
            for number in numbers.tolist():
                dofs = space.GetDofNrs(ngsolve.ElementId(parts, number))
                self._dofs[number] = shape, np.array(dofs, np.int64)
        self.order = max(functions.order for functions in self._functions.values())

    def at(self, elements: Ints, points: Floats) -> Floats:
        """(k, n, c) values at reference points (n, d) of elements (k,) of one shape."""
        if not len(elements):
            return np.empty((0, len(points), self._vector.shape[1]))
        own = [self._dofs[number] for number in elements.tolist()]
        table = self._functions[own[0][0]].tabulate(points)
        values = self._vector[np.stack([dofs for _, dofs in own])]
        return np.asarray(np.einsum("pn,knc->kpc", table, values))
