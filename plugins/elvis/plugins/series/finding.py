"""Detection of steps of a series among files: by their contents, by an index, by numbers in their names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE
from elvis.formats.field_heads import FieldHead, field_head, is_no_mesh
from elvis.formats.reading import is_native
from elvis.plugins.conversion.discovery import choose_converter, installed_converters
from elvis.plugins.conversion.plugin import Converter
from elvis.plugins.series.step_names import groups, numbered, pattern_of

if TYPE_CHECKING:
    from elvis.plugins.data.data import Reading

#: remark if times are numbers
NO_TIMES = "the files contain no times: the numbers in their names are used"


@dataclass(frozen=True)
class Step:
    """A step of a series.

    time    in the unit of the files; None if neither file nor name gives it
    files   of the step, without common files
    option  its number in the converter, None if it has files of its own
    """

    time: float | None
    files: tuple[Path, ...] = ()
    option: int | None = None

    @property
    def name(self) -> str:
        """The step in words."""
        return ", ".join(path.name for path in self.files) or f"step {self.option} of the file"


@dataclass
class Found:
    """Steps, ascending in time; their common files; remarks.

    common     files with the mesh, an index or all steps
    is_native  whether the steps are field files of the native format
    """

    common: tuple[Path, ...]
    steps: list[Step]
    is_native: bool = False
    remarks: list[str] = field(default_factory=list)


def find_steps(paths: Sequence[Path], reading: Reading) -> Found | None:
    """The series that files are, None where they are a single state.

    Files of some formats are steps or parts of one mesh: they are steps where a moment is requested.
    """
    if reading.plugin is not None:
        return None
    found = _native(paths)
    if found is None and "step" not in reading.options:
        found = _converted(paths, reading)
    return None if found is None else _in_order(found)


def _native(paths: Sequence[Path]) -> Found | None:
    """Field files that hold the same fields on the same elements, so that they can't be parts of one state."""
    if len(paths) < 2:
        return None
    heads = {path: head for path in paths if (head := field_head(path)) is not None}
    if not heads:
        return None
    counts = Counter(head.mark for head in heads.values())
    alike = {path for path, head in heads.items() if counts[head.mark] > 1}
    begun = {path for path in paths if path not in heads and is_no_mesh(path)}
    patterns = {pattern_of(path) for path in alike or heads}
    members = [path for path in paths if path in begun or path in heads]
    members = [path for path in members if path in alike or pattern_of(path) in patterns]
    if len(members) < 2 or not (alike or begun.intersection(members)):
        return None
    common = set(paths).difference(members)
    found = Found(tuple(path for path in paths if path in common), [], is_native=True)
    has_times = any(head.time is not None for head in heads.values())
    for number, path in _by_number(members):
        head = heads.get(path, FieldHead(None, "", "the field file is incomplete"))
        fault = head.fault or (_fault_of(head.time) if has_times else "")
        if fault:
            found.remarks.append(f"{path.name}: {fault}: the step is skipped")
        else:
            found.steps.append(Step(head.time if has_times else number, (path,)))
    if not has_times:
        found.remarks.append(NO_TIMES)
    told = [step.time for step in found.steps]
    numbers = {path: number for number, path in _by_number(members)}
    if _is_one_time(told) and None not in numbers.values():
        found.remarks.append(_one_time(told))
        found.steps = [replace(step, time=numbers[step.files[0]]) for step in found.steps]
    return found


def _fault_of(time: float | None) -> str:
    """Reason why a time can't belong to a step among others with times; empty for valid times."""
    if time is None:
        return "it has no time, unlike the others"
    return "" if isfinite(time) else f"its time is {time:g}"


def _by_number(members: Sequence[Path]) -> list[tuple[float | None, Path]]:
    """Files in the order of their numbers; files of several patterns in the order given, without numbers."""
    own = numbered(members) if len(groups(members)) == 1 else {}
    return list(own.items()) if own else [(None, path) for path in members]


