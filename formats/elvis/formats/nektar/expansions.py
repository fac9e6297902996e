"""The EXPANSIONS section: how a solver would discretise the composites (format notes 3)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from elvis.core.dataset import ExpansionRule
from elvis.core.errors import FormatError
from elvis.core.mesh import Mesh
from elvis.formats.nektar.composites import composite_ids
from elvis.formats.nektar.expressions import evaluate
from elvis.formats.nektar.idlist import IdList
from elvis.formats.nektar.xml import Element

_PARAMETER = re.compile(r"\s*([A-Za-z_]\w*)\s*=(.*)", re.DOTALL)

#: a rule whose composites are not yet compared with the mesh
RawRule: TypeAlias = tuple[IdList, ExpansionRule]


def read_rules(section: Element | None, conditions: Element | None) -> list[RawRule]:
    """The rules of the section.

    They say what a solver would do, and no data hang on them: entries that take the expansion from a field file, or
    that need more than constants and parameters, are left out.
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
    """The rules for the composites that the mesh has; those for none of them are left out."""
    present = np.sort(np.array([composite.id for composite in mesh.composites], np.int64))
    found = (replace(rule, composites=tuple(ids.existing(present).tolist())) for ids, rule in rules)
    return tuple(rule for rule in found if rule.composites)


def read_parameters(conditions: Element | None) -> dict[str, float]:
    """PARAMETERS of the CONDITIONS; those without a constant value are left out."""
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
    composites = composite_ids(entry.required("COMPOSITE").encode())
    fields = split(attributes.get("FIELDS", ""))
    if entry.tag == "H":
        kind = ",".join(attributes[f"TYPE-{axis}"] for axis in "XYZ" if f"TYPE-{axis}" in attributes)
        texts = [attributes[f"NUMMODES-{axis}"] for axis in "XYZ" if f"NUMMODES-{axis}" in attributes]
        if not texts or kind.count(",") != len(texts) - 1:
            raise entry.error("expected a type and a number of modes in each direction, found otherwise")
        return composites, ExpansionRule((), kind, _counts(texts, parameters), fields)
    kind = attributes.get("TYPE") or ",".join(split(entry.required("BASISTYPE")))
    modes = _counts(split(entry.required("NUMMODES")), parameters)
    if not kind or not modes:
        raise entry.error("expected a kind and a number of modes, found none")
    points = _counts(split(attributes.get("NUMPOINTS", "")), parameters)
    return composites, ExpansionRule((), kind, modes, fields, points, split(attributes.get("POINTSTYPE", "")))


def split(text: str) -> tuple[str, ...]:
    """The parts of a comma-separated list, blanks stripped, none for an empty text."""
    return tuple(part.strip() for part in text.split(",")) if text.strip() else ()


def _counts(texts: tuple[str, ...] | list[str], parameters: Mapping[str, float]) -> tuple[int, ...]:
    """Whole numbers that expressions stand for."""
    values = [evaluate(text, parameters) for text in texts]
    for text, value in zip(texts, values, strict=True):
        if not 1 <= value <= 1e6:
            raise FormatError(f"expected a number of modes or points from 1 up, found {text!r}")
    return tuple(round(value) for value in values)
