"""Sources of data for a command: files that become a dataset, or that a runtime plugin opens.

The choice between the two is made here, once; both have the same methods.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, Union

from elvis.core.base.ranks import ALONE, Ranks, is_idle
from elvis.core.data.arguments import (
    between_option,
    cache_option,
    complex_options,
    data_argument,
    deform_options,
    inputs,
    other_option,
    plugin_option,
    reader_option,
    set_option,
    step_option,
    time_option,
)

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.base.terminal import Progress
    from elvis.core.bounds.extrema import Extremum
    from elvis.core.critical.points import CriticalPoints
    from elvis.core.data.complex_fields import ComplexChoice
    from elvis.core.data.dataset import Dataset
    from elvis.core.deformed.deformation import Deformation
    from elvis.core.files.columns import Columns
    from elvis.core.integrals import Integrals
    from elvis.core.numbers.norms import Norm
    from elvis.core.numbers.sampling import Samples
    from elvis.core.portions import Portion
    from elvis.core.quantities import Expression, Names
    from elvis.core.streamlines import TracedLines
    from elvis.core.validity.validity import Validity
    from elvis.plugins.data.data import Reading
    from elvis.plugins.runtime.opening import PluginData
    from elvis.plugins.series.series import Series
    from elvis.renderer.numbers.evaluation import Evaluation

Source: TypeAlias = Union["NativeSource", "Evaluation"]
Facts = dict[str, Any]
T = TypeVar("T")


class NotInPartsError(Exception):
    """The result can't be combined from the parts of the ranks."""


def or_alone(ranks: Ranks, work: Callable[[Ranks], T]) -> T | None:
    """Combined result of ranks; if their parts don't suffice, the first computes alone, others return None."""
    try:
        return work(ranks)
    except NotInPartsError:
        return None if is_idle(ranks) else work(ALONE)


