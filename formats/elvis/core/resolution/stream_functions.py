"""Stream functions of plane flows: psi with d(psi,y) = u and d(psi,x) = -v, in a continuous space.

Among all functions psi of the space, the one is taken whose velocity is nearest in L2:

    integral of (grad psi - (-v, u)) . grad phi = 0      for all phi of the space

These are the weak equations of -Laplace psi = vorticity with natural boundary conditions; they need no value on walls
(Karniadakis and Sherwin, Spectral/hp Element Methods for CFD, section 1.3).  A constant is free in each part of the
mesh: there psi has the mean zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field
from elvis.core.polynomials.expansion import values_and_gradients
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.resolution.continuous_space import ContinuousSpace, Part
from elvis.core.streamlines.velocity import velocity_expressions

#: numbers in a table of gradients of functions at points of elements
_BATCH = 1 << 21


@dataclass(frozen=True, eq=False)
class StreamFunction:
    """A stream function.

    residual  L2 norm of the difference between its velocity and that of the flow, relative to that of the flow
    """

    field: Field
    residual: float


def with_stream_function(
    dataset: Dataset, name: str = "stream_function", velocity: Sequence[str] | None = None
) -> Dataset:
    """Plane data with the stream function of their flow as a further field: d(name,y) = u and d(name,x) = -v.

    Parameters
    ----------
    dataset : Dataset
        Plane data.
    name : str
        Name of the field, of one order more than those of the velocity; its mean is zero.
    velocity : sequence of str, optional
        Two components; by default the usual ones for the names of the fields.

    Returns
    -------
    Dataset
        A remark states how far the velocity of the stream function is from that of the flow.

    Raises
    ------
    ElvisError
        For data that are not plane, have Fourier directions or no velocity, and for a field of this name.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[1, 1, 1]], v=[[0, 0, 0]])
    >>> elvis.with_stream_function(ds)
    <Dataset 2D: 1 triangle; fields u, v, stream_function of order 1 to 2>
    """
    if name in (own.name for own in dataset.fields):
        raise ElvisError(f"field {name!r} already exists; give the stream function another name")
    found = stream_function(dataset, name, velocity)
    remark = f"the velocity of {name} differs from that of the flow by {found.residual:.2g} of it, in L2"
    return replace(dataset, fields=(*dataset.fields, found.field), remarks=(*dataset.remarks, remark))


def stream_function(dataset: Dataset, name: str, velocity: Sequence[str] | None = None) -> StreamFunction:
    """The stream function of a plane flow, of one order more than the fields of its velocity.

    velocity  two components; by default the usual ones for the names of the fields

    Raises ElvisError for data that are not plane, have Fourier directions, or have no velocity.
    """
    if (dataset.mesh.dimension, dataset.mesh.space) != (2, 2):
        raise ElvisError(f"{name}: expected plane data, found {dataset.mesh.dimension}D elements")
    components = velocity_expressions(dataset, velocity)
    evaluator = Evaluator(dataset, components)
    held = [patch for patch in evaluator.patches if len(patch) and None not in patch.fields]
    modes = [max(own.modes) for patch in held for own in patch.fields if own is not None]
    space = ContinuousSpace.of(dataset, held, max(modes, default=1) + 1, name)
    flow = _Flow(evaluator, components, space)
    unknowns = flow.solved()
    return StreamFunction(space.field(name, unknowns), flow.residual(unknowns))


@dataclass(frozen=True, eq=False)
class _Batch:
    """Some elements of a part.

    rows       of the part
    gradients  (n, q, m, 2) of the functions, in x and y
    rotated    (n, q, 2) the vector (-v, u)
    """

    part: Part
    rows: slice
    gradients: Floats
    rotated: Floats

    @property
    def weights(self) -> Floats:
        """(n, q) of the quadrature."""
        return self.part.weights[self.rows]


class _Flow:
    """The velocity of a flow, and the space of its stream function."""

    def __init__(self, evaluator: Evaluator, components: Sequence[Expression], space: ContinuousSpace) -> None:
        self._evaluator, self._components, self._space = evaluator, components, space

    def solved(self) -> Floats:
        """(size,) unknowns of the stream function."""
        space = self._space
        right = np.zeros(space.size)
        rows, columns, entries = [], [], []
        for batch in self._batches():
            weighted = batch.gradients * batch.weights[:, :, None, None]
            numbers = batch.part.numbers[batch.rows]
            right += space.scattered(numbers, np.einsum("nqmi,nqi->nm", weighted, batch.rotated))
            stiffness = np.einsum("nqki,nqmi->nkm", weighted, batch.gradients, optimize=True)
            entries.append(stiffness.reshape(-1))
            rows.append(np.repeat(numbers, numbers.shape[1], axis=1).reshape(-1))
            columns.append(np.tile(numbers, numbers.shape[1]).reshape(-1))
        pairs = (np.concatenate(rows), np.concatenate(columns))
        matrix = sparse.csr_matrix((np.concatenate(entries), pairs), (space.size, space.size))

        # one node of each part of the mesh, whose numbers come before those of inner functions, gets the value 0
        _, owner = connected_components(matrix, directed=False)
        _, first = np.unique(owner, return_index=True)
        free = np.setdiff1d(np.arange(space.size), first)
        found = np.zeros(space.size)
        found[free] = spsolve(matrix[free][:, free].tocsc(), right[free])
        return found - space.means(found, owner) * space.one()

    def residual(self, unknowns: Floats) -> float:
        """See `StreamFunction`."""
        squares, whole = 0.0, 0.0
        for batch in self._batches():
            own = unknowns[batch.part.numbers[batch.rows]]
            difference = np.einsum("nqmi,nm->nqi", batch.gradients, own) - batch.rotated
            squares += float((batch.weights * (difference**2).sum(axis=2)).sum())
            whole += float((batch.weights * (batch.rotated**2).sum(axis=2)).sum())
        return (squares / whole) ** 0.5 if whole else 0.0

    def _batches(self) -> Iterator[_Batch]:
        """All elements, some at a time."""
        for part in self._space.parts:
            _, modal = values_and_gradients(part.target, part.points)
            reference = np.einsum("qcd,cm->qmd", modal.transpose(0, 2, 1), part.functions)
            step = max(1, _BATCH // reference.size)
            for start in range(0, len(part.patch), step):
                rows = slice(start, min(start + step, len(part.patch)))
                yield self._batch(part, rows, reference)

    def _batch(self, part: Part, rows: slice, reference: Floats) -> _Batch:
        """Some elements of a part, from the gradients (q, m, d) of functions in reference coordinates."""
        places = Lattice(part.patch, np.arange(rows.start, rows.stop), part.points)
        shape = (rows.stop - rows.start, len(part.points))
        duals = places.duals.reshape(*shape, 3, 2)[:, :, :2]
        gradients = np.einsum("nqid,qmd->nqmi", duals, reference, optimize=True)
        u, v = (
            np.broadcast_to(own, shape[0] * shape[1]) for own in self._evaluator.values_at(self._components, places)
        )
        return _Batch(part, rows, gradients, np.stack([-v, u], axis=1).reshape(*shape, 2))
