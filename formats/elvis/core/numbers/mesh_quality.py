"""The quality of a mesh: sizes, shapes and variation of Jacobians of its elements, and the time step that they allow.

Numbers inside elements are taken at the points of a Gauss rule: they are estimates of their minimum or maximum.

quality          the smallest mean ratio (Knupp 2001, Algebraic mesh quality metrics)
scaled_jacobian  the smallest determinant divided by the lengths of the columns of the map's derivative
jacobian_ratio   the smallest determinant divided by the largest (Johnen, Remacle and Geuzaine 2013)
edge_ratio       the longest edge divided by the shortest, by the distances of vertices
h                d-th root of the length, area or volume
time_step        the time step of CFL number 1, 1/(0.2 p^2 max |u . grad xi_i|), with the order p of the fields
                 (Karniadakis and Sherwin, Spectral/hp Element Methods for CFD, section 6.3); with Fourier directions
                 the minimum over their planes, for the directions xi_i of the elements
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, grid_points
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.projections import rule
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.shapes import Shape
from elvis.core.streamlines.velocity import velocity_expressions

#: numbers of values at points that are held together
_BATCH = 1 << 20
#: elements in the list of the worst
_WORST = 10
#: the factor of Karniadakis and Sherwin for the growth of eigenvalues with the square of the order
_GROWTH = 0.2
#: measures, and whether small values are the worst; by the first one elements are ordered
MEASURES: Mapping[str, bool] = {
    "quality": True,
    "scaled_jacobian": True,
    "jacobian_ratio": True,
    "edge_ratio": False,
    "h": True,
    "time_step": True,
}


@dataclass(frozen=True, eq=False)
class MeshQuality:
    """Measures of elements, each (n,); those without a value are missing.

    element_ids  (n,)
    shapes       (n,) labels
    places       (n, d) middles of elements
    """

    element_ids: Ints
    shapes: tuple[str, ...]
    places: Floats
    measures: Mapping[str, Floats]

    def facts(self) -> dict[str, Any]:
        """Range and median of each measure, and the worst elements by quality, for JSON."""
        worst = np.argsort(self.measures["quality"], kind="stable")[:_WORST]
        return {
            "elements": len(self.element_ids),
            "measures": {name: _spread(name, self.element_ids, values) for name, values in self.measures.items()},
            "worst": [self._row(number) for number in worst.tolist()],
        }

    def _row(self, number: int) -> dict[str, Any]:
        """The measures of an element."""
        own = {name: float(values[number]) for name, values in self.measures.items()}
        place = self.places[number].tolist()
        return {"element": int(self.element_ids[number]), "shape": self.shapes[number], "place": place, **own}


def mesh_quality(dataset: Dataset) -> MeshQuality:
    """The quality of all elements of the domain, as ``elvis info --quality`` prints it.

    Returns
    -------
    MeshQuality
        Measures of each element; the time step only if the data have a velocity.

    Raises
    ------
    ElvisError
        Without elements in the domain.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.mesh_quality(ds).measures["quality"].round(6)
    array([0.866025])
    """
    velocity = _velocity(dataset)
    evaluator = Evaluator(dataset, velocity)
    held = [patch for patch in evaluator.patches if len(patch)]
    if not held:
        raise ElvisError("expected elements in the domain, found none")
    parts = [part for patch in held for part in _parts(evaluator, velocity, patch)]
    names = [name for name in MEASURES if all(name in part for part in parts)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in names}
    ids = np.concatenate([patch.element_ids for patch in held])
    shapes = tuple(patch.shape.label.lower() for patch in held for _ in range(len(patch)))
    places = np.concatenate([part["places"] for part in parts])[:, : dataset.mesh.space]
    return MeshQuality(ids, shapes, places, found)


def _velocity(dataset: Dataset) -> list[Expression]:
    """The components of the velocity; none for data without one."""
    try:
        return velocity_expressions(dataset, None)
    except ElvisError:
        return []


def _parts(evaluator: Evaluator, velocity: list[Expression], patch: Patch) -> Iterator[dict[str, Floats]]:
    """Measures of the elements of a patch, some at a time."""
    count = max(patch.geometry.modes) + 2
    points, _ = rule(patch.shape, count)
    attributes = evaluator.attributes
    has_velocity = bool(velocity) and None not in patch.fields
    # the elements alone, without Fourier directions of the fields
    plain = replace(patch, fields=(), coefficients=())
    for rows in chunks(len(patch), max(1, _BATCH // len(points))):
        numbers = np.arange(rows.start, rows.stop)
        lattice = Lattice(plain, numbers, points)
        found = _shape_measures(attributes, plain, lattice, len(points))
        found["h"] = attributes.constant("h", patch.shape, patch.element_ids[rows])
        corners = evaluate(patch.geometry, patch.geometry_coefficients[rows], patch.shape.vertices)
        found["edge_ratio"] = edge_ratios(patch.shape, np.swapaxes(corners, 1, 2))
        if has_velocity:
            found["time_step"] = _time_steps(evaluator, velocity, patch, numbers, points)
        yield found


def _shape_measures(attributes: Attributes, patch: Patch, lattice: Lattice, count: int) -> dict[str, Floats]:
    """Measures by the map's derivative at ``count`` points of each element."""

    def at_points(name: str) -> Floats:
        return attributes.at(name, patch, lattice.rows, lattice.points).reshape(-1, count)

    return {
        "quality": at_points("quality").min(axis=1),
        "scaled_jacobian": at_points("scaled_jacobian").min(axis=1),
        "jacobian_ratio": jacobian_ratios(at_points("jacobian")),
        "places": lattice.positions.reshape(-1, count, 3).mean(axis=1),
    }