@dataclass(frozen=True)
class Data:
    """The files that a command is given, of any format, and the options that say how they are read.

    is_of_map  whether nothing but the map of elements is requested (see `Reading`)
    is_copied  whether copies of the data are requested (see `Reading`)
    """

    paths: tuple[Path, ...]
    plugin: str | None
    reader: tuple[str, ...]
    is_kept: bool
    step: int | None = None
    time: float | None = None
    between: str = "linear"
    others: tuple[str, ...] = ()
    is_of_map: bool = False
    is_copied: bool = False
    reference: Mapping[str, float] = field(default_factory=dict)
    deformation: Deformation | None = None
    complexes: ComplexChoice | None = None

    def inputs(self, points: str | None = None) -> list[Path]:
        """All files that are read, with a table of points where there is one."""
        from elvis.plugins.data.others import files_of_others

        further = [path for paths in files_of_others(self.others).values() for path in paths]
        return inputs((*self.paths, *further), self.plugin, points)

    def reading(self, quantities: Sequence[str] = ()) -> Reading:
        """The options, for the complete files, or only for quantities (see `Reading`)."""
        from elvis.core.data.moments import Moment
        from elvis.plugins.data.data import Reading, pairs

        moment = Moment(self.step, self.time, self.between)
        options = pairs(self.reader)
        own = Reading(self.plugin, options, self.is_kept, moment, self.others, tuple(quantities), self.is_of_map)
        complexes = self.complexes or own.complexes
        own = replace(own, is_copied=self.is_copied, complexes=complexes)
        return replace(own, reference=self.reference, deformation=self.deformation)

    def source(self, quantities: Sequence[str] = ()) -> Source:
        """The source of the files, or only of quantities, after a note on errors of a conversion.

        Data opened by a runtime plugin are evaluated on a device.
        """
        from elvis.core.base.terminal import warn
        from elvis.plugins.data.data import open_data

        return self.source_of(open_data(self.paths, self.reading(quantities), warn))

    def shared(self, ranks: Ranks, comes_apart: Callable[[Dataset], bool], quantities: Sequence[str] = ()) -> Source:
        """Like `part`, but each rank has the complete data if `part` returns None."""
        found = self.part(ranks, comes_apart, quantities)
        return self.source(quantities) if found is None else found

    def part(
        self,
        ranks: Ranks,
        comes_apart: Callable[[Dataset], bool],
        quantities: Sequence[str] = (),
        series: Series | None = None,
    ) -> Source | None:
        """Like `source`, with the elements of a rank, if results can be combined from all ranks; else None.

        comes_apart  whether they can, for any part of the data, with the same result on all ranks
        series       of the files, if it is already open
        """
        from elvis.core.base.terminal import warn
        from elvis.core.data.dataset import Dataset
        from elvis.core.portions import Portion
        from elvis.plugins.data.data import open_part

        if ranks.size == 1:
            return self.source(quantities) if series is None else self.source_of(series.at_moment())
        reading = replace(self.reading(quantities), ranks=ranks)
        opened = open_part(self.paths, reading, warn) if series is None else series.part_at()
        is_whole = isinstance(opened, Dataset) or (isinstance(opened, Portion) and not _suffices(opened, comes_apart))
        return None if is_whole else self.source_of(opened, ranks)

    def series(self, quantities: Sequence[str] = (), ranks: Ranks = ALONE) -> Series | None:
        """The steps that the files are, where no moment of them is requested; None where they are a single state."""
        from elvis.plugins.series.series import series_in

        if self.step is not None or self.time is not None:
            return None
        return series_in(self.paths, replace(self.reading(quantities), ranks=ranks))

    def whole_series(self, quantities: Sequence[str] = ()) -> Series:
        """The steps that the files are, whatever moment is requested; ElvisError for one state."""
        from elvis.core.base.errors import ElvisError

        found = replace(self, step=None, time=None).series(quantities)
        if found is None:
            raise ElvisError("expected the steps of a series, found one state")
        return found

    def moments(
        self,
        times: tuple[float, float, int] | str,
        description: str,
        quantities: Sequence[str] = (),
        ranks: Ranks = ALONE,
        comes_apart: Callable[[Dataset], bool] = bool,
    ) -> tuple[Series, Iterator[tuple[float, NativeSource]]]:
        """The series of the files, and times and sources in order, as in ``--times``.

        Each step is read once, with progress on the terminal; the rest is as in `part`.  ElvisError for one state,
        NotInPartsError for a state that doesn't come apart.
        """
        import numpy as np

        from elvis.core.base.errors import ElvisError
        from elvis.core.base.terminal import track
        from elvis.core.data.dataset import Dataset
        from elvis.core.data.moments import Moment

        series = self.series(quantities, ranks)
        if series is None:
            raise ElvisError("--times: expected a series, without --step and --time, found one state")
        if isinstance(times, str):
            moments: Iterable[float] = (float(series.times[number]) for number in series.readable())
        else:
            moments = np.linspace(*times).tolist()
        count = len(series) if isinstance(times, str) else times[2]

        def source(time: float) -> NativeSource:
            moment = Moment(time=time, between=self.between)
            if ranks.size == 1:
                return NativeSource(series.at_moment(moment), is_quiet=True)
            part = series.part_at(moment)
            if isinstance(part, Dataset) or not _suffices(part, comes_apart):
                raise NotInPartsError
            return NativeSource(part.dataset, True, part, ranks)

        return series, ((time, source(time)) for time in track(moments, description, count))

    def tell_of(self, series: Series, times: Sequence[float], has_rates: bool = False) -> None:
        """Print how steps of a series were interpolated to times (n,), and the remarks of the series."""
        import numpy as np

        from elvis.core.base.terminal import note
        from elvis.plugins.series.between import polynomial_name

        if has_rates or not np.isin(times, series.times).all():
            note(f"between steps coefficients are interpolated in time ({polynomial_name(self.between, len(series))})")
        for remark in series.told:
            note(remark)

    def source_of(self, opened: Dataset | PluginData | Portion, ranks: Ranks = ALONE) -> Source:
        """The source for open data, after a note on how they were obtained."""
        from elvis.core.base.terminal import note, warn
        from elvis.core.data.dataset import Dataset
        from elvis.core.portions import Portion

        if isinstance(opened, Dataset | Portion):
            dataset, part = (opened.dataset, opened) if isinstance(opened, Portion) else (opened, None)
            for remark in dataset.remarks:
                note(remark)
            # of a map nobody asks for numbers in the whole, which take as much memory as some fields
            return NativeSource(dataset, False, None if self.is_of_map else part, ranks)
        from elvis.renderer.numbers.evaluation import Evaluation

        return Evaluation(opened, warn)


def _suffices(part: Portion, comes_apart: Callable[[Dataset], bool]) -> bool:
    """Whether a part is enough for a rank; unmatched elements of other data may lie anywhere."""
    dataset = part.dataset
    return dataset.others.keys() == dataset.shared.keys() and comes_apart(dataset)


