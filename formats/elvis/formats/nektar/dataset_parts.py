"""A dataset in files that is built part by part, each with its numbers in the whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, corners_of, index_type
from elvis.core.data.dataset import Dataset
from elvis.core.portions.portion import Portion, carriers, is_even
from elvis.core.shapes import Shape
from elvis.formats.nektar import expansions, fields_input
from elvis.formats.nektar.assembly import RawGeometry, assemble
from elvis.formats.nektar.expansions import RawRule
from elvis.formats.nektar.geometry.parts import RawParts
from elvis.formats.nektar.remarks import Remark, with_remarks
from elvis.formats.nektar.sections import Section

#: bytes of an id in memory
_OF_ID = 8


@dataclass(eq=False)
class DatasetParts:
    """The parts of a dataset as files hold it, which may be mapped.

    raw    its mesh, None if nothing more is read
    whole  the dataset with only the ids of elements, and its fields without values
    """

    raw: RawGeometry | None
    whole: Dataset
    sections: Sequence[Section]
    rules: list[RawRule]
    remarks: list[Remark]
    _cut: RawParts | None = field(default=None, init=False)

    @property
    def bytes(self) -> int:
        """Memory of the arrays of the whole dataset, in bytes."""
        assert self.raw is not None
        raw = self.raw
        count = len(raw.vertex_ids) + sum(len(ids) for ids, _ in raw.tables.values())
        of_row: int = np.dtype(index_type(count)).itemsize
        tables = sum(_OF_ID * ids.size + of_row * members.size for ids, members in raw.tables.values())
        points = raw.vertices.nbytes + raw.edge_curves.points.nbytes + raw.face_curves.points.nbytes
        values = (section.values for section in self.sections)
        return tables + points + sum(own.nbytes for own in values if own is not None)

    @property
    def corners(self) -> Floats:
        """(2, 3) smallest and largest coordinates of vertices and of points of curves."""
        assert self.raw is not None
        return corners_of(self.raw.vertices, self.raw.edge_curves.points, self.raw.face_curves.points)

    def numbers(self, count: int) -> Mapping[Shape, NDArray[Any]]:
        """For each shape of the elements (n,) which of ``count`` parts each is in: they are ranges along a curve.

        Raises FormatError if there are no elements, or what parts need of the whole can't be.
        """
        return self._cut_into(count).numbers

    def _cut_into(self, count: int) -> RawParts:
        """The mesh in parts; their positions are determined once for all of them."""
        if self._cut is None or self._cut.count != count:
            assert self.raw is not None
            self._cut = RawParts(self.raw, count, carriers(self.whole))
        return self._cut

    def of(self, chosen: Bools, *, is_last: bool = False) -> Portion:
        """The union of some of the parts, (count,) which.

        is_last  whether no other is requested later, so that the memory of the file's data is released
        Raises FormatError if they are wrong.
        """
        part = self._cut_into(len(chosen)).of(chosen)
        if is_last:
            self.raw = self._cut = None
        else:
            self.sections = [each.unpacked() for each in self.sections]  # once for all parts
        mesh = with_remarks(assemble(part.raw, is_part=True), self.remarks)
        dataset = Dataset(mesh, expansions=expansions.resolve(self.rules, mesh))
        numbers = (part.sides, part.counts, part.triangles)
        known = Portion(dataset, part.rows, part.edges, part.faces, {}, *numbers, is_even=True)
        return self.on(known.with_sides(part.sides))

    def part(self, number: int, count: int) -> Portion:
        """One of ``count`` parts, as the last one requested."""
        return self.of(np.arange(count) == number, is_last=True)

    def on(self, known: Portion) -> Portion:
        """The fields on a part of the mesh that is known already, between whose elements the same sides are inner ones.

        Raises FormatError if they are wrong.
        """
        mesh = known.dataset.mesh
        fields, blocks = fields_input.assemble_part(self.sections, mesh, self.whole.fields)
        dataset = replace(self.whole, mesh=mesh, fields=fields, expansions=known.dataset.expansions)
        return replace(known, dataset=dataset, blocks=blocks, is_even=is_even(self.whole))
