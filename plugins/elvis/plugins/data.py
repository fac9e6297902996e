"""Data of any format: native files are read, others converted in memory by the converter that recognises them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from elvis.core.dataset import Dataset
from elvis.core.deformation import Deformation
from elvis.core.errors import ElvisError, FormatError
from elvis.core.files.plain import check_plain_or_folder
from elvis.core.moments import Moment
from elvis.core.portions.portion import Portion
from elvis.core.quantities.reference_values import checked_reference
from elvis.core.ranks import ALONE, Ranks
from elvis.core.terminal import stage
from elvis.formats.nektar.mapped_files import mapped
from elvis.formats.reading import is_native, read_data, read_parts
from elvis.plugins.discovery import Candidate, choose_converter, converters_of, installed_converters, with_defaults
from elvis.plugins.opening import PluginData, open_files
from elvis.plugins.others import Others
from elvis.plugins.reference_files import reference_beside
from elvis.plugins.same_files import check_same_files
from elvis.plugins.series.step_names import expanded

if TYPE_CHECKING:
    from elvis.formats.nektar.dataset_parts import DatasetParts
    from elvis.formats.reading import Choice
    from elvis.plugins.kept_conversions import Work
    from elvis.plugins.series.series import Series

T = TypeVar("T")

#: the option that names the fields to read
_FIELDS = "fields"


def _named_fields(dataset: Dataset, wanted: str) -> tuple[str, ...]:
    """Fields by name and those that hold the map; FormatError for names of none."""
    from elvis.core.arguments import field_names

    try:
        return (*dataset.map_names, *field_names(dataset, wanted))
    except ElvisError as error:
        raise FormatError(str(error)) from None


def _with_displacement(dataset: Dataset, chosen: Choice | None, own: Deformation) -> Collection[str]:
    """Fields that are chosen, all for None, and those that a displacement is made of."""
    from elvis.core.quantities.needed import needed_fields
    from elvis.plugins.deforming import component_texts

    if chosen is None:
        return [field.name for field in dataset.fields]
    return {*chosen(dataset), *needed_fields(dataset, component_texts(dataset, own.displacement))}


@dataclass(frozen=True)
class Reading:
    """How files become data.

    plugin   a runtime plugin by name, or a Python file that defines one, or that defines a converter
    options  of the converter, by name; ``from`` is the name of the converter itself, ``fields`` are the names of the
             fields to read, commas between them, also of native files
    is_kept  whether a conversion is kept for the next time, and one that was kept is taken
    moment   which step of a series, or which time
    others   datasets that expressions may name, each as NAME=FILE,FILE
    quantities  that alone will be asked for, the empty one for the first field: of the native format only the fields
                that these need are read; none where that is not known
    is_of_map   whether nothing but the map of elements is asked for: of one native state no other fields are read
    ranks    that read the same, each its part
    reference  values of the flow by name, which outdo those of the files
    deformation  how the geometry is deformed
    """

    plugin: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    is_kept: bool = True
    moment: Moment = field(default_factory=Moment)
    others: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    is_of_map: bool = False
    ranks: Ranks = ALONE
    reference: Mapping[str, float] = field(default_factory=dict)
    deformation: Deformation | None = None

    def choice(self) -> Choice | None:
        """Which fields of native files are needed; None for all, where it isn't known what is asked for."""
        from elvis.core.quantities.needed import needed_fields

        if self.deformation is not None:
            return partial(_with_displacement, chosen=replace(self, deformation=None).choice(), own=self.deformation)
        if self.is_of_map:
            return attrgetter("map_names")
        if _FIELDS in self.options:
            return partial(_named_fields, wanted=self.options[_FIELDS])
        return partial(needed_fields, texts=self.quantities) if self.quantities else None

    @property
    def has_plain_options(self) -> bool:
        """Whether the options are none of a converter's own."""
        return self.options.keys() <= {_FIELDS}