def data_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter ``data`` combines its files and all options for reading them."""

    @data_argument
    @plugin_option
    @reader_option
    @step_option
    @time_option
    @between_option
    @other_option
    @set_option
    @deform_options
    @complex_options
    @cache_option
    @wraps(command)
    def parsed(
        data: tuple[Path, ...],
        plugin: str | None,
        reader: tuple[str, ...],
        no_cache: bool,
        step: int | None,
        time: float | None,
        between: str,
        others: tuple[str, ...],
        reference: dict[str, float],
        deformation: Deformation | None,
        complexes: ComplexChoice,
        **rest: Any,
    ) -> None:
        own = Data(data, plugin, reader, not no_cache, step, time, between, others)
        own = replace(own, reference=reference, deformation=deformation, complexes=complexes)
        command(data=own, **rest)

    return parsed


@dataclass
class NativeSource:
    """A native dataset with the methods of `Evaluation`, without a device.

    is_quiet  whether notes on time derivatives and recovered fields are suppressed
    portion   the part of a rank that the dataset is; None if no parts are requested
    ranks     that have such parts
    """

    dataset: Dataset
    is_quiet: bool = False
    portion: Portion | None = None
    ranks: Ranks = ALONE

    @property
    def is_part(self) -> bool:
        """Whether the dataset is a part of what all ranks have."""
        return self.dataset.mesh.excerpt is not None

    @property
    def names(self) -> Names:
        """Meaning of the names in expressions."""
        from elvis.core.quantities import Names

        return Names.of(self.dataset)

    def expressions(self, texts: Sequence[str] | None) -> list[Expression]:
        """The quantities, or all fields; ElvisError for what names none."""
        from elvis.core.base.terminal import note
        from elvis.core.data.arguments import expressions

        found = list(expressions(self.dataset, texts))
        if not self.is_quiet and self.dataset.rates is not None and any(each.has_rates for each in found):
            note(self.dataset.rates.remark)
        self._tell_recovered(found)
        return found

    def _tell_recovered(self, expressions: Sequence[Expression]) -> None:
        """Print notes on recovered fields, which are not the data."""
        if not self.is_quiet and any(each.has_recovered for each in expressions):
            from elvis.core.base.terminal import note
            from elvis.core.resolution.recovered_remarks import remarks_on_recovered

            for remark in remarks_on_recovered(self.dataset, expressions):
                note(remark)

    def without_top_modes(self) -> NativeSource:
        """The source with its fields truncated (see `elvis.core.resolution.truncation`)."""
        from elvis.core.resolution.truncation import without_top_modes

        dataset = without_top_modes(self.dataset)
        portion = None if self.portion is None else replace(self.portion, dataset=dataset)
        # the notes on the data as they are suffice
        return replace(self, dataset=dataset, portion=portion, is_quiet=True)

    def _surrounded(self, expressions: Sequence[Expression]) -> Dataset:
        """The dataset; of a part with what quantities look at beyond its elements."""
        from elvis.core.portions.borrowing import surrounded

        return self.dataset if self.portion is None else surrounded(self.portion, expressions, self.ranks).dataset

    def probe(self, points: Floats, wanted: Sequence[Expression], every: bool, ranks: Ranks = ALONE) -> Columns:
        """Columns point, x, y, z, element, status, and one of each quantity; ``every``: a row for each element.

        ranks  share the points, or each has its part of the elements; all but the first have no rows in the end
        """
        import numpy as np

        from elvis.core.numbers.sampling import by_elements, by_points
        from elvis.core.quantities.evaluator import Sampler

        sampler, names = Sampler(self._surrounded(wanted), wanted), [each.text for each in wanted]
        radii = np.zeros(len(names))

        def sampled(some: Floats) -> Samples:
            samples = sampler.sample(some, all=every)
            np.maximum(radii, samples.errors.max(axis=0, initial=0.0), out=radii)
            return samples

        if self.is_part:
            found = by_elements(sampled(points), points, every, ranks)
        else:
            found = by_points(lambda some: sampled(some).columns(), points, names, ranks)
        largest = np.max(ranks.exchange(radii, "errors of conversions"), axis=0)
        if not ranks.rank:
            tell_conversion(names, largest.tolist())
        return found

    def norms(self, texts: Sequence[str] | None, ranks: Ranks) -> dict[str, Norm]:
        """Norms of coordinates and fields, or of quantities."""
        from elvis.core.numbers.norms import norms, quantity_norms

        if texts is None:
            return dict(norms(self.dataset, ranks))
        expressions = self.expressions(texts)
        return quantity_norms(self._surrounded(expressions), expressions, ranks)

    def integrate(
        self,
        texts: Sequence[str],
        over: Sequence[str],
        error: float,
        coefficients: str | None = None,
        clip: str | None = None,
        progress: Progress | None = None,
        ranks: Ranks = ALONE,
        reached: Callable[[float], object] | None = None,
        best_effort: bool = False,
        jacobian: str = "absolute",
    ) -> Integrals:
        """Integrals of quantities over parts of the data, and coefficients of forces."""
        from elvis.core.integrals import evaluated, integrate
        from elvis.core.quantities.derived import RECOVERED

        expressions = [] if self.portion is None else evaluated(self.dataset, texts, coefficients)
        if any(RECOVERED in text for text in texts):
            self._tell_recovered(evaluated(self.dataset, texts, coefficients))
        dataset, options = self._surrounded(expressions), (progress, ranks, reached, best_effort, jacobian)
        return integrate(dataset, texts, over, error, coefficients, clip, *options)

    def trace(self, seeds: Sequence[str], velocity: Sequence[str] | None, **settings: Any) -> TracedLines:
        """Streamlines (see `elvis.core.streamlines.trace`)."""
        from elvis.core.streamlines import trace

        return trace(self.dataset, seeds, velocity, **settings)

    def box(self) -> Facts:
        """The ends of the coordinates."""
        from elvis.core.mapping.geometry import geometry
        from elvis.core.summary.summary import box

        return box(self.dataset, geometry(self.dataset))

    def facts(self, texts: Sequence[str]) -> Facts:
        """All facts, by topic, as plain data; of parts nothing elsewhere than at the first rank."""
        from elvis.core.portions.borrowing import borrowing
        from elvis.core.summary.summary import summary
        from elvis.plugins.conversion.report import RecordedReport

        asked = self.expressions(texts) if texts else []
        part = None if self.portion is None else borrowing(self.portion, [each.text for each in asked], self.ranks)
        found = summary(part or self.dataset, asked, self.ranks)
        if not found:
            return {}
        report = RecordedReport.of(self.dataset.metadata)
        if report is not None:
            found["conversion"] = report.facts
        if texts:
            found["distances"] = _distances(part.dataset if part else self.dataset, asked)
        return found

    def critical(self, velocity: Sequence[str], wall: str | None) -> CriticalPoints | None:
        """Zeros of a velocity, of these components if any, or of its shear on a wall.

        With parts, the result is None except on the first rank.
        """
        from elvis.core.critical.points import critical_points, shared_critical_points
        from elvis.core.critical.wall_points import shared_wall_points, wall_points
        from elvis.core.portions.borrowing import borrowing

        dataset, components = self.dataset, velocity or None
        if self.portion is None:
            return critical_points(dataset, components) if wall is None else wall_points(dataset, wall, components)
        part = borrowing(self.portion, velocity, self.ranks)
        if wall is not None:
            return shared_wall_points(part, wall, components, self.ranks)
        return shared_critical_points(part, components, self.ranks)

    def extrema(self, quantities: Sequence[Expression]) -> list[tuple[Extremum, Extremum]]:
        """The minimum and the maximum value of each quantity; of parts none but at the first rank."""
        from elvis.core.bounds.quantity_extrema import quantity_extrema, shared_extrema
        from elvis.core.portions.borrowing import borrowing

        if self.portion is not None:
            part = borrowing(self.portion, [each.text for each in quantities], self.ranks)
            return shared_extrema(part, quantities, self.ranks)
        return [quantity_extrema(self.dataset, each) for each in quantities]

    def validity(self) -> Validity | None:
        """The signs of Jacobians (see `elvis.core.validity`); of parts None elsewhere than at the first rank."""
        from elvis.core.validity.validity import shared_validity, validity

        return shared_validity(self.dataset, self.ranks) if self.is_part else validity(self.dataset)


def native_source(source: Source, option: str) -> NativeSource:
    """Data with polynomials, which an option needs; UsageError for data of a runtime plugin."""
    import click

    if not isinstance(source, NativeSource):
        raise click.UsageError(f"{option} needs native or converted data, found data of a runtime plugin")
    return source


def tell_conversion(names: Iterable[str], radii: Sequence[float]) -> None:
    """Print by how much quantities differ from the source's, if a conversion has errors."""
    from elvis.core.base.terminal import note
    from elvis.core.quantities.conversion_radius import sentence

    text = sentence(list(names), radii)
    if text is not None:
        note(text)


def _distances(dataset: Dataset, asked: Sequence[Expression]) -> Facts:
    """Targets of distances: number of faces, and whether they are closed, which gives distances a sign."""
    from elvis.core.distances import surface_of
    from elvis.core.quantities.tree import target_of

    targets = {target for each in asked for name in each.attributes if (target := target_of(name)) is not None}
    found = {target: surface_of(dataset, target) for target in sorted(targets)}
    return {target: {"faces": own.faces, "closed": own.is_closed} for target, own in found.items()}
