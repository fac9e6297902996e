"""The EXPANSIONS section: how a solver would discretise the composites (format notes 3)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from elvis.formats.dataset import ExpansionRule
from elvis.formats.errors import FormatError
from elvis.formats.nektar.composites import composite_ids
from elvis.formats.nektar.expressions import evaluate
from elvis.formats.nektar.xml import Element, located

_PARAMETER = re.compile(r"\s*([A-Za-z_]\w*)\s*=(.*)", re.DOTALL)
_MOST_COMPOSITES = 1_000_000


def read_rules(section: Element | None, conditions: Element | None) -> tuple[ExpansionRule, ...]:
    """The rules of the section; entries that take the expansion from a field file say nothing and are skipped."""
    if section is None or section.is_empty:
        return ()
    parameters = read_parameters(conditions)
    return tuple(_rule(child, parameters) for child in section.children() if child.tag in "EH")


def read_parameters(conditions: Element | None) -> dict[str, float]:
    """PARAMETERS of the CONDITIONS; those without a constant value are left out."""
    section = conditions.find("PARAMETERS") if conditions is not None and not conditions.is_empty else None
    values: dict[str, float] = {}
    for child in section.children() if section is not None else ():
        found = _PARAMETER.fullmatch(child.text)
        if found:
            try:
                values[found[1]] = evaluate(found[2], values)
            except FormatError:
                continue
    return values


def _rule(entry: Element, parameters: Mapping[str, float]) -> ExpansionRule:
    with located(entry):
        attributes = entry.attributes
        composites = tuple(composite_ids(entry.required("COMPOSITE").encode()).expand(_MOST_COMPOSITES).tolist())
        fields = split(attributes.get("FIELDS", ""))
        if entry.tag == "H":
            kind = ",".join(attributes[f"TYPE-{axis}"] for axis in "XYZ" if f"TYPE-{axis}" in attributes)
            texts = [attributes[f"NUMMODES-{axis}"] for axis in "XYZ" if f"NUMMODES-{axis}" in attributes]
            return ExpansionRule(composites, kind, _counts(texts, parameters), fields)
        kind = attributes.get("TYPE") or ",".join(split(entry.required("BASISTYPE")))
        modes = _counts(split(entry.required("NUMMODES")), parameters)
        points = _counts(split(attributes.get("NUMPOINTS", "")), parameters)
        return ExpansionRule(composites, kind, modes, fields, points, split(attributes.get("POINTSTYPE", "")))


def split(text: str) -> tuple[str, ...]:
    """The parts of a comma-separated list, blanks stripped, none for an empty text."""
    return tuple(part.strip() for part in text.split(",")) if text.strip() else ()


def _counts(texts: tuple[str, ...] | list[str], parameters: Mapping[str, float]) -> tuple[int, ...]:
    values = [evaluate(text, parameters) for text in texts]
    for text, value in zip(texts, values, strict=True):
        if not 1 <= value <= 1e6:
            raise FormatError(f"expected a number of modes or points from 1 up, found {text!r}")
    return tuple(round(value) for value in values)
