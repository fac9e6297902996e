"""The request of ``elvis probe`` at points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.renderer.commands.sources import Data

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.data.dataset import Dataset
    from elvis.core.files.columns import Columns
    from elvis.core.quantities import Expression
    from elvis.renderer.commands.sources import Source
    from elvis.scene.model.copies import Copies


@dataclass(frozen=True)
class Asked:
    """Request for values at points.

    texts  quantities; None for all fields
    every  whether every element that contains a point has a row
    clip   a surface whose inside is excluded, as in `elvis.core.integrals.integrate`
    ranks  that share the points, or have parts of the elements
    copies of the data, whose values count too
    """

    texts: list[str] | None
    every: bool = False
    clip: str | None = None
    ranks: Ranks = ALONE
    copies: Copies | None = None

    @property
    def quantities(self) -> tuple[str, ...]:
        """All quantities to evaluate, including those of --clip; none for all fields."""
        return tuple(self.texts or ()) if self.clip is None else ()

    def source(self, data: Data) -> Source:
        """The source of the values, with only a rank's own elements if they suffice."""
        return data.shared(self.ranks, self.comes_apart, self.quantities)

    def comes_apart(self, dataset: Dataset) -> bool:
        """Whether elements of ranks are enough."""
        from elvis.core.data.arguments import expressions
        from elvis.core.data.axis_planes import needs_box
        from elvis.core.integrals.levels.of_elements import Level

        if dataset.deformation is not None and dataset.deformation.is_height:
            # the height at a point comes from its own element
            return False
        if self.clip and needs_box(self.clip):
            return False
        level = [Level.clip(dataset, self.clip).expression] if self.clip else []
        return all(each.is_borrowed for each in (*expressions(dataset, self.texts), *level))

    def of(self, source: Source, places: Floats, wanted: Sequence[Expression]) -> Columns:
        """The table of quantities at points (n, 3); clipped points are outside."""
        if source.dataset is not None:
            from elvis.plugins.data.deforming import on_height

            places = on_height(source.dataset, places)
        if self.copies is not None:
            from elvis.renderer.commands.with_copies import probe_copies

            return probe_copies(source, self.copies, places, wanted)
        if self.clip is None:
            return source.probe(places, wanted, self.every, self.ranks)
        if source.dataset is None:
            raise ElvisError("--clip: expected data with a known element map, found data opened by a plugin")
        import numpy as np

        from elvis.core.integrals.levels.of_elements import Level
        from elvis.core.mapping.inverse import Status

        # at most zero where something is left, no number where the expression has no value
        level = Level.clip(source.dataset, self.clip).expression
        found = dict(source.probe(places, [*wanted, level], self.every, self.ranks))
        is_gone = ~(np.asarray(found.pop(level.text), np.float64) <= 0)
        nothing = {"element": -1, "status": int(Status.OUTSIDE), **{each.text: np.nan for each in wanted}}
        for name, value in nothing.items():
            found[name] = np.where(is_gone, value, found[name]).astype(found[name].dtype)
        return found
