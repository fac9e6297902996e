"""The EXPANSIONS section: how a solver would discretise the composites (format notes 3 and 9).

A program takes bases and orders from the field file only if the names of its fields are in FIELDS; otherwise it cuts
the data to NUMMODES.  The written rules are therefore the dataset's own, completed: every field, and no order below the
order of the data.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Ints, distinct, joined_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Dataset, Expansion, ExpansionRule
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.formats.nektar.composites import composite_ids
from elvis.formats.nektar.expressions import evaluate
from elvis.formats.nektar.fields_output import OutputSection
from elvis.formats.nektar.numbers import IdList, comma_list, format_ids, split
from elvis.formats.nektar.xml import Element, Writer

_PARAMETER = re.compile(r"\s*([A-Za-z_]\w*)\s*=(.*)", re.DOTALL)

#: a rule whose composites are not yet compared with the mesh
RawRule: TypeAlias = tuple[IdList, ExpansionRule]


def read_rules(section: Element | None, conditions: Element | None) -> list[RawRule]:
    """The rules of the section.

    They describe what a solver would do; the data do not depend on them.  Entries that take the expansion from a field
    file, or that need more than constants and parameters, are skipped.
    """
    if section is None or section.is_empty:
        return []
    parameters = read_parameters(conditions)
    rules: list[RawRule] = []
    for child in section.children():
        if child.tag in ("E", "H"):
            with suppress(FormatError):
                rules.append(_rule(child, parameters))
    return rules


def resolve(rules: list[RawRule], mesh: Mesh) -> tuple[ExpansionRule, ...]:
    """The rules for the composites that the mesh has; rules that apply to none of them are dropped."""
    present = np.sort(np.array([composite.id for composite in mesh.composites], np.int64))
    found = (replace(rule, composites=tuple(ids.existing(present).tolist())) for ids, rule in rules)
    return tuple(rule for rule in found if rule.composites)


def read_parameters(conditions: Element | None) -> dict[str, float]:
    """PARAMETERS of the CONDITIONS; parameters without a constant value are skipped."""
    section = conditions.find("PARAMETERS") if conditions is not None and not conditions.is_empty else None
    values: dict[str, float] = {}
    for child in section.children() if section is not None else ():
        found = _PARAMETER.fullmatch(child.text)
        if found:
            with suppress(FormatError):
                values[found[1]] = evaluate(found[2], values)
    return values


def _rule(entry: Element, parameters: Mapping[str, float]) -> RawRule:
    attributes = entry.attributes
    composites = composite_ids(entry.require("COMPOSITE").encode())
    fields = split(attributes.get("FIELDS", ""))
    if entry.tag == "H":
        kind = ",".join(attributes[f"TYPE-{axis}"] for axis in "XYZ" if f"TYPE-{axis}" in attributes)
        texts = [attributes[f"NUMMODES-{axis}"] for axis in "XYZ" if f"NUMMODES-{axis}" in attributes]
        if not texts or kind.count(",") != len(texts) - 1:
            raise entry.error("expected a type and a number of modes in each direction, found otherwise")
        return composites, ExpansionRule((), kind, _counts(texts, parameters), fields)
    kind = attributes.get("TYPE") or ",".join(split(entry.require("BASISTYPE")))
    modes = _counts(split(entry.require("NUMMODES")), parameters)
    if not kind or not modes:
        raise entry.error("expected a kind and a number of modes, found none")
    points = _counts(split(attributes.get("NUMPOINTS", "")), parameters)
    return composites, ExpansionRule((), kind, modes, fields, points, split(attributes.get("POINTSTYPE", "")))


def _counts(texts: tuple[str, ...] | list[str], parameters: Mapping[str, float]) -> tuple[int, ...]:
    """Values of expressions as whole numbers."""
    values = [evaluate(text, parameters) for text in texts]
    for text, value in zip(texts, values, strict=True):
        if not 1 <= value <= 1e6:
            raise FormatError(f"expected a number of modes or points from 1 up, found {text!r}")
    return tuple(round(value) for value in values)


#: elements whose parts of the data are looked up together
_ELEMENTS_AT_ONCE = 1 << 16
_DEFAULT_MODES, _DEFAULT_FIELDS = 4, ("u",)
_BASIS_LABELS = frozenset(basis.label for basis in Basis)
_KINDS = {Basis.GLL_LAGRANGE: "GLL_LAGRANGE", Basis.GAUSS_LAGRANGE: "GAUSS_LAGRANGE", Basis.ORTHO_A: "ORTHOGONAL"}


def completed_rules(dataset: Dataset, sections: Sequence[OutputSection]) -> tuple[ExpansionRule, ...]:
    """Rules that cover every composite of the domain, for every field, with orders not below the data's."""
    names = tuple(field.name for field in dataset.fields)
    expansions = _Expansions(dataset.mesh, sections)
    rules: list[ExpansionRule] = []
    for rule in dataset.expansions:
        fields = _completed_fields(rule, names, rules, dataset.expansions)
        if fields or not names:
            used = expansions.on(rule.composites)
            rules.append(_at_least(replace(rule, fields=fields), max((max(e.modes) for e in used), default=0)))

    # composites of the domain without a rule get one
    covered = {composite for rule in rules for composite in rule.composites}
    domain = {composite for composites in dataset.mesh.domains.values() for composite in composites}
    for composite in sorted(domain - covered):
        used = expansions.on((composite,))
        modes = max((max(expansion.modes) for expansion in used), default=_DEFAULT_MODES)
        rules.append(ExpansionRule((composite,), _kind(used), (modes,), names or _DEFAULT_FIELDS))
    return tuple(rules)


