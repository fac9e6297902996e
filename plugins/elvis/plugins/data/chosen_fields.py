"""Which fields of a dataset are written, which quantities become fields, and under which names."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.conversion_errors import REPORT
from elvis.core.data.dataset import MAP_FIELDS, Dataset, ExpansionRule, Field
from elvis.plugins.conversion.report import Measure, RecordedReport, Report
from elvis.plugins.data.added_quantities import TOLERANCE, add_quantities, recorded_facts


@dataclass(frozen=True)
class ChosenFields:
    """Changes to the fields of a dataset.

    added      quantities that become fields, as NAME=EXPRESSION
    renames    new names of fields by old ones
    wanted     names of the fields that remain, besides added ones; None for all
    order, tolerance  of added quantities, see `with_quantity`
    """

    added: tuple[str, ...] = ()
    renames: tuple[str, ...] = ()
    wanted: tuple[str, ...] | None = None
    order: int | None = None
    tolerance: float | None = None

    def __bool__(self) -> bool:
        return bool(self.added or self.renames)

    def of(self, dataset: Dataset) -> tuple[Dataset, tuple[Measure, ...]]:
        """The dataset with these fields, and the errors of added ones."""
        renames = parse_renames(self.renames)
        measures: tuple[Measure, ...] = ()
        if self.added:
            tolerance = TOLERANCE if self.tolerance is None else self.tolerance
            found = add_quantities(dataset, self.added, self.order, tolerance)
            dataset, measures = found.dataset, found.measures
        wanted = None if self.wanted is None else (*self.wanted, *(own.name for own in measures))
        named = tuple(replace(own, name=renames.get(own.name, own.name)) for own in measures)
        return with_fields_named(dataset, wanted, renames), named

    def reported(self, report: Report, measures: Sequence[Measure]) -> Report:
        """The report of a conversion for the remaining fields, under their new names, and for added ones."""
        renames = parse_renames(self.renames)
        own = [each for each in report.fields if self.wanted is None or each.name in self.wanted]
        named = [replace(each, name=renames.get(each.name, each.name)) for each in own]
        return replace(report, fields=(*named, *measures))


def orders_that_are_cut(dataset: Dataset) -> list[str]:
    """Messages about fields of higher order than the expansions state, which name other fields (format notes 3)."""
    rules = dataset.expansions
    if not rules or not all(rule.fields for rule in rules):
        return []
    known = {name for rule in rules for name in rule.fields}
    lowest = min(min(rule.modes) for rule in rules)
    cut = [own.name for own in dataset.solution if own.name not in known and _modes(own) > lowest]
    if not cut:
        return []
    return [
        f"the EXPANSIONS of the mesh file, with NUMMODES={lowest}, don't name {', '.join(cut)}: the tools of Nektar++ "
        "truncate such fields to that order; write a mesh file that names them with -o NAME.xml"
    ]


def _modes(field: Field) -> int:
    return max(max(block.expansion.modes) for block in field.blocks)


def parse_renames(texts: Sequence[str]) -> dict[str, str]:
    """``OLD=NEW`` texts as new names by old ones; ElvisError for others."""
    found = dict[str, str]()
    for text in texts:
        old, _, new = (part.strip() for part in text.partition("="))
        if not old or not new or old in found:
            raise ElvisError(f"--rename: expected OLD=NEW, each field once, found {text!r}")
        found[old] = new
    return found


def with_fields_named(dataset: Dataset, wanted: Sequence[str] | None, renames: Mapping[str, str]) -> Dataset:
    """The dataset with some of its fields, some of which are renamed.

    wanted   names of the fields that remain; None for all
    renames  new names by old ones

    ElvisError for an unknown field, and for a name that two fields would have.
    """
    known = [field.name for field in dataset.solution]
    for name in (*(wanted or ()), *renames):
        if name not in known:
            raise ElvisError(f"there is no field {name!r}{perhaps(name, known)}; the fields are {', '.join(known)}")
    kept = [own for own in dataset.fields if wanted is None or own.name in wanted or own.name in dataset.map_names]
    names = [renames.get(own.name, own.name) for own in kept]
    doubled = [name for name in names if names.count(name) > 1 or (name in MAP_FIELDS and name in renames.values())]
    if doubled:
        raise ElvisError(f"--rename: expected names that no other field has, found {doubled[0]!r}")
    fields = tuple(replace(own, name=name) for own, name in zip(kept, names, strict=True))
    rules = tuple(_rule_of(own, renames) for own in dataset.expansions)
    return replace(dataset, fields=fields, expansions=rules, metadata=_renamed(dataset.metadata, renames))


def _rule_of(rule: ExpansionRule, renames: Mapping[str, str]) -> ExpansionRule:
    return replace(rule, fields=tuple(renames.get(name, name) for name in rule.fields))


def _renamed(metadata: Mapping[str, str], renames: Mapping[str, str]) -> Mapping[str, str]:
    """Metadata whose errors go by the new names of fields."""
    if not renames or RecordedReport.of(metadata) is None:
        return metadata
    facts = recorded_facts(metadata)
    facts["fields"] = {renames.get(name, name): own for name, own in facts["fields"].items()}
    return {**metadata, REPORT: json.dumps(facts, allow_nan=False)}
