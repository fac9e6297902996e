"""A series: the steps of a solution in time, one dataset at each, and those between them.

One mesh is read once, and a few steps at most are in memory at any time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from pathlib import Path
from sys import maxsize
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.ranks import ALONE, agreed
from elvis.core.data.dataset import Dataset
from elvis.core.data.moments import BETWEEN, Instant, Moment, checked_step
from elvis.core.mapping.geometry import share
from elvis.core.portions.portion import Portion
from elvis.core.quantities.needed import lack_of, needed_fields
from elvis.formats.reading import read as read_native
from elvis.formats.reading import with_fields
from elvis.plugins.command.same_files import check_same_files
from elvis.plugins.data.others import Others
from elvis.plugins.series.between import (
    NEAR,
    STEPS_OF,
    combined,
    is_finite,
    is_one_mesh,
    on_mesh_of,
    polynomial_name,
    weights,
    window,
)
from elvis.plugins.series.finding import Found, Step, find_steps
from elvis.plugins.series.parts import StepsByPart, reading_of, with_common_names
from elvis.plugins.series.rates import StepRates
from elvis.plugins.series.step_names import expanded

if TYPE_CHECKING:
    from elvis.plugins.data.data import Reading

#: minimum number of steps kept in memory: one and the next; more if the interpolation needs them
_KEPT = 2
#: unreadable steps after which a series without a readable one is given up
_MOST_DAMAGED = 100
#: no step and no time is requested
LAST = Moment()


def open_series(
    *paths: str | Path,
    reader: Mapping[str, str] | Sequence[str] = (),
    cache: bool = True,
    reference: Mapping[str, float] | None = None,
) -> Series:
    """The series in files of any format, in any order: a mesh and the steps, an index of them, a file of many steps.

    Names may contain *.  ``series[3]`` is a dataset, ``series.at(0.25)`` one between steps.

    reader, cache, reference  as of `read`

    Raises FormatError if there are fewer than two steps, or the files can't be read.

    >>> series = elvis.open_series("wave.xml", "wave_*.chk")
    >>> len(series)
    9
    >>> series.at(0.1)
    <Dataset 2D: 16 quadrilaterals; fields u of order 7; time 0.1>
    """
    from elvis.plugins.data.data import Reading, check_readable, pairs

    options = dict(reader) if isinstance(reader, Mapping) else pairs(reader)
    files, reading = [Path(path) for path in paths], Reading(None, options, cache, reference=reference or {})
    found = series_in(files, reading)
    if found is None:
        check_readable(files, reading)
        named = ", ".join(path.name for path in expanded(files))
        raise FormatError(f"expected at least two steps of a series, found one state in {named}")
    return found


def series_in(paths: Sequence[Path], reading: Reading) -> Series | None:
    """The series that files are, whatever moment of it ``reading`` asks for; None where they are a single state."""
    return series_of(expanded(paths), replace(reading, moment=Moment(wants_series=True)))


def series_of(paths: Sequence[Path], reading: Reading) -> Series | None:
    """The series that files are, None where they are a single state: that may depend on the requested moment."""
    found = find_steps(paths, reading)
    return None if found is None else Series(found, reading)


class Series(Sequence[Dataset]):
    """Steps in ascending time.

    remarks    on skipped steps
    faults     sentences on steps that were read: damaged ones, incomplete ones, and values that are not finite
    is_native  whether steps are field files of the native format, on a mesh in another file
    """

    def __init__(self, found: Found, reading: Reading) -> None:
        self.steps: tuple[Step, ...] = tuple(found.steps)
        self.common, self.remarks = found.common, list(found.remarks)
        # facts of steps concern all their fields
        reading = replace(reading, is_of_map=False)
        files = [path for step in self.steps for path in step.files]
        if not reading.is_plain:
            # each rank has all data, see `elvis.plugins.data.data.open_part`
            check_same_files([*found.common, *files], reading.ranks)
            reading = replace(reading, ranks=ALONE)
        self.is_native, self._reading = found.is_native, reading
        self._others = Others(reading, [*self.common, *files])
        self._parts = StepsByPart(found, reading) if reading.ranks.size > 1 else None
        self._first: Dataset | None = None
        self._warnings: tuple[str, ...] | None = None
        self._kept: OrderedDict[int, Dataset] = OrderedDict()
        self._room = _KEPT
        self._passed_over: dict[int, str] = {}
        self._infinite: set[int] = set()
        self._default_field = ""
        self._is_known_to_have_all = False
        self._lacking: int | None = None
        self.faults: list[str] = []

    @property
    def times(self) -> Floats:
        """(n,) of the steps, ascending."""
        return np.array([step.time for step in self.steps], np.float64)

    def __len__(self) -> int:
        return len(self.steps)

    def __repr__(self) -> str:
        return f"<Series of {len(self)} steps from time {self.times[0]:g} to {self.times[-1]:g}>"

    def __iter__(self) -> Iterator[Dataset]:
        return (self[number] for number in range(len(self)))

    def __getitem__(self, number: Any) -> Any:
        """The dataset of a step, from the end where the number is negative; FormatError where it can't be read."""
        count = len(self)
        if isinstance(number, slice):
            return [self[i] for i in range(*number.indices(count))]
        if not -count <= number < count:
            raise IndexError(f"expected a step from 0 to {count - 1}, found {number}")
        return self._beside(self._load(number % count))

    @property
    def infinite(self) -> Set[int]:
        """The numbers of the steps that were read and hold values that are not finite."""
        return self._infinite

    @property
    def told(self) -> tuple[str, ...]:
        """The remarks, and the faults of steps that were read."""
        return *self.remarks, *self.faults

    def facts(self) -> dict[str, Any]:
        """Steps with their times and files, and the remarks, as plain data."""
        steps = [
            {"step": number, "time": step.time, "files": [path.name for path in step.files]}
            for number, step in enumerate(self.steps)
        ]
        return {"steps": steps, "remarks": self.remarks}

    def at(self, time: float, between: str = BETWEEN[0]) -> Dataset:
        """The dataset at a time: of a step, or with coefficients interpolated ``linear``, ``cubic`` or ``nearest``.

        Steps that can't be read are skipped.  A mesh that moves or changes is not interpolated: then the nearest step
        is
        used.  The remarks of the dataset report all this.  Raises ElvisError for times before the first or after the
               last
        step.
        """
        return self.at_moment(Moment(time=time, between=between))

    def part_at(self, moment: Moment = LAST) -> Portion | Dataset:
        """A rank's part of the data of a moment, or all of them if they can't be divided; every rank must call this."""
        dataset = self.at_moment(moment)
        if self._parts is None:
            return dataset
        number = 0 if dataset.instant is None else dataset.instant.steps[0]
        return self._others.beside_part(self._parts.portion(self.steps[number], dataset))

    def at_moment(self, moment: Moment = LAST) -> Dataset:
        """The dataset of a moment, by default of the last step that can be read."""
        if moment.step is not None:
            number = checked_step(moment.step, len(self))
            return self._at_step(number, [], moment.between)
        if moment.time is None:
            (last,), notes = self._readable(float(self.times[-1]), 1)
            found = self._at_step(last, notes, moment.between)
            if len(self) == 1:
                return found
            place = f"step {last} of 0 to {len(self) - 1}, time {self.times[last]:.10g}"
            words = f"{place}: --step and --time choose others"
            return replace(found, remarks=(*found.remarks, words))
        return self._between(moment.time, moment.between)

    def _between(self, time: float, between: str) -> Dataset:
        self._room = max(_KEPT, STEPS_OF[between])
        self.check_within(time)
        numbers, notes = self._readable(time, STEPS_OF[between])
        self.check_within(time)
        nearest = min(numbers, key=lambda number: abs(self.times[number] - time))
        if abs(self.times[nearest] - time) <= self._slack:
            return self._at_step(nearest, notes, between)
        steps = [self._load(number) for number in numbers]
        if len(steps) > 1 and not self.all_agree(all(is_one_mesh(steps[0], step) for step in steps[1:])):
            notes.append("the mesh changes between steps, which are not interpolated")
            steps = [self._load(nearest)]
        if len(steps) == 1:
            words = f"time {time:.10g}: step {nearest}, time {self.times[nearest]:.10g}, is the nearest"
            return self._at_step(nearest, [*notes, words], between, "nearest")
        notes += [
            f"step {number} contains values that are not finite, and so do the interpolated values next to it"
            for number in numbers
            if number in self._infinite
        ]
        found, lacking = combined(steps, weights(self.times[numbers], time), self.all_agree)
        first, last = numbers[0], numbers[-1]
        places = f"steps {first} to {last}, times {self.times[first]:.10g} to {self.times[last]:.10g}"
        name = polynomial_name(between, len(steps))
        notes.append(f"time {time:.10g}: coefficients are interpolated in time ({name}) between {places}")
        if lacking:
            notes.append(f"fields that differ between steps are skipped: {', '.join(lacking)}")
        metadata = {**found.metadata, **({"Time": repr(time)} if "Time" in found.metadata else {})}
        rates = StepRates(self, time, between)
        instant = Instant(time, (first, last), name)
        return self._told(replace(found, time=time, metadata=metadata, rates=rates, instant=instant), notes)

    def _at_step(self, number: int, notes: Sequence[str], between: str, stands_for: str | None = None) -> Dataset:
        """The dataset of a step, with derivatives in time.

        stands_for  "nearest" where another time was requested
        """
        time = float(self.times[number])
        instant = Instant(time, (number, number), stands_for) if len(self) > 1 else None
        return self._told(replace(self._load(number), rates=StepRates(self, time, between), instant=instant), notes)

    def last_readable(self) -> int:
        """The number of the last step that can be read."""
        return self.readable_around(float(self.times[-1]), 1)[0]

    def narrowed(self, *texts: str) -> Series:
        """The same steps; if they are native, only the fields that quantities need are read."""
        found = Found(self.common, list(self.steps), self.is_native, list(self.remarks))
        narrow = Series(found, replace(self._reading, quantities=texts))
        narrow.take_mesh_of(self)
        return narrow

    def ask_for(self, *texts: str) -> None:
        """Pass over steps, from now on, that lack quantities which others have; of native ones read no other fields."""
        self._reading = replace(self._reading, quantities=texts)
        if self._parts is not None:
            self._parts.reading = self._reading

    def take_mesh_of(self, other: Series) -> None:
        """Use the mesh of a series on the same mesh files, instead of reading it again."""
        self._first, self._parts = other._first, other._parts and other._parts.on_the_same_mesh(self._reading)

    def all_agree(self, is_so: bool) -> bool:
        """Whether something is so of the parts of all ranks."""
        return all(self._reading.ranks.exchange(is_so, f"steps from {self.steps[0].name} on"))

    def steps_around(self, time: float, between: str) -> tuple[list[int], list[Dataset]]:
        """The numbers of the steps that the interpolation at a time rests on, and their datasets."""
        self._room = max(_KEPT, STEPS_OF[between])
        numbers = self.readable_around(time, STEPS_OF[between])
        return numbers, [self[number] for number in numbers]

    def readable_around(self, time: float, count: int) -> list[int]:
        """The numbers of up to ``count`` readable steps around a time."""
        return self._readable(time, count)[0]

    def check_within(self, time: float) -> None:
        """ElvisError for a time before the first or after the last step that is not known to be skipped."""
        low, high = self.times[self._left[0]], self.times[self._left[-1]]
        if not low - self._slack <= time <= high + self._slack:
            reasons = f" ({'; '.join(self.told[:2])})" if self.told else ""
            raise ElvisError(f"expected a time from {low:.10g} to {high:.10g}, found {time:.10g}{reasons}")

    @property
    def _slack(self) -> float:
        """Tolerance within which a time equals a step's time."""
        return NEAR * float(np.abs(self.times).max())

    @property
    def _left(self) -> list[int]:
        """The steps that are not known to be skipped; FormatError where there are none."""
        self.check_readable()
        return [number for number in range(len(self)) if number not in self._passed_over]

    def _readable(self, time: float, count: int) -> tuple[list[int], list[str]]:
        """The steps around a time that can be read and are complete, and messages about the others."""
        notes: list[str] = []
        while True:
            left = self._left
            around = [left[i] for i in window(self.times[left], time, count)]
            faults = [fault for number in around if (fault := self.fault(number) or self._lack(number))]
            if not faults:
                return around, notes
            notes += faults

    def fault(self, number: int) -> str:
        """Message about a step that can't be read, which is skipped from now on; empty for one that can."""
        if number in self._passed_over:
            return f"{self.steps[number].name} is skipped"
        try:
            self._load(number)
        except FormatError as error:
            return self._pass_over(number, "can't be read and is skipped", str(error))
        return ""

    def _lack(self, number: int) -> str:
        """Message about a step without requested data that others have, which is skipped from now on.

        Empty for all others: data that neither the first nor the last step has are assumed to be requested by mistake.
        """
        lack = self._lack_of(number)
        self._is_known_to_have_all = self._is_known_to_have_all or not lack
        if not lack:
            return ""
        ends = {0, len(self) - 1} - {number, *self._passed_over}
        if not self._is_known_to_have_all and all(self.fault(end) or self._lack_of(end) for end in sorted(ends)):
            return ""
        self._is_known_to_have_all = True
        return self._pass_over(number, "is skipped", lack)

    def _lack_of(self, number: int) -> str:
        """Message about requested quantities that a readable step lacks; empty if it lacks none."""
        dataset = self._beside(self._load(number))
        self._default_field = self._default_field or next(iter(dataset), "")
        lacks = (lack_of(dataset, text or self._default_field) for text in self._reading.quantities)
        return next(filter(None, lacks), "")

    def _pass_over(self, number: int, what: str, reason: str) -> str:
        """Skip a step from now on; returns the sentence about it."""
        self._passed_over[number] = reason
        sentence = f"{self.steps[number].name} {what}: {reason}"
        self.faults.append(sentence)
        return sentence

    def readable(self) -> Iterator[int]:
        """The numbers of the steps that can be read and are complete, in order.

        Each is read as it comes, and then available.  Raises FormatError at the end if there was none.
        """
        for number in range(len(self)):
            if not (self.fault(number) or self._lack(number)):
                yield number
            self.check_readable()

    def check_readable(self) -> None:
        """FormatError if all steps are known to be skipped, or many of them and none was read so far."""
        skipped = len(self._passed_over)
        if skipped == len(self) or (skipped >= _MOST_DAMAGED and not self._kept):
            number = min(self._passed_over)
            found = f"none from {self.steps[number].name} on"
            if skipped < len(self):
                found = f"none among {skipped} of {len(self)} steps"
            raise FormatError(f"expected a step that can be read, found {found}: {self._passed_over[number]}")

    def _told(self, dataset: Dataset, notes: Sequence[str]) -> Dataset:
        told = replace(dataset, remarks=tuple(dict.fromkeys((*dataset.remarks, *self.remarks, *notes))))
        return self._beside(told)

    def _beside(self, dataset: Dataset) -> Dataset:
        """A step in which expressions may name other datasets."""
        return self._others.beside(dataset)

    def _load(self, number: int) -> Dataset:
        """The dataset of a step, on the mesh of the first that was read where it is the same."""
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        dataset = agreed(
            self._reading.ranks, partial(self._read, self.steps[number]), f"step {self.steps[number].name}"
        )
        if self.is_native:
            dataset = self._warned(dataset)
        if not self.all_agree(is_finite(dataset)):
            dataset = self._told_infinite(number, dataset)
        if self._first is None:
            # only the mesh and its map, as steps are retained elsewhere
            self._first = replace(dataset, fields=tuple(dataset.field(name) for name in dataset.map_names))
        dataset = on_mesh_of(self._first, dataset)
        share(self._first.mesh)
        self._kept[number] = dataset
        while len(self._kept) > self._room:
            forgotten, _ = self._kept.popitem(last=False)
            if self._parts is not None:
                self._parts.forget(self.steps[forgotten])
        return dataset

    def _warned(self, dataset: Dataset) -> Dataset:
        """A step with the warnings of the mesh, found with the first step, whose fields may hold the map."""
        from elvis.plugins.data.data import with_warnings

        if self._warnings is None:
            self._warnings = with_warnings(replace(dataset, remarks=()), self._reading.ranks).remarks
        return replace(dataset, remarks=tuple(dict.fromkeys((*dataset.remarks, *self._warnings))))

    def _told_infinite(self, number: int, dataset: Dataset) -> Dataset:
        """A dataset whose remarks, like the faults of the series, report that not all of its values are finite."""
        sentence = f"step {number}, {self.steps[number].name}, contains values that are not finite"
        if number not in self._infinite:
            self._infinite.add(number)
            self.faults.append(sentence)
        return replace(dataset, remarks=(*dataset.remarks, sentence))

    def _read(self, step: Step) -> Dataset:
        found, lacking = self._whole(step) if self._parts is None else self._parts.read(step)
        if not self.is_native:
            found = replace(found, time=step.time)
            return with_common_names(found, step) if self._parts is None else found
        found = self._checked(step, found, lacking)
        return found if found.time is not None else replace(found, time=step.time)

    def _whole(self, step: Step) -> tuple[Dataset, int]:
        """A step, and how many elements of its fields the mesh lacks."""
        from elvis.plugins.data.data import state_of

        if not self.is_native:
            return state_of((*self.common, *step.files), reading_of(step, self._reading)), 0
        self._first = self._first or read_native(*self.common)
        return with_fields(self._first, *step.files, choose=self._reading.choice())

    def _checked(self, step: Step, dataset: Dataset, lacking: int) -> Dataset:
        """A step with fields on elements that the mesh lacks; FormatError if other steps have no such elements.

        A mesh may be a part of the mesh of all steps.  If it lacks more elements of one step, that step has another
        mesh.
        """
        known = self._lacking
        if known is None:
            known = self._lacking_of_another(step) if lacking else 0
        if lacking > known:
            words = f"{lacking} elements that the mesh lacks, which other steps don't have"
            raise FormatError(f"expected fields on the mesh of the series, found {words}", file=step.files[0])
        self._lacking = lacking
        words = f"{step.name}: its fields are on {lacking} elements that are not in the mesh; they are ignored"
        return replace(dataset, remarks=(*dataset.remarks, words)) if lacking else dataset

    def _lacking_of_another(self, step: Step) -> int:
        """How many elements of another step the mesh lacks; a vast number where there is none that can be read."""
        other = self.steps[0] if step is not self.steps[0] else self.steps[-1]
        if other is step:
            return maxsize
        try:
            if self._parts is not None:
                return self._parts.lacking(other)
            assert self._first is not None  # the mesh is there before a step is checked
            return with_fields(self._first, *other.files, choose=partial(needed_fields, texts=("",)))[1]
        except FormatError:
            return maxsize