def _converted(paths: Sequence[Path], reading: Reading) -> Found | None:
    """Steps of files that a converter reads."""
    options = dict(reading.options)
    name = options.pop("from", None)
    if reading.moment.is_asked and not (name is None and all(map(is_native, paths))):
        with suppress(ElvisError):
            converter = _converter(paths, name)
            times = converter.times(paths)
            if len(times) > 1:
                return _listed(paths, times)
    return _numbered(paths, reading, name)


def _listed(paths: Sequence[Path], times: Sequence[float]) -> Found:
    """Steps by the times that files list, without missing ones."""
    steps = [Step(time, option=number) for number, time in enumerate(times)]
    lacking = [number for number, time in enumerate(times) if not isfinite(time)]
    found = Found(tuple(paths), [step for step, time in zip(steps, times, strict=True) if isfinite(time)])
    if lacking:
        some = f"steps {lacking[0]} to {lacking[-1]}" if len(lacking) > 1 else f"step {lacking[0]}"
        counts = f"{len(lacking)} of {len(steps)} steps are missing or damaged, and skipped"
        found.remarks.append(f"{some} of the file: {counts}")
    return found


def _converter(paths: Sequence[Path], name: str | None) -> type[Converter]:
    """The converter of files; ElvisError where there is none."""
    found = choose_converter(installed_converters(), paths, name).converter
    assert found is not None
    return found


def _numbered(paths: Sequence[Path], reading: Reading, name: str | None) -> Found | None:
    """Files whose names differ in a number, each with the others a state of its own; None if they are one state."""
    if len(paths) < 2:
        return None
    wholes = _wholes(paths, name)
    several = [own for own in map(numbered, groups(list(wholes))) if len(own) > 1]
    if not several:
        return None
    listed = {whole for own in several for whole in own.values()}
    common = tuple(path for whole, files in wholes.items() if whole not in listed for path in files)
    found = Found(common, [])
    numbered_files = {
        number: tuple(path for own in several if number in own for path in wholes[own[number]])
        for number in sorted(set().union(*several))
    }
    converter, times = _times_by_number(numbered_files, found, name)
    if converter is None:
        return None
    by_number = {number: numbered_files[number] for number in times}
    # an incomplete file has no time yet
    known = [own[-1] for own in times.values() if own]
    have_times = len(set(known)) == len(known) > 1
    # files of one pattern: others differ by their kinds
    alike = [own[0] for own in by_number.values()]
    if not have_times and len(alike) > 1 and _are_joined(converter, wholes, alike):
        return None
    steps = _steps_by_number(by_number, times)
    told = [step.time for _, step in steps]
    if _is_one_time(told):
        steps = [(number, replace(step, time=number)) for number, step in steps]
        found.remarks.append(_one_time(told))
    return _with_times(found, steps, reading)


def _times_by_number(
    files: Mapping[float, tuple[Path, ...]], found: Found, name: str | None
) -> tuple[type[Converter] | None, dict[float, Sequence[float]]]:
    """The converter of files by number, and the times of each number; none if no files can be read.

    Unreadable files are skipped with a remark.
    """
    converter: type[Converter] | None = None
    times: dict[float, Sequence[float]] = {}
    for number, own in files.items():
        every = (*found.common, *own)
        try:
            if converter is None or not converter.opens(every):
                converter = _converter(every, name)
            times[number] = converter.times(every)
        except ElvisError as error:
            found.remarks.append(f"{error}: the step is skipped")
    return (converter if times else None), times


def _wholes(paths: Sequence[Path], name: str | None) -> dict[Path, list[Path]]:
    """Files by the name of the state that they are parts of, by marks of the formats of installed converters.

    Native files have no such marks, and no converter is loaded for them.
    """
    foreign = {path for path in paths if name is not None or not is_native(path)}
    candidates = installed_converters() if foreign else []
    kinds = [each.converter for each in candidates if each.converter and name in (None, each.name)]
    found: dict[Path, list[Path]] = {}
    for path in paths:
        marks = (kind.whole(path) for kind in kinds) if path in foreign else ()
        whole = next((other for other in marks if other != path), path)
        found.setdefault(whole, []).append(path)
    return found