def read(
    *paths: str | Path,
    reader: Mapping[str, str] | Sequence[str] = (),
    cache: bool = True,
    reference: Mapping[str, float] | None = None,
) -> Dataset:
    """The dataset in files of any format, in any order: of a mesh and, where given, of its fields.

    What isn't native is converted in memory; the remarks of the dataset tell with what error.

    reader  options of the converter, as ``{"step": "3"}`` or ``["step=3"]``; ``from`` names the converter itself,
            ``fields`` the fields to read, commas between them
    cache   whether a conversion is kept for the next time, and one that was kept is taken
    reference  values of the flow by name, as ``{"mu": 2e-4}``, which outdo those of the files

    Raises FormatError where a file can't be read or contradicts itself or another, ElvisError where nothing reads the
    files, or a library is missing.
    """
    if not paths:
        raise ElvisError("expected files to read, found none")
    options = dict(reader) if isinstance(reader, Mapping) else pairs(reader)
    values = checked_reference(dict(reference or {}), "reference")
    return dataset_of(tuple(map(Path, paths)), Reading(None, options, cache, reference=values))


def pairs(texts: Sequence[str]) -> dict[str, str]:
    """``NAME=VALUE`` texts by name; ElvisError for others."""
    for text in texts:
        if not text.partition("=")[0].strip() or "=" not in text:
            raise ElvisError(f"expected an option of a converter as NAME=VALUE, found {text!r}")
    found = (text.partition("=") for text in texts)
    return {name.strip(): value.strip() for name, _, value in found}


def open_data(
    paths: Sequence[Path], reading: Reading | None = None, report: Callable[[str], object] = str
) -> Dataset | PluginData:
    """What a runtime plugin opens, else the dataset in the files.

    report  called with one line for each plugin that fails when it is asked

    Raises as `read`, and PluginError for plugins that don't exist or don't work.
    """
    return _open(paths, reading or Reading(), report, dataset_of)


def open_part(
    paths: Sequence[Path], reading: Reading, report: Callable[[str], object]
) -> Dataset | PluginData | Portion:
    """The part that a rank of those of ``reading`` has of what `open_data` opens; the whole of what a plugin opens.

    What isn't native the first rank converts, and all read.  Of other datasets, which expressions may name, each has
    its part, too.
    """
    return _open(paths, reading, report, part_of)


def open_parts(
    paths: Sequence[Path], reading: Reading, report: Callable[[str], object]
) -> Dataset | PluginData | DatasetParts:
    """What `open_data` opens, to be read part by part if the files are native and one state; else the whole."""
    return _open(paths, reading, report, _parts_of)


def _open(
    paths: Sequence[Path],
    reading: Reading,
    report: Callable[[str], object],
    read_files: Callable[[Sequence[Path], Reading], T],
) -> T | Dataset | PluginData:
    """See `open_data`; what no plugin opens is read by ``read_files``."""
    paths = expanded(paths)
    own = _converters_in(reading.plugin)
    if own:
        return _convert(paths, own, replace(reading, is_kept=False))
    opened = open_files(paths, reading.plugin, report) if reading.has_plain_options else None
    if opened is None:
        return read_files(paths, reading)
    if reading.moment.step is not None:
        raise ElvisError(f"expected data of several steps, found what the plugin {opened.name} opens as one")
    if reading.options:
        raise ElvisError(f"--fields: expected fields of files, found what the plugin {opened.name} opens: use --field")
    if reading.others:
        raise ElvisError(f"--other: expected elements of a known map, found what the plugin {opened.name} opens")
    if reading.deformation is not None:
        raise ElvisError(f"--deform: expected polynomial maps, found what the plugin {opened.name} opens")
    values = {**reference_beside(paths), **reading.reference}
    return replace(opened, time=reading.moment.time, reference=values)


