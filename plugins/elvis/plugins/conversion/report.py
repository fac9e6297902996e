"""The report of a conversion: exact results, errors, and remarks."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from elvis.core.base.relative import error_limit, scale
from elvis.core.base.rounded_up import rounded_up
from elvis.core.data import conversion_errors

#: an error below this share of the range, or of the largest magnitude, is rounding
_OF_RANGE, _OF_MAGNITUDE = 1e-11, 1e-13

#: keys of the metadata for the origin of converted data and the errors
CONVERTED = "ConvertedFrom"
REPORT = conversion_errors.REPORT
#: what may be the matter with elements
LISTED = ("inverted", "degenerate", "detached", "not finite")
#: number of ids in a sentence
_MANY = 8


@dataclass(frozen=True)
class Measure:
    """The error of the coordinates or of a field.

    order       polynomial degree, of the coordinates or of the field as converted (the highest, where it varies)
    max, l2     largest difference, and root of the integrated squared difference, to the source's own values: at the
                same reference coordinates, and for projected maps also at the same positions in space
    range       largest minus smallest value of the field, or the diagonal of the box around the mesh
    magnitude   the largest absolute value
    precision   relative rounding of the source's numbers
    relative    ``max`` as a share of ``range``, or of ``magnitude`` where the range is rounding
    element     id of the element in the file where the difference is largest, -1 where there is none
    is_exact    whether the difference is rounding
    is_continuous  whether elements that share a face hold the same values there; None for the coordinates
    slope       the largest derivative of the difference in space, infinite where it is not known
    """

    name: str
    order: int
    max: float
    l2: float
    range: float
    magnitude: float
    precision: float
    element: int
    is_exact: bool
    is_continuous: bool | None = None
    slope: float = 0.0

    @property
    def relative(self) -> float:
        """The largest difference as a share of the range, or of the magnitude where the field is constant."""
        return self.max / scale(self.range, self.magnitude, self.precision)

    def is_within(self, bound: float) -> bool:
        """Whether no relative error is greater than ``bound``, but for rounding of the magnitude."""
        return self.max <= error_limit(bound, self.range, self.magnitude, self.precision)

    @property
    def state(self) -> str:
        """``exact`` or ``projected``."""
        return "exact" if self.is_exact else "projected"

    def sentence(self) -> str:
        """How a field that was added holds its quantity."""
        if self.is_exact:
            return f"{self.name}: exact at order {self.order}"
        return f"{self.name}: projected at order {self.order}, off by up to {rounded_up(self.relative)} of its range"

    def facts(self) -> dict[str, Any]:
        """Facts for JSON; None for a number beyond the range of 64 bits."""
        facts = {
            "state": self.state,
            "exact": self.is_exact,
            "order": self.order,
            "max": _finite(self.max),
            "L2": _finite(self.l2),
            "relative": _finite(self.relative),
            "range": _finite(self.range),
            "element": self.element,
        }
        if not self.is_exact:
            facts["slope"] = _finite(self.slope)
        return facts if self.is_continuous is None else {**facts, "continuous": self.is_continuous}


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def is_rounding(error: float, spread: float, magnitude: float, precision: float) -> bool:
    """Whether an error is explained by rounding: of 64 bits, or of a source with numbers of less ``precision``."""
    return error <= rounding(spread, magnitude, precision)


def rounding(spread: float, magnitude: float, precision: float) -> float:
    """The largest error that counts as rounding of values with a range and a largest magnitude."""
    return max(_OF_RANGE * spread, (_OF_MAGNITUDE + 4 * precision) * magnitude)


@dataclass(frozen=True)
class Report:
    """The report of a conversion.

    converter, files  names
    elements      number of each shape in the converted mesh
    geometry      error of the map
    deviation     largest distance between the map of the mesh file by its own and the source's, as a share of the
                  element's size, and that element
    has_map       whether the map is written as fields
    fields        errors of the fields
    listed        ids of elements by fault: inverted, degenerate, ...
    notes         sentences
    warnings      sentences that every command prints
    transfer      facts of a projection onto another mesh; empty for others
    """

    converter: str
    files: tuple[str, ...]
    elements: Mapping[str, int]
    geometry: Measure
    deviation: tuple[float, int]
    has_map: bool
    fields: tuple[Measure, ...]
    listed: Mapping[str, tuple[int, ...]]
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    transfer: Mapping[str, Any] = field(default_factory=dict)

    def beyond(self, bound: float) -> list[Measure]:
        """The coordinates and fields with relative errors greater than ``bound``, the worst first."""
        found = [measure for measure in (self.geometry, *self.fields) if not measure.is_within(bound)]
        return sorted(found, key=lambda measure: -measure.relative)

    def facts(self) -> dict[str, Any]:
        """For ``--json``."""
        return {
            "converter": self.converter,
            "files": list(self.files),
            "elements": dict(self.elements),
            "geometry": {
                **self.geometry.facts(),
                "map": "fields" if self.has_map else "curves",
                "deviation": {"share_of_element": _finite(self.deviation[0]), "element": self.deviation[1]},
            },
            "fields": {measure.name: measure.facts() for measure in self.fields},
            **{name: list(ids) for name, ids in self.listed.items()},
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            **self.transfer,
        }

    def remarks(self) -> tuple[str, ...]:
        """Remarks that every command prints: `remark`, and the warnings."""
        files = named_files(self.files)
        return (self.remark(), *(f"{files}: {warning}" for warning in self.warnings))

    def remark(self) -> str:
        """One sentence on a conversion in memory: how large the errors are, and where to read more."""
        worst = max((self.geometry, *self.fields), key=lambda measure: measure.relative)
        lost = [measure for measure in (self.geometry, *self.fields) if not measure.is_exact]
        if lost:
            told = " and ".join(f"{rounded_up(measure.relative)} in {measure.name}" for measure in _some_of(lost))
            found = f"with errors of up to {told}, relative to its range"
        else:
            found = f"exact to the rounding of its numbers (up to {rounded_up(worst.relative, 1)} of a range)"
        more = "; see elvis info" if len(self.sentences()) > len(self.warnings) else ""
        return f"{named_files(self.files)}: converted in memory, {found}{more}"

    def metadata(self) -> dict[str, str]:
        """Keys and texts for the dataset."""
        short = {name: f"{len(ids)}: {_some(ids)}" for name, ids in self.listed.items() if ids}
        facts = {**self.facts(), **dict.fromkeys(self.listed, None), **short}
        kept = {name: value for name, value in facts.items() if value not in (None, [], {})}
        return {CONVERTED: self.converter, REPORT: json.dumps(kept, allow_nan=False)}

    def rows(self) -> list[tuple[str, ...]]:
        """A row for the coordinates and one for each field: the cells of `HEADERS`."""
        return [_row(self.geometry), *(_row(measure) for measure in self.fields)]

    def sentences(self) -> list[str]:
        """Sentences with information that the table doesn't contain."""
        said = []
        if self.has_map:
            share, element = self.deviation
            said.append(
                "the map is written as fields: without them, the curves of the mesh file are off by up to "
                f"{rounded_up(share)} of an element's size, in element {element}"
            )
        if self.fields and not self.geometry.is_exact:
            said.append("the map is projected: errors of fields are measured at points in space and include its error")
        said += [f"{len(ids)} {name} elements, unchanged: {_some(ids)}" for name, ids in self.listed.items() if ids]
        return [*said, *self.notes, *self.warnings]


