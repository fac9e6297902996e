"""Data of any format: native files are read, others converted in memory by the converter that recognises them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.base.terminal import stage
from elvis.core.data.complex_fields import ComplexChoice, named_pairs, pairs_in
from elvis.core.data.dataset import Dataset
from elvis.core.data.moments import Moment
from elvis.core.deformed.deformation import Deformation
from elvis.core.files.plain import check_plain_or_folder
from elvis.core.portions.portion import Portion
from elvis.core.quantities.reference_values import checked_reference
from elvis.formats.nektar.mapped_files import mapped
from elvis.formats.reading import is_native, read_data, read_parts
from elvis.plugins.command.same_files import check_same_files
from elvis.plugins.conversion.discovery import (
    Candidate,
    choose_converter,
    converters_of,
    installed_converters,
    with_defaults,
)
from elvis.plugins.data.others import Others
from elvis.plugins.data.reference_files import reference_beside
from elvis.plugins.runtime.opening import PluginData, open_files
from elvis.plugins.series.step_names import expanded

if TYPE_CHECKING:
    from elvis.formats.nektar.dataset_parts import DatasetParts
    from elvis.formats.reading import Choice
    from elvis.plugins.conversion.kept_conversions import Work
    from elvis.plugins.series.series import Series

T = TypeVar("T")
#: function that receives messages about plugins that fail
Report: TypeAlias = Callable[[str], object]

#: the option that names the fields to read
_FIELDS = "fields"


def _named_fields(dataset: Dataset, wanted: str) -> tuple[str, ...]:
    """Fields by name and the fields of the map; FormatError for unknown names."""
    from elvis.core.data.arguments import field_names

    try:
        return (*dataset.map_names, *field_names(dataset, wanted))
    except ElvisError as error:
        raise FormatError(str(error)) from None


def _with_displacement(dataset: Dataset, chosen: Choice | None, own: Deformation) -> Collection[str]:
    """Fields that are chosen, all for None, and those that a displacement is made of."""
    from elvis.core.quantities.needed import needed_fields
    from elvis.plugins.data.deforming import texts_of_deformation

    if chosen is None:
        return [field.name for field in dataset.fields]
    return {*chosen(dataset), *needed_fields(dataset, texts_of_deformation(dataset, own))}


def _with_parts(dataset: Dataset, chosen: Choice | None, own: ComplexChoice) -> Collection[str]:
    """Fields that are chosen, all for None, and the parts of complex fields that a user names or wants at a phase."""
    known = tuple(dataset)
    pairs = {**(pairs_in(known) if own.phase is not None else {}), **named_pairs(own.named, known)}
    if chosen is None:
        return [field.name for field in dataset.fields]
    return {*chosen(dataset), *(part for pair in pairs.values() for part in pair)}


def _with_components(dataset: Dataset, chosen: Choice | None) -> Collection[str]:
    """Fields that are chosen, all for None, with the other components of their vectors and tensors."""
    from elvis.core.quantities import Names
    from elvis.core.quantities.moved_expressions import components

    if chosen is None:
        return [field.name for field in dataset.fields]
    found = set(chosen(dataset))
    names = Names.of(dataset)
    known = components(names.fields, names.dimension)
    partners = (known[name].names.values() for name in found if name in known)
    return found.union(*partners)


@dataclass(frozen=True)
class Reading:
    """Options for reading files.

    plugin   a runtime plugin by name, or a Python file that defines one, or that defines a converter
    options  of the converter, by name; ``from`` is the name of the converter itself, ``fields`` are the names of the
             fields to read, separated by commas, also of native files
    is_kept  whether conversions are cached
    moment   step or time of a series
    others   datasets for use in expressions, each as NAME=FILE,FILE
    quantities  the only ones that will be requested, the empty one for the first field: of the native format only the
                fields that these need are read; none if they are not known
    is_of_map   whether only the map of elements is requested: of one native state no other fields are read
    is_copied   whether copies of the data are requested, on which a component of a vector depends on the others
    ranks    that read the same, each its part
    reference  values of the flow by name, which override the files' values
    deformation  deformation of the geometry
    complexes  complex fields and their phase
    """

    plugin: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    is_kept: bool = True
    moment: Moment = field(default_factory=Moment)
    others: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    is_of_map: bool = False
    is_copied: bool = False
    ranks: Ranks = ALONE
    reference: Mapping[str, float] = field(default_factory=dict)
    deformation: Deformation | None = None
    complexes: ComplexChoice = field(default_factory=ComplexChoice)

    @property
    def is_plain(self) -> bool:
        """Whether data are wanted as they are in the files, without a deformation and complex fields."""
        return self.deformation is None and not self.complexes

    def choice(self) -> Choice | None:
        """The fields of native files that are needed; None for all, if the requests aren't known."""
        from elvis.core.quantities.needed import needed_fields

        if self.is_copied:
            return partial(_with_components, chosen=replace(self, is_copied=False).choice())
        if self.deformation is not None:
            return partial(_with_displacement, chosen=replace(self, deformation=None).choice(), own=self.deformation)
        if self.complexes:
            without = replace(self, complexes=ComplexChoice())
            return partial(_with_parts, chosen=without.choice(), own=self.complexes)
        if self.is_of_map:
            return attrgetter("map_names")
        if _FIELDS in self.options:
            return partial(_named_fields, wanted=self.options[_FIELDS])
        return partial(needed_fields, texts=self.quantities) if self.quantities else None

    @property
    def has_plain_options(self) -> bool:
        """Whether the options are none of a converter's own."""
        return self.options.keys() <= {_FIELDS}