def _are_joined(converter: type[Converter], wholes: Mapping[Path, Sequence[Path]], files: Sequence[Path]) -> bool:
    """Whether files that differ in a number form one state; False if their names mark the parts of each."""
    is_marked = any(len(parts) > 1 for parts in wholes.values())
    return not is_marked and converter.joins(files)


def _steps_by_number(
    by_number: Mapping[float, tuple[Path, ...]], times: Mapping[float, Sequence[float]]
) -> list[tuple[float, Step]]:
    """The steps in files by number: one for each of several times in a file."""
    steps = []
    for number, files in by_number.items():
        own = times[number]
        if len(own) > 1:
            steps += [(number, Step(time, files, i)) for i, time in enumerate(own) if isfinite(time)]
        else:
            steps.append((number, Step(own[0] if own else None, files)))
    return steps


def _is_one_time(told: Sequence[float | None]) -> bool:
    """Whether several files have the same time."""
    return len(told) > 1 and None not in told and len(set(told)) == 1


def _one_time(told: Sequence[float | None]) -> str:
    """Remark if several files have the same time."""
    return f"all files have the time {told[0]:.10g}: the numbers in their names are used instead"


def _with_times(found: Found, numbered_steps: Sequence[tuple[float, Step]], reading: Reading) -> Found:
    """Steps without times get the times of a complete reading, else their numbers."""
    has_times = any(step.time is not None for _, step in numbered_steps)
    steps: list[Step] = []
    for number, step in numbered_steps:
        time = step.time
        if time is None and (has_times or not steps):
            told = reading.ranks.exchange(_time_of((*found.common, *step.files), reading), f"time of {step.name}")[0]
            if isinstance(told, str):
                found.remarks.append(f"{told}: the step is skipped")
                continue
            time = told
            has_times = has_times or time is not None
        fault = _fault_of(time) if has_times else ""
        if fault:
            found.remarks.append(f"{step.name}: {fault}: the step is skipped")
        else:
            steps.append(replace(step, time=time if has_times else number))
    if not has_times:
        found.remarks.append(NO_TIMES)
    return replace(found, steps=steps)


def _time_of(paths: Sequence[Path], reading: Reading) -> float | str | None:
    """The time of a state that is read completely, or the reason why it can't be; only the first rank reads it."""
    from elvis.plugins.data.data import state_of

    if reading.ranks.rank:
        return None
    try:
        return state_of(paths, replace(reading, ranks=ALONE)).time
    except ElvisError as error:
        return str(error)


def _in_order(found: Found) -> Found | None:
    """The series with ascending times: repeated and earlier times are skipped; None if time stands still.

    A single step is a series if others are damaged, or incomplete.
    """
    steps = [step for step in found.steps if step.time is not None]
    least = 1 if found.is_native and len(steps) == 1 else 2
    if len({step.time for step in steps}) < least:
        return None
    if len(groups([path for step in steps for path in step.files])) > 1 or not steps[0].files:
        steps.sort(key=lambda step: step.time or 0.0)
    kept: list[Step] = []
    remarks = list(found.remarks)
    for step in steps:
        last = kept[-1].time if kept else None
        if last is None or step.time is None or step.time > last:
            kept.append(step)
        elif step.time == last:
            remarks.append(f"{step.name}: its time, {step.time:.10g}, is that of {kept[-1].name}: it is skipped")
        else:
            told = f"its time, {step.time:.10g}, is before that of {kept[-1].name}, {last:.10g}"
            remarks.append(f"{step.name}: {told}: it is skipped")
    return replace(found, steps=kept, remarks=[*remarks, *_gaps(kept)])


def _gaps(steps: Sequence[Step]) -> list[str]:
    """Sentences on missing numbers between numbers of files that are otherwise evenly numbered."""
    paths = [step.files[0] for step in steps if step.files]
    numbers = list(numbered(paths)) if len(paths) > 2 and len(groups(paths)) == 1 else []
    spaces = [after - before for before, after in pairwise(numbers)]
    least = min(spaces, default=0.0)
    if spaces.count(least) * 2 <= len(spaces):
        return []
    wide = [i for i, space in enumerate(spaces) if space > 1.5 * least]
    return [f"steps are missing between {paths[i].name} and {paths[i + 1].name}" for i in wide]