def dataset_of(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The dataset in native files, and in others by way of a converter; the plugin of ``reading`` is not asked.

    Of a series it is the moment of ``reading``.
    """
    return _whole_of(*_series_of(paths, reading), reading)


def _whole_of(paths: Sequence[Path], series: Series | None, reading: Reading) -> Dataset:
    """The same of files that are known to be a series, or one state."""
    if series is not None:
        return series.at_moment(reading.moment)
    return reading.moment.of_one_state(state_with_others(paths, reading))


def part_of(paths: Sequence[Path], reading: Reading) -> Portion:
    """The same of a part, that of one of the ranks of ``reading``."""
    paths, series = _series_of(paths, reading)
    if series is not None:
        return series.part_at(reading.moment)
    found, others = part_of_state(paths, reading), Others(reading, paths)
    dataset = others.beside(reading.moment.of_one_state(found.dataset))
    return others.beside_part(replace(found, dataset=dataset))


def part_of_state(paths: Sequence[Path], reading: Reading) -> Portion:
    """The same of files that are no series, such as one step of it; moments and other data are not looked at."""
    ranks = reading.ranks
    check_same_files(paths, ranks)
    if _is_native(paths, reading):
        with mapped():
            portion = read_parts(*paths, choose=reading.choice()).part(ranks.rank, ranks.size)
        return replace(portion, dataset=with_warnings(portion.dataset, ranks))
    from elvis.plugins.kept_conversions import part_of_conversion

    work = _work(paths, installed_converters(), reading)
    with _stage_of(work):
        return part_of_conversion(work, reading.is_kept, ranks)


def _parts_of(paths: Sequence[Path], reading: Reading) -> Dataset | DatasetParts:
    """As `dataset_of`, of native files that are one state what gives one part after another."""
    paths, series = _series_of(paths, reading)
    if series is not None or reading.others or reading.deformation is not None or not _is_native(paths, reading):
        return _whole_of(paths, series, reading)
    parts = read_parts(*paths, choose=reading.choice())
    return replace(parts, whole=Others(reading, paths).beside(reading.moment.of_one_state(parts.whole)))


def _series_of(paths: Sequence[Path], reading: Reading) -> tuple[Sequence[Path], Series | None]:
    """All files, each of which is plain, and the series that they are, None where they are one state."""
    from elvis.plugins.series.series import series_of

    paths = expanded(paths)
    for path in paths:
        check_plain_or_folder(path)
    return paths, series_of(paths, reading)


def check_readable(paths: Sequence[Path], reading: Reading) -> None:
    """Errors of `dataset_of` for files that are missing, of no known format, or without a whole mesh: of HDF5, and of
    what is converted, no values are read."""
    paths = expanded(paths)
    if _is_native(paths, reading):
        with mapped():
            read_parts(*paths)
    else:
        _work(paths, installed_converters(), reading)


def state_with_others(paths: Sequence[Path], reading: Reading) -> Dataset:
    """As `state_of`, in which expressions may name other datasets."""
    return Others(reading, paths).beside(state_of(paths, reading))


def state_of(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The dataset of files that are no series, such as one step of it; moments are not looked at."""
    if _is_native(paths, reading):
        return with_warnings(read_data(paths, reading.choice()))
    return _convert(paths, installed_converters(), reading)


def with_warnings(dataset: Dataset, ranks: Ranks = ALONE) -> Dataset:
    """Native data, or the part of a rank, with remarks on elements that fold and on doubts of a conversion."""
    from elvis.core.validity.folded import folded
    from elvis.plugins.report import RecordedReport

    report = RecordedReport.of(dataset.metadata)
    recorded = [] if report is None else [str(warning) for warning in report.facts.get("warnings", [])]
    try:
        found = tuple(folded(dataset, ranks).sentences())
    except ElvisError:
        # a mesh that breaks rules of the format is reported where its map is needed
        found = ()
    return replace(dataset, remarks=tuple(dict.fromkeys((*dataset.remarks, *recorded, *found))))


def _is_native(paths: Sequence[Path], reading: Reading) -> bool:
    """Whether files are read as they are."""
    return reading.has_plain_options and all(map(is_native, paths))


def _converters_in(plugin: str | None) -> list[Candidate]:
    """The converters that a Python file defines; none where it defines none, or a plugin is given by its name."""
    if plugin is None or Path(plugin).suffix != ".py":
        return []
    return converters_of(Path(plugin))


def _convert(paths: Sequence[Path], candidates: Sequence[Candidate], reading: Reading) -> Dataset:
    """The dataset that a converter makes of the files, or that was kept when it did."""
    from elvis.plugins.kept_conversions import load_or_convert

    work = _work(paths, candidates, reading)
    with _stage_of(work):
        return load_or_convert(work, reading.is_kept)


def _work(paths: Sequence[Path], candidates: Sequence[Candidate], reading: Reading) -> Work:
    """What a conversion is made of, by the converter that recognises the files."""
    from elvis.plugins.kept_conversions import Work

    options = dict(reading.options)
    names = options.pop(_FIELDS, None)
    fields = None if names is None else tuple(name.strip() for name in names.split(","))
    candidate = choose_converter(candidates, paths, options.pop("from", None))
    assert candidate.converter is not None
    keywords = with_defaults(candidate.converter, options)
    return Work(candidate.name, candidate.converter, tuple(paths), keywords, fields)


def _stage_of(work: Work) -> AbstractContextManager[None]:
    """A word on the terminal while files are converted."""
    return stage(f"converting {', '.join(path.name for path in work.paths)}")