#: function that opens files according to a reading, and reports plugins that fail
Opening: TypeAlias = Callable[[Sequence[Path], Reading, Report], T]


def read(
    *paths: str | Path,
    reader: Mapping[str, str] | Sequence[str] = (),
    cache: bool = True,
    reference: Mapping[str, float] | None = None,
) -> Dataset:
    """The dataset in files of any format, in any order: of a mesh and, if given, of its fields.

    Other formats are converted in memory; the remarks of the dataset state the error.

    reader  options of the converter, as ``{"step": "3"}`` or ``["step=3"]``; ``from`` names the converter itself,
            ``fields`` the fields to read, separated by commas
    cache   whether conversions are cached
    reference  values of the flow by name, as ``{"mu": 2e-4}``, which override the files' values

    Raises FormatError if a file can't be read or contradicts itself or another, ElvisError if nothing reads the files,
    or a library is missing.

    >>> elvis.read("wing.xml", "wing.fld")
    <Dataset 3D: 480 hexahedra; fields u, v, w, p of order 4>
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


def open_data(paths: Sequence[Path], reading: Reading | None = None, report: Report = str) -> Dataset | PluginData:
    """The data that a runtime plugin opens, else the dataset in the files.

    report  called with one line for each plugin that fails

    Raises as `read`, and PluginError for plugins that don't exist or don't work.
    """
    return _open(paths, reading or Reading(), report, dataset_of)


def open_part(paths: Sequence[Path], reading: Reading, report: Report) -> Dataset | PluginData | Portion:
    """A rank's part of the result of `open_data`, with the ranks of ``reading``; the complete data of a plugin.

    The first rank converts other formats, and all read the result.  Each also has its part of other datasets that
    expressions may name.  Deformed data don't come apart, as a displacement may separate elements of different parts,
    nor do complex fields: each rank has all of them.
    """
    return _open(paths, reading, report, part_of if reading.is_plain else _whole_for_ranks)


def open_parts(paths: Sequence[Path], reading: Reading, report: Report) -> Dataset | PluginData | DatasetParts:
    """The result of `open_data`, for reading part by part if the files are native and one state; else complete."""
    return _open(paths, reading, report, _parts_of)


def _open(
    paths: Sequence[Path],
    reading: Reading,
    report: Report,
    read_files: Callable[[Sequence[Path], Reading], T],
) -> T | Dataset | PluginData:
    """The data of a plugin as in `open_data`, else the result of ``read_files``."""
    paths = expanded(paths)
    own = _converters_in(reading.plugin)
    if own:
        return _convert(paths, own, replace(reading, is_kept=False))
    opened = open_files(paths, reading.plugin, report) if reading.has_plain_options else None
    if opened is None:
        return read_files(paths, reading)
    if reading.moment.step is not None:
        raise ElvisError(f"expected data of several steps, found data opened by the plugin {opened.name} as one")
    if reading.options:
        raise ElvisError(f"--fields: expected fields of files, found data of the plugin {opened.name}: use --field")
    if reading.others:
        raise ElvisError(f"--other: expected elements with a known map, found data of the plugin {opened.name}")
    if reading.deformation is not None:
        raise ElvisError(f"--deform: expected polynomial maps, found data of the plugin {opened.name}")
    if reading.complexes:
        raise ElvisError(f"--phase, --complex: expected fields of files, found data of the plugin {opened.name}")
    values = {**reference_beside(paths), **reading.reference}
    return replace(opened, time=reading.moment.time, reference=values)


def dataset_of(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The dataset in native files, and in others through a converter; ignores the plugin of ``reading``.

    A series gives the moment of ``reading``.
    """
    return _whole_of(*_series_of(paths, reading), reading)


def _whole_of(paths: Sequence[Path], series: Series | None, reading: Reading) -> Dataset:
    """The same of files that are known to be a series, or one state."""
    if series is not None:
        return series.at_moment(reading.moment)
    return reading.moment.of_one_state(state_with_others(paths, reading))


def part_of(paths: Sequence[Path], reading: Reading) -> Portion:
    """The part of one of the ranks of ``reading`` in the result of `dataset_of`."""
    paths, series = _series_of(paths, reading)
    if series is not None:
        part = series.part_at(reading.moment)
        assert isinstance(part, Portion)  # deformed data are read whole
        return part
    found, others = part_of_state(paths, reading), Others(reading, paths)
    dataset = others.beside(reading.moment.of_one_state(found.dataset))
    return others.beside_part(replace(found, dataset=dataset))


