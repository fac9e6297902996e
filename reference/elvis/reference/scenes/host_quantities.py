"""Points, quantities and faces of what a runtime plugin describes in NumPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, every_pair
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.boxes import Boxes
from elvis.core.mapping.patch import Patch
from elvis.core.quantities import Expression
from elvis.core.streamlines.flow_data import FlowSource
from elvis.plugins.faces import Faces, faces_of
from elvis.plugins.runtime.host.evaluation import (
    HostEvaluation,
    evaluate_expression,
    host_evaluations,
    numerical_derivatives,
)
from elvis.plugins.runtime.host.flow import HostFlow
from elvis.plugins.runtime.host.patch import HostPatch
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import names_of
from elvis.reference.quantities import Corners, Quantities
from elvis.reference.selection import on_faces
from elvis.scene.record.frame import Frame


class HostQuantities(Quantities):
    """Quantities of fields that a plugin has opened; like `elvis.reference.quantities.Quantities`.

    boxes  of the elements of each patch
    """

    def __init__(self, opened: PluginData, names: Sequence[str]) -> None:
        """Raises ElvisError where the plugin describes its elements in no NumPy."""
        self.names, known = tuple(names), names_of(opened)
        self._opened = opened
        self._expressions = {name: Expression.parse(name, known) for name in names}
        fields = dict.fromkeys(name for each in self._expressions.values() for name in each.fields)
        self.volumes = {name: opened.volume(name) for name in fields or opened.fields[:1]}
        self.volume = next(iter(self.volumes.values()))
        every = [host_evaluations(volume) for volume in self.volumes.values()]
        hosts = None if None in every else every[0]
        if hosts is None:
            wanted = "parts with a shape and `evaluate`"
            raise ElvisError(f"the plugin {opened.name} can't be drawn in NumPy: expected {wanted}, found others")
        self.hosts = [HostPatch(host) for host in hosts]
        self.patches = list[Patch](self.hosts)

        # quantities that can't be evaluated are rejected immediately
        for name in self.names if len(self.hosts[0]) else ():
            self.values(name, self.patches[0], np.zeros(1, np.int64), np.zeros((1, self.hosts[0].shape.dimension)))

    @cached_property
    def flow(self) -> FlowSource:  # type: ignore[override]
        """The data in which lines are traced."""
        return HostFlow(self._opened)

    @property
    def boxes(self) -> list[Boxes]:
        """(n, 6) boxes of the elements of each patch."""
        return [np.asarray(patch.host.part.boxes) for patch in self.hosts]

    def values(self, name: str, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """(n,) values in elements ``rows`` (n,) at reference points (n, d)."""
        number = self.patches.index(patch)
        hosts = {field: HostEvaluation(volume.parts[number], patch.shape) for field, volume in self.volumes.items()}
        return evaluate_expression(self._expressions[name], hosts, rows, points)

    def values_and_gradients(self, name: str, patch: Patch, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and their derivatives (n, d) in the reference coordinates."""

        def values(rows: Ints, points: Floats) -> Floats:
            return self.values(name, patch, rows, points)

        return values(rows, points), numerical_derivatives(values, rows, points)

    def equation(self, name: str, value: float) -> None:
        """None: nothing is known of plugins' functions but their values."""

    def outward(self, frame: Frame) -> Frame:
        """The frame with reference coordinates from 0 to 1 if the plugin has these."""
        for patch in self.hosts:
            here = np.isin(frame.element, patch.element_ids) & patch.host.part.unit
            if frame.reference is not None:
                frame.reference[here] = (1 + frame.reference[here]) / 2
        return frame

    def expansion(self, name: str, patch: Patch) -> Expansion | None:
        """None: what plugins hold is of unknown degrees."""
        return None

    def guessed_degree(self, name: str, patch: Patch) -> int:
        """A degree that plugins' functions are near to in small boxes."""
        return 4

    def corners(self) -> Mapping[str, Corners]:
        """Each quantity at the same points of many elements."""
        return {name: self._at_corners(name) for name in self.names}

    def _at_corners(self, name: str) -> Corners:
        def corners(patch: Patch, rows: Ints, points: Floats) -> Floats:
            every = self.values(name, patch, *every_pair(rows, points))
            return every.reshape(len(rows), len(points))

        return corners

    @cached_property
    def _faces(self) -> Faces:
        return faces_of(None, self.volume)

    def selected_faces(self, number: int, select: Sequence[str]) -> Bools:
        """(e, local faces) of the faces of a patch that a selection names."""
        patch = self.hosts[number]
        chosen = np.zeros((len(patch), len(patch.shape.faces)), bool)
        for block, rows in zip(self._faces.blocks, self._faces.select(select), strict=True):
            if block.part == number and len(rows):
                # (-1/3, -1/3) lies within triangles and quadrilaterals
                middles = block.frames[:, 0] - block.frames[:, 1:].sum(axis=1) / 3
                own = 2 * middles - 1 if patch.host.part.unit else middles
                local = on_faces(patch, own).argmax(axis=1)
                chosen[block.element[rows], local[block.local[rows]]] = True
        return chosen
