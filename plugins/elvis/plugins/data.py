"""Data of any format: native files are read, others converted in memory by the converter that recognises them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from elvis.core.common_elements import common_elements
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.files.plain import check_plain_or_folder
from elvis.core.moments import Moment
from elvis.core.portions.portion import Portion
from elvis.core.terminal import stage
from elvis.formats.reading import is_native, read_data, read_parts
from elvis.plugins.discovery import Candidate, choose_converter, converters_of, installed_converters, with_defaults
from elvis.plugins.opening import PluginData, open_files
from elvis.plugins.series.step_names import expanded

if TYPE_CHECKING:
    from elvis.core.ranks import Ranks
    from elvis.formats.nektar.dataset_parts import DatasetParts
    from elvis.plugins.kept_conversions import Work
    from elvis.plugins.series.series import Series

T = TypeVar("T")


@dataclass(frozen=True)
class Reading:
    """How files become data.

    plugin   a runtime plugin by name, or a Python file that defines one, or that defines a converter
    options  of the converter, by name; ``from`` is the name of the converter itself
    is_kept  whether a conversion is kept for the next time, and one that was kept is taken
    moment   which step of a series, or which time
    others   datasets that expressions may name, each as NAME=FILE,FILE
    quantities  that alone will be asked for, the empty one for the first field: of steps of the native format only the
                fields that these need are read; none where that is not known
    """

    plugin: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    is_kept: bool = True
    moment: Moment = field(default_factory=Moment)
    others: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()


def read(*paths: str | Path, reader: Mapping[str, str] | Sequence[str] = (), cache: bool = True) -> Dataset:
    """The dataset in files of any format, in any order: of a mesh and, where given, of its fields.

    What isn't native is converted in memory; the remarks of the dataset tell with what error.

    reader  options of the converter, as ``{"step": "3"}`` or ``["step=3"]``; ``from`` names the converter itself
    cache   whether a conversion is kept for the next time, and one that was kept is taken

    Raises FormatError where a file can't be read or contradicts itself or another, ElvisError where nothing reads the
    files, or a library is missing.
    """
    if not paths:
        raise ElvisError("expected files to read, found none")
    options = dict(reader) if isinstance(reader, Mapping) else pairs(reader)
    return dataset_of(tuple(map(Path, paths)), Reading(None, options, cache))


def pairs(texts: Sequence[str]) -> dict[str, str]:
    """``NAME=VALUE`` texts by name; ElvisError for others."""
    for text in texts:
        if not text.partition("=")[0].strip() or "=" not in text:
            raise ElvisError(f"expected an option of a converter as NAME=VALUE, found {text!r}")
    found = (text.partition("=") for text in texts)
    return {name.strip(): value.strip() for name, _, value in found}


def files_of_others(texts: Iterable[str]) -> dict[str, tuple[Path, ...]]:
    """``NAME=FILE,FILE`` texts by name; ElvisError for others."""
    found: dict[str, tuple[Path, ...]] = {}
    for text in texts:
        name, _, files = (part.strip() for part in text.partition("="))
        if not name.isidentifier() or not files or name in found:
            raise ElvisError(
                f"--other: expected NAME=FILE,FILE, such as ref=b.xml,b.fld, each name once, found {text!r}"
            )
        found[name] = tuple(Path(file) for file in files.split(","))
    return found


def open_data(
    paths: Sequence[Path], reading: Reading | None = None, report: Callable[[str], object] = str
) -> Dataset | PluginData:
    """What a runtime plugin opens, else the dataset in the files.

    report  called with one line for each plugin that fails when it is asked

    Raises as `read`, and PluginError for plugins that don't exist or don't work.
    """
    return _open(paths, reading or Reading(), report, dataset_of)


def open_part(
    paths: Sequence[Path],
    reading: Reading,
    report: Callable[[str], object],
    ranks: Ranks,
    *,
    divides_others: bool = False,
) -> Dataset | PluginData | Portion:
    """The part that one of several ranks has of what `open_data` opens, if the files are one state; else the whole.

    What isn't native the first rank converts, and all read.
    divides_others  whether of other datasets, which expressions may name, parts are enough, if these hold the same
                    elements; else nothing is divided where there are others
    """
    return _open(paths, reading, report, lambda files, how: _part_of(files, how, ranks, divides_others))


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
    opened = None if reading.options else open_files(paths, reading.plugin, report)
    if opened is None:
        return read_files(paths, reading)
    if reading.moment.step is not None:
        raise ElvisError(f"expected data of several steps, found what the plugin {opened.name} opens as one")
    if reading.others:
        raise ElvisError(f"--other: expected elements of a known map, found what the plugin {opened.name} opens")
    return opened if reading.moment.time is None else replace(opened, time=reading.moment.time)


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


def _part_of(paths: Sequence[Path], reading: Reading, ranks: Ranks, divides_others: bool = False) -> Dataset | Portion:
    """As `dataset_of`, of files that are one state a part; see `open_part`."""
    paths, series = _series_of(paths, reading)
    if series is not None or (reading.others and not divides_others):
        return _whole_of(paths, series, reading)
    if _is_native(paths, reading):
        found: Dataset | Portion = _native_parts(paths, reading).part(ranks.rank, ranks.size)
    else:
        found = _part_of_conversion(paths, reading, ranks)
    if reading.others:
        found = (isinstance(found, Portion) and _beside_parts(found, reading, ranks)) or _whole_of(paths, None, reading)
    return found


def _beside_parts(own: Portion, reading: Reading, ranks: Ranks) -> Portion | None:
    """A part in which expressions may name other datasets, of which each rank has its part, too.

    None where a part doesn't hold the same elements for one of the ranks.
    """
    parts = {
        name: _part_of(files, Reading(is_kept=reading.is_kept), ranks)
        for name, files in files_of_others(reading.others).items()
    }
    others = {name: part.dataset for name, part in parts.items() if isinstance(part, Portion)}
    dataset = beside_others(own.dataset, others)
    is_empty = not len(dataset.mesh.domain_ids())
    has_all = len(others) == len(parts) and (is_empty or dataset.shared.keys() == others.keys())
    if not all(ranks.exchange(has_all, f"other data: {', '.join(reading.others)}")):
        return None
    if is_empty:
        # what holds nothing is of the same kind as what others hold
        dataset = replace(dataset, shared={name: common_elements(dataset, other) for name, other in others.items()})
    return replace(own, dataset=dataset)


def _part_of_conversion(paths: Sequence[Path], reading: Reading, ranks: Ranks) -> Dataset | Portion:
    """The same of files that are converted."""
    from elvis.plugins.kept_conversions import part_of_conversion

    work = _work(paths, installed_converters(), reading)
    with _stage_of(work):
        found = part_of_conversion(work, reading.is_kept, ranks)
    if isinstance(found, Dataset):
        return reading.moment.of_one_state(found)
    return replace(found, dataset=reading.moment.of_one_state(found.dataset))


def _parts_of(paths: Sequence[Path], reading: Reading) -> Dataset | DatasetParts:
    """As `dataset_of`, of native files that are one state what gives one part after another."""
    paths, series = _series_of(paths, reading)
    if series is not None or reading.others or not _is_native(paths, reading):
        return _whole_of(paths, series, reading)
    return _native_parts(paths, reading)


def _native_parts(paths: Sequence[Path], reading: Reading) -> DatasetParts:
    """The same of native files that are one state."""
    parts = read_parts(*paths)
    return replace(parts, whole=reading.moment.of_one_state(parts.whole))


def _series_of(paths: Sequence[Path], reading: Reading) -> tuple[Sequence[Path], Series | None]:
    """All files, each of which is plain, and the series that they are, None where they are one state."""
    from elvis.plugins.series.series import series_of

    paths = expanded(paths)
    for path in paths:
        check_plain_or_folder(path)
    return paths, series_of(paths, reading)


def state_with_others(paths: Sequence[Path], reading: Reading) -> Dataset:
    """As `state_of`, in which expressions may name other datasets."""
    return beside_others(state_of(paths, reading), others_of(reading))


def others_of(reading: Reading) -> dict[str, Dataset]:
    """The datasets that expressions may name, by their names; raises as `read`, and ElvisError for no NAME=FILE."""
    files = files_of_others(reading.others)
    return {name: dataset_of(paths, Reading(is_kept=reading.is_kept)) for name, paths in files.items()}


def beside_others(dataset: Dataset, others: Mapping[str, Dataset]) -> Dataset:
    """A dataset in which expressions may name others, whose remarks it has, too."""
    if not others:
        return dataset
    remarks = [f"{name}: {remark}" for name, other in others.items() for remark in other.remarks]
    return replace(dataset.beside(**others), remarks=(*dataset.remarks, *remarks))


def state_of(paths: Sequence[Path], reading: Reading) -> Dataset:
    """The dataset of files that are no series, such as one step of it; moments are not looked at."""
    if _is_native(paths, reading):
        return read_data(paths)
    return _convert(paths, installed_converters(), reading)


def _is_native(paths: Sequence[Path], reading: Reading) -> bool:
    """Whether files are read as they are."""
    return not reading.options and all(map(is_native, paths))


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
    candidate = choose_converter(candidates, paths, options.pop("from", None))
    assert candidate.converter is not None
    keywords = with_defaults(candidate.converter, options)
    return Work(candidate.name, candidate.converter, tuple(paths), keywords)


def _stage_of(work: Work) -> AbstractContextManager[None]:
    """A word on the terminal while files are converted."""
    return stage(f"converting {', '.join(path.name for path in work.paths)}")