def write_rules(writer: Writer, rules: Iterable[ExpansionRule]) -> None:
    """The section EXPANSIONS."""
    with writer.element("EXPANSIONS"):
        for rule in rules:
            tag, attributes = _entry(rule)
            writer.leaf(tag, attributes)


def _entry(rule: ExpansionRule) -> tuple[str, dict[str, object]]:
    """Tag and attributes: the long form for names of bases, H for kinds by direction, else the shorthand."""
    tag, kinds = "E", rule.kind.split(",")
    attributes: dict[str, object] = {"COMPOSITE": f"C[{format_ids(np.array(rule.composites, np.int64))}]"}
    if all(kind in _BASIS_LABELS for kind in kinds):
        attributes |= {"BASISTYPE": rule.kind, "NUMMODES": comma_list(rule.modes)}
        if rule.points:
            attributes |= {"POINTSTYPE": comma_list(rule.point_types), "NUMPOINTS": comma_list(rule.points)}
    elif len(kinds) > 1:
        tag = "H"
        for axis, kind, modes in zip("XYZ", kinds, rule.modes, strict=False):
            attributes |= {f"TYPE-{axis}": kind, f"NUMMODES-{axis}": modes}
    else:
        attributes |= {"NUMMODES": comma_list(rule.modes), "TYPE": rule.kind}
    if rule.fields:
        attributes["FIELDS"] = comma_list(rule.fields)
    return tag, attributes


def _completed_fields(
    rule: ExpansionRule, names: tuple[str, ...], earlier: Sequence[ExpansionRule], rules: Sequence[ExpansionRule]
) -> tuple[str, ...]:
    """The fields of a rule, and the fields that no other rule for the same composites claims.

    Each field once per composite.
    """
    if not names:
        return rule.fields
    claimed = {n for other in rules if other is not rule and _overlap(other, rule) for n in other.fields}
    taken = {name for other in earlier if _overlap(other, rule) for name in other.fields}
    return tuple(n for n in names if n not in taken and (n in rule.fields or n not in claimed))


def _overlap(one: ExpansionRule, other: ExpansionRule) -> bool:
    return not set(one.composites).isdisjoint(other.composites)


def _at_least(rule: ExpansionRule, needed: int) -> ExpansionRule:
    """The rule with at least this many modes in every direction, and points to match."""
    modes = tuple(max(count, needed) for count in rule.modes)
    points = tuple(p + new - old for p, new, old in zip(rule.points, modes, rule.modes, strict=False))
    return replace(rule, modes=modes, points=points)


def _kind(expansions: Sequence[Expansion]) -> str:
    """The shorthand for a family of bases."""
    kinds = {_KINDS.get(expansion.bases[0], "MODIFIED") for expansion in expansions}
    if kinds == {"ORTHOGONAL"} and {e.shape for e in expansions} & {Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON}:
        return "MODIFIED"
    return next(iter(kinds)) if len(kinds) == 1 else "MODIFIED"


class _Expansions:
    """The expansions of data on the elements of composites: elements are sorted once, for all composites."""

    def __init__(self, mesh: Mesh, sections: Sequence[OutputSection]) -> None:
        self._tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
        self._composites: dict[int, list[Composite]] = {}
        for composite in mesh.composites:
            self._composites.setdefault(composite.id, []).append(composite)
        parts = [part for section in sections for part in section.parts]
        self._expansions = [part.expansion for part in parts]
        ids = joined_ints(part.element_ids for part in parts)
        numbers = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.element_ids) for part in parts])
        order = np.argsort(ids, kind="stable")
        self._ids, self._parts = ids[order], numbers[order]

    def on(self, composites: tuple[int, ...]) -> list[Expansion]:
        """The expansions on the elements of some composites."""
        chosen = [own for number in dict.fromkeys(composites) for own in self._composites.get(number, ())]
        elements = [ids for composite in chosen for tag, ids in composite.parts if tag in self._tags]
        touched: set[int] = set()
        for ids in elements:
            for some in chunks(len(ids), _ELEMENTS_AT_ONCE):
                touched.update(self._parts_with(ids[some]).tolist())
        return [self._expansions[number] for number in sorted(touched)]

    def _parts_with(self, elements: Ints) -> Ints:
        """The numbers of the parts of the data that contain some of the elements."""
        first, last = (np.searchsorted(self._ids, elements, side) for side in ("left", "right"))
        counts = last - first
        # the places from first to last of each element, one element after the other
        places = np.repeat(last - np.cumsum(counts), counts) + np.arange(int(counts.sum()))
        return distinct(self._parts[places])
