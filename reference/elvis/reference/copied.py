"""Copies of data in pictures of the reference: elements with maps and fields of their own.

Unlike the renderer, which moves views and rewrites expressions, this moves coefficients: the map of a copy is
R x + s, and components of vectors are combined by R.  Derivatives then come from the maps, so that quantities have the
right signs only if both ways do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.deformed.isometries import Isometry
from elvis.core.mapping.boxes import Boxes, element_boxes
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.moved_expressions import MovedLeaves, components
from elvis.reference.quantities import Quantities
from elvis.reference.selection import selected_faces
from elvis.scene.cameras.fitting import surrounding
from elvis.scene.record.frame import Frame


class CopiedAttributes(Attributes):
    """Attributes of elements in copies: those of the elements that are copied, and normals that are moved.

    sources  elements that are copied, and isometries, by patches of the copies
    """

    def __init__(self, dataset: Dataset, sources: Mapping[Patch, tuple[Patch, Isometry]]) -> None:
        super().__init__(dataset)
        self._sources = sources

    def at(self, name: str, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """See `Attributes`."""
        source, isometry = self._sources[patch]
        if name not in SIDES[:3]:
            return super().at(name, source, rows, points)
        normals = [super(CopiedAttributes, self).at(own, source, rows, points) for own in SIDES[:3]]
        return np.asarray(isometry.matrix[SIDES.index(name)] @ np.array(normals))


class CopiedQuantities(Quantities):
    """Fields and expressions on all copies of a dataset.

    Elements of copy k have the ids of the data plus k times `stride`.
    """

    def __init__(self, dataset: Dataset, names: Sequence[str], isometries: Sequence[Isometry]) -> None:
        super().__init__(dataset, names)
        self.isometries = tuple(isometries)
        known = Names.of(dataset)
        fields = dict.fromkeys(_needed(self._evaluator.names, known))
        further = [Expression.of(dataset, name) for name in fields]
        self._evaluator = Evaluator(dataset, [*self._expressions.values(), *further])
        held = {patch.element_ids.tobytes() for patch in self.patches}
        self.originals = [patch for patch in self._evaluator.patches if patch.element_ids.tobytes() in held]
        if any(patch.homogeneous for patch in self.originals):
            raise ElvisError("copies: the reference draws no copies of data with Fourier directions")
        self.stride = 1 + max(int(patch.element_ids.max()) for patch in self.originals)
        sources = {}
        for number, isometry in enumerate(self.isometries):
            leaves = MovedLeaves(isometry, known)
            for patch in self.originals:
                sources[_moved(patch, self._evaluator.names, leaves, number * self.stride)] = patch, isometry
        self.patches = list(sources)
        self._evaluator.attributes = CopiedAttributes(dataset, sources)

    @cached_property
    def uncopied(self) -> Quantities:
        """The same of the data themselves."""
        assert self.dataset is not None
        return Quantities(self.dataset, self.names)

    @property
    def boxes(self) -> list[Boxes]:
        """(n, 6) boxes of the elements of the data, and one box around each further copy."""
        own = [element_boxes(patch) for patch in self.originals]
        around = surrounding(own)
        copies = [isometry.box(around).reshape(1, 6) for isometry in self.isometries[1:]]
        return [*own, *(np.asarray(box, np.float32) for box in copies)]

    def outward(self, frame: Frame) -> Frame:
        """The frame with ids of the data, and with the numbers of the copies."""
        copies = np.where(frame.element < 0, -1, frame.element // self.stride)
        assert frame.drawing is not None
        return replace(frame, element=self.data_ids(frame.element), drawing=replace(frame.drawing, copies=copies))

    @property
    def stored(self) -> list[Patch]:
        """See `Quantities`."""
        return self.uncopied.patches

    def data_ids(self, element: Ints) -> Ints:
        """See `Quantities`."""
        return np.where(element < 0, -1, element % self.stride)

    def selected_faces(self, number: int, select: Sequence[str]) -> Bools:
        """See `Quantities`."""
        return selected_faces(self._mesh, self.originals[number % len(self.originals)], select)


def _needed(fields: Sequence[str], names: Names) -> list[str]:
    """Fields, and all components of vectors and tensors that one of them is a component of."""
    families = components(names.fields, names.dimension)
    found = list(fields)
    for name in fields:
        if name in families:
            found += families[name].names.values()
        elif name in names.places:
            found += names.places
    return found


def _moved(patch: Patch, names: Sequence[str], leaves: MovedLeaves, first_id: int) -> Patch:
    """Elements R x + s with the fields of a copy."""
    isometry = leaves.isometry
    maps = np.einsum("ij,njm->nim", isometry.matrix, patch.geometry_coefficients)
    maps += isometry.vector[:, None] * _one(patch.geometry)
    moved = [_combined(patch, names, name, leaves) for name in names]
    return replace(
        patch,
        element_ids=frozen_ints(patch.element_ids + first_id),
        geometry_coefficients=frozen_floats(maps),
        coefficients=tuple(moved),
        corners=None,
    )


def _combined(patch: Patch, names: Sequence[str], name: str, leaves: MovedLeaves) -> Floats | None:
    """Coefficients (n, m) of a field of a copy."""
    number = names.index(name)
    expansion = patch.fields[number]
    if expansion is None:
        return None
    places = leaves.names.places
    total = np.zeros((len(patch), mode_count(expansion)))
    for factor, own in _terms(name, leaves):
        other = names.index(own)
        coefficients = patch.coefficients[other]
        if patch.fields[other] != expansion or coefficients is None:
            raise ElvisError(f"copies: the reference needs {name} and {own} in one expansion")
        total = total + factor * coefficients
    places = leaves.names.places
    shift = leaves.isometry.shift[places.index(name)] if name in places else 0.0
    return frozen_floats(total + shift * _one(expansion))


def _terms(name: str, leaves: MovedLeaves) -> list[tuple[float, str]]:
    """Factors and names of the fields whose sum a field is on a copy."""
    places = leaves.names.places
    if name not in places:
        return list(leaves.fields(name))
    row = leaves.isometry.rotation[places.index(name)]
    return [(factor, own) for factor, own in zip(row, places, strict=False) if factor != 0.0]


def _one(expansion: Expansion) -> Floats:
    """(m,) coefficients of the function 1."""
    line = gauss(max(expansion.modes) + 1)[0]
    eta = np.stack(np.meshgrid(*[line] * expansion.shape.dimension, indexing="ij"), axis=-1)
    table = values(expansion, uncollapse(expansion.shape, eta.reshape(-1, expansion.shape.dimension)))
    found, *_ = np.linalg.lstsq(table, np.ones(len(table)), rcond=None)
    return np.asarray(found)