def _whole_for_ranks(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The result of `dataset_of` for each of the ranks of ``reading``."""
    check_same_files(expanded(paths), reading.ranks)
    return dataset_of(paths, replace(reading, ranks=ALONE))


def part_of_state(paths: Sequence[Path], reading: Reading) -> Portion:
    """The same of files that are not series, such as one step of it; moments and other data are not examined."""
    ranks = reading.ranks
    check_same_files(paths, ranks)
    if _is_native(paths, reading):
        with mapped():
            portion = read_parts(*paths, choose=reading.choice()).part(ranks.rank, ranks.size)
        return replace(portion, dataset=with_warnings(portion.dataset, ranks))
    from elvis.plugins.conversion.kept_conversions import part_of_conversion

    work = _work(paths, installed_converters(), reading)
    with _stage_of(work):
        return part_of_conversion(work, reading.is_kept, ranks)


def _parts_of(paths: Sequence[Path], reading: Reading) -> Dataset | DatasetParts:
    """The result of `dataset_of`, or for native files that are one state an object that reads part by part."""
    paths, series = _series_of(paths, reading)
    if series is not None or reading.others or not reading.is_plain or not _is_native(paths, reading):
        return _whole_of(paths, series, reading)
    parts = read_parts(*paths, choose=reading.choice())
    return replace(parts, whole=Others(reading, paths).beside(reading.moment.of_one_state(parts.whole)))


def _series_of(paths: Sequence[Path], reading: Reading) -> tuple[Sequence[Path], Series | None]:
    """All files, each of which is plain, and their series, None if they are one state."""
    from elvis.plugins.series.series import series_of

    paths = expanded(paths)
    for path in paths:
        check_plain_or_folder(path)
    return paths, series_of(paths, reading)


def check_readable(paths: Sequence[Path], reading: Reading) -> None:
    """Raise the errors of `dataset_of` for missing files, unknown formats and incomplete meshes.

    Values in HDF5, and in files to be converted, are not read.
    """
    paths = expanded(paths)
    if _is_native(paths, reading):
        with mapped():
            read_parts(*paths)
    else:
        _work(paths, installed_converters(), reading)


def state_with_others(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The result of `state_of`, in which expressions may name other datasets."""
    return Others(reading, paths).beside(state_of(paths, reading))


def state_of(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The dataset of files that are not series, such as one step of it; moments are not examined."""
    if _is_native(paths, reading):
        return with_warnings(read_data(paths, reading.choice()))
    return _convert(paths, installed_converters(), reading)


def with_warnings(dataset: Dataset, ranks: Ranks = ALONE) -> Dataset:
    """Native data, or the part of a rank, with remarks on elements that fold and on doubts of a conversion."""
    from elvis.core.validity.folded import folded
    from elvis.plugins.conversion.report import RecordedReport

    report = RecordedReport.of(dataset.metadata)
    recorded = [] if report is None else [str(warning) for warning in report.facts.get("warnings", [])]
    try:
        found = tuple(folded(dataset, ranks).sentences())
    except ElvisError:
        # a mesh that breaks rules of the format is reported where its map is needed
        found = ()
    return replace(dataset, remarks=tuple(dict.fromkeys((*dataset.remarks, *recorded, *found))))


def _is_native(paths: Sequence[Path], reading: Reading) -> bool:
    """Whether files are read directly."""
    return reading.has_plain_options and all(map(is_native, paths))


def _converters_in(plugin: str | None) -> list[Candidate]:
    """The converters that a Python file defines; none where it defines none, or a plugin is given by its name."""
    if plugin is None or Path(plugin).suffix != ".py":
        return []
    return converters_of(Path(plugin))


def _convert(paths: Sequence[Path], candidates: Sequence[Candidate], reading: Reading) -> Dataset:
    """The dataset that a converter makes of the files, or that was retained when it did."""
    from elvis.plugins.conversion.kept_conversions import load_or_convert

    work = _work(paths, candidates, reading)
    with _stage_of(work):
        return load_or_convert(work, reading.is_kept)


def _work(paths: Sequence[Path], candidates: Sequence[Candidate], reading: Reading) -> Work:
    """Inputs of a conversion, with the converter that recognises the files."""
    from elvis.plugins.conversion.kept_conversions import Work

    options = dict(reading.options)
    names = options.pop(_FIELDS, None)
    fields = None if names is None else tuple(name.strip() for name in names.split(","))
    candidate = choose_converter(candidates, paths, options.pop("from", None))
    assert candidate.converter is not None
    keywords = with_defaults(candidate.converter, options)
    choose = reading.choice() if names is None else None
    return Work(candidate.name, candidate.converter, tuple(paths), keywords, fields, choose)


def _stage_of(work: Work) -> AbstractContextManager[None]:
    """A stage on the terminal while files are converted."""
    from elvis.plugins.conversion.report import named_files

    return stage(f"converting {named_files([path.name for path in work.paths])}")