@dataclass(frozen=True)
class RecordedReport:
    """The report of a conversion in the metadata of a dataset.

    facts      as for ``--json``
    heading    origin of the data
    rows       one for the coordinates and one for each field: the cells of `HEADERS`
    sentences  information that the table doesn't contain
    """

    facts: Mapping[str, Any]
    heading: str
    rows: list[tuple[str, ...]]
    sentences: list[str]

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> RecordedReport | None:
        """The report in the metadata of a dataset, which anybody may have written; None where none can be read."""
        try:
            facts = json.loads(metadata[REPORT])
            rows = [_row_of("coordinates", facts["geometry"])]
            rows += [_row_of(name, own) for name, own in facts.get("fields", {}).items()]
            files = named_files(list(map(str, facts["files"])))
            heading = f"converted from {files} ({facts['converter']})" if files else f"projected: {facts['converter']}"
            listed = [f"{name} elements, unchanged: {facts[name]}" for name in LISTED if name in facts]
            notes = [str(note) for name in ("notes", "warnings") for note in facts.get(name, [])]
        except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError):
            return None
        map_note = ["the map is written as fields"] if facts["geometry"].get("map") == "fields" else []
        return cls(facts, heading, rows, [*map_note, *listed, *notes])


def _row_of(name: str, facts: Mapping[str, Any]) -> tuple[str, ...]:
    """The cells of `HEADERS` for the coordinates or a field, from the facts of their measure."""
    continuous = {None: "", True: "yes", False: "no"}[facts.get("continuous")]
    numbers = ("-" if facts[key] is None else f"{float(facts[key]):.3g}" for key in ("max", "relative", "L2"))
    return (name, str(int(facts["order"])), str(facts["state"]), *numbers, str(int(facts["element"])), continuous)


HEADERS = ("", "order", "state", "max error", "of the range", "L2 error", "in element", "continuous")


def _row(measure: Measure) -> tuple[str, ...]:
    continuous = {None: "", True: "yes", False: "no"}[measure.is_continuous]
    numbers = (f"{measure.max:.3g}", f"{measure.relative:.3g}", f"{measure.l2:.3g}")
    return (measure.name, str(measure.order), measure.state, *numbers, str(measure.element), continuous)


def _some_of(lost: Sequence[Measure]) -> Sequence[Measure]:
    """The coordinates where they are among these, and the worst of the fields."""
    fields = sorted((each for each in lost if each.is_continuous is not None), key=lambda each: -each.relative)
    return [*(each for each in lost if each.is_continuous is None), *fields[:1]]


def named_files(names: Sequence[str]) -> str:
    """Names of files in a message: all of a few, else the first ones and how many there are."""
    return ", ".join(names[:_MANY]) + (f", ... ({len(names)} files)" if len(names) > _MANY else "")


def _some(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids[:_MANY])) + (", ..." if len(ids) > _MANY else "")
