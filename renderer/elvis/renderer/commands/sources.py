"""What a command is asked about: files that become a dataset, or that a runtime plugin opens.

Which of the two it is is decided here, once: both answer the same questions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

from elvis.core.arguments import cache_option, data_argument, inputs, plugin_option, reader_option

if TYPE_CHECKING:
    from elvis.core.arrays import Floats
    from elvis.core.dataset import Dataset
    from elvis.core.files.columns import Columns
    from elvis.core.norms import Norm
    from elvis.core.quantities import Expression, Names
    from elvis.renderer.evaluation import Evaluation

Source: TypeAlias = Union["NativeSource", "Evaluation"]
Facts = dict[str, Any]


@dataclass(frozen=True)
class Data:
    """The files that a command is given, of any format, and the options that say how they are read."""

    paths: tuple[Path, ...]
    plugin: str | None
    reader: tuple[str, ...]
    is_kept: bool

    def inputs(self, points: str | None = None) -> list[Path]:
        """All files that are read, with a table of points where there is one."""
        return inputs(self.paths, self.plugin, points)

    def source(self) -> Source:
        """What answers questions about the files, after a word on what a conversion lost.

        What a runtime plugin opens is evaluated on a device.
        """
        from elvis.core.dataset import Dataset
        from elvis.core.terminal import note, warn
        from elvis.plugins.data import Reading, open_data, pairs

        opened = open_data(self.paths, Reading(self.plugin, pairs(self.reader), self.is_kept), warn)
        if isinstance(opened, Dataset):
            for remark in opened.remarks:
                note(remark)
            return NativeSource(opened)
        from elvis.renderer.evaluation import Evaluation

        return Evaluation(opened, warn)


def data_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter ``data`` is made of its files and of all options that say how they are read."""

    @data_argument
    @plugin_option
    @reader_option
    @cache_option
    @wraps(command)
    def parsed(
        data: tuple[Path, ...], plugin: str | None, reader: tuple[str, ...], no_cache: bool, **rest: Any
    ) -> None:
        command(data=Data(data, plugin, reader, not no_cache), **rest)

    return parsed


@dataclass
class NativeSource:
    """A native dataset, which answers like `Evaluation`, without a device."""

    dataset: Dataset

    @property
    def names(self) -> Names:
        """What names in expressions stand for."""
        from elvis.core.quantities import Names

        return Names.of(self.dataset)

    def expressions(self, texts: Sequence[str] | None) -> list[Expression]:
        """The quantities, or all fields; ElvisError for what names none."""
        from elvis.core.arguments import expressions

        return list(expressions(self.dataset, texts))

    def probe(self, points: Floats, wanted: Sequence[Expression], every: bool) -> Columns:
        """Columns point, x, y, z, element, status, and one of each quantity; ``every``: a row for each element."""
        from elvis.core.quantities.evaluator import Sampler

        return Sampler(self.dataset, wanted).sample(points, all=every).columns()

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
        from elvis.plugins.report import RecordedReport

        found = summary(self.dataset)
        report = RecordedReport.of(self.dataset.metadata)
        if report is not None:
            found["conversion"] = report.facts
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
