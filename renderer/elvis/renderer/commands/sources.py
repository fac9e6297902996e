"""What a command is asked about: a native dataset, or what a runtime plugin opens.

Which of the two it is is decided here, once: both answer the same questions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

if TYPE_CHECKING:
    from elvis.core.arrays import Floats
    from elvis.core.dataset import Dataset
    from elvis.core.files.columns import Columns
    from elvis.core.norms import Norm
    from elvis.core.quantities import Expression
    from elvis.plugins.opening import Opened
    from elvis.renderer.evaluation import Evaluation

Source: TypeAlias = Union["NativeSource", "Evaluation"]
Facts = dict[str, Any]


def open_data(paths: Sequence[Path], plugin: str | None) -> Dataset | Opened:
    """The dataset of native files, or what a runtime plugin opens."""
    from elvis.core.terminal import warn
    from elvis.formats.reading import read_data
    from elvis.plugins.opening import open_files

    return open_files(paths, plugin, warn) or read_data(paths)


def source_of(paths: Sequence[Path], plugin: str | None) -> Source:
    """What answers questions about files; what a runtime plugin opens is evaluated on a device."""
    from elvis.core.dataset import Dataset
    from elvis.core.terminal import warn

    data = open_data(paths, plugin)
    if isinstance(data, Dataset):
        return NativeSource(data)
    from elvis.renderer.evaluation import Evaluation

    return Evaluation(data, warn)


@dataclass
class NativeSource:
    """A native dataset, which answers like `Evaluation`, without a device."""

    dataset: Dataset

    def expressions(self, texts: Sequence[str] | None) -> list[Expression]:
        """The quantities, or all fields; ElvisError for what names none."""
        from elvis.core.arguments import expressions

        return list(expressions(self.dataset, texts))

    def probe(self, points: Floats, wanted: Sequence[Expression], every: bool) -> Columns:
        """Columns point, x, y, z, element, status, and one of each quantity; ``every``: a row for each element."""
        from elvis.core.quantities.evaluator import Sampler

        found = Sampler(self.dataset, wanted).sample(points, all=every)
        location = found.location
        places = dict(zip("xyz", found.points.T, strict=True))
        where = {"element": location.element_id, "status": location.status.astype(int)}
        values = dict(zip((each.text for each in wanted), found.values.T, strict=True))
        return {"point": location.point, **places, **where, **values}

    def norms(self, texts: Sequence[str] | None) -> dict[str, Norm]:
        """Norms of coordinates and fields, or of quantities."""
        from elvis.core.norms import norms, quantity_norm

        if texts is None:
            return dict(norms(self.dataset))
        return {each.text: quantity_norm(self.dataset, each) for each in self.expressions(texts)}

    def box(self) -> Facts:
        """The ends of the coordinates."""
        from elvis.core.geometry import geometry
        from elvis.core.summary import box

        return box(self.dataset, geometry(self.dataset))

    def facts(self, texts: Sequence[str]) -> Facts:
        """All facts, by topic, as plain data."""
        from elvis.core.summary import summary

        found = summary(self.dataset)
        if texts:
            asked = self.expressions(texts)
            found["quantities"] = {each.text: self._range(each) for each in asked}
            found["distances"] = self._distances(asked)
        return found

    def _range(self, expression: Expression) -> Facts | None:
        """The bounds of a quantity and what is attained; None where it has no values."""
        from dataclasses import asdict

        from elvis.core.quantities.bounding import quantity_range

        found = quantity_range(self.dataset, expression)
        return None if found is None else asdict(found)

    def _distances(self, asked: Sequence[Expression]) -> Facts:
        """What distances are measured to: how many faces, and whether they are closed, which gives distances a sign."""
        from elvis.core.distances import surface_of
        from elvis.core.quantities.attributes import target_of

        targets = {target for each in asked for name in each.attributes if (target := target_of(name)) is not None}
        found = {target: surface_of(self.dataset, target) for target in sorted(targets)}
        return {target: {"faces": own.faces, "closed": own.is_closed} for target, own in found.items()}