def jacobian_ratios(determinants: Floats) -> Floats:
    """(n,) the smallest of determinants (n, k) divided by the largest; -inf if all are negative."""
    low, high = determinants.min(axis=1), determinants.max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(high > 0, low / high, np.where(low < 0, -np.inf, 0.0))


def edge_ratios(shape: Shape, corners: Floats) -> Floats:
    """(n,) the longest distance between ends of an edge divided by the shortest, of elements with corners (n, v, 3)."""
    ends = np.array(shape.edges if shape.dimension > 1 else [(0, 1)])
    lengths = np.linalg.norm(corners[:, ends[:, 1]] - corners[:, ends[:, 0]], axis=2)
    with np.errstate(divide="ignore"):
        return np.asarray(lengths.max(axis=1) / lengths.min(axis=1))


def _time_steps(evaluator: Evaluator, velocity: list[Expression], patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(n,) the time step of CFL number 1; infinite where the velocity is zero."""
    fastest = np.zeros(len(rows))
    for zeta in _planes(patch):
        lattice = Lattice(patch, rows, np.hstack([points, np.tile(zeta, (len(points), 1))]))
        components = [np.broadcast_to(own, len(lattice)) for own in evaluator.values_at(velocity, lattice)]
        flow = np.stack(components, axis=1)
        # u . grad xi_i for each reference coordinate of the shape, by the dual tangents grad xi_i
        duals = lattice.duals[:, : flow.shape[1], : patch.shape.dimension]
        rates = np.abs(np.einsum("nkd,nk->nd", duals, flow)).max(axis=1)
        fastest = np.maximum(fastest, rates.reshape(len(rows), -1).max(axis=1))
    order = max(max(own.modes) - 1 for own in patch.fields if own is not None)
    with np.errstate(divide="ignore"):
        return np.asarray(1 / (_GROWTH * order**2 * fastest))


def _planes(patch: Patch) -> Floats:
    """(n, k) coordinates zeta of points along the k Fourier directions, two for each mode."""
    waves = patch.homogeneous
    if waves is None:
        return np.zeros((1, 0))
    ids = (waves.y_ids, waves.z_ids) if waves.y_ids else (waves.z_ids,)
    lines = [np.linspace(-1, 1, 2 * (max(own) + 1), endpoint=False) for own in ids]
    return grid_points(*lines)


def _spread(name: str, ids: Ints, values: Floats) -> dict[str, Any]:
    """The range and the median of a measure, and the worst element."""
    number = int(values.argmin() if MEASURES[name] else values.argmax())
    low, median, high = (float(own) for own in (values.min(), np.median(values), values.max()))
    return {"minimum": low, "median": median, "maximum": high, "worst_element": int(ids[number])}
