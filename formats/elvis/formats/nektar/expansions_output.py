"""Writing EXPANSIONS so that other programs see the data as they are (format notes 3 and 9).

A program takes bases and orders from the field file only if the names of its fields are in FIELDS; otherwise it cuts
the data to NUMMODES.  So rules of the dataset are kept, but completed: every field, no order below the data's.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from elvis.core.dataset import Dataset, Expansion, ExpansionRule
from elvis.core.mesh import Mesh
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.formats.nektar.idlist import format_ids
from elvis.formats.nektar.output_xml import Writer
from elvis.formats.nektar.sections_output import OutputSection, joined

_DEFAULT_MODES, _DEFAULT_FIELDS = 4, ("u",)
_BASIS_LABELS = frozenset(basis.label for basis in Basis)
_KINDS = {Basis.GLL_LAGRANGE: "GLL_LAGRANGE", Basis.GAUSS_LAGRANGE: "GAUSS_LAGRANGE", Basis.ORTHO_A: "ORTHOGONAL"}


def completed_rules(dataset: Dataset, sections: Sequence[OutputSection]) -> tuple[ExpansionRule, ...]:
    """Rules that cover every composite of the domain, for every field, with orders not below the data's."""
    names = tuple(field.name for field in dataset.fields)
    rules: list[ExpansionRule] = []
    for rule in dataset.expansions:
        fields = _completed_fields(rule, names, rules, dataset.expansions)
        if fields or not names:
            used = _expansions(dataset.mesh, sections, rule.composites)
            rules.append(_raised(replace(rule, fields=fields), max((max(e.modes) for e in used), default=0)))

    # composites of the domain without a rule get one
    covered = {composite for rule in rules for composite in rule.composites}
    domain = {composite for composites in dataset.mesh.domains.values() for composite in composites}
    for composite in sorted(domain - covered):
        used = _expansions(dataset.mesh, sections, (composite,))
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
        attributes |= {"BASISTYPE": rule.kind, "NUMMODES": joined(rule.modes)}
        if rule.points:
            attributes |= {"POINTSTYPE": joined(rule.point_types), "NUMPOINTS": joined(rule.points)}
    elif len(kinds) > 1:
        tag = "H"
        for axis, kind, modes in zip("XYZ", kinds, rule.modes, strict=False):
            attributes |= {f"TYPE-{axis}": kind, f"NUMMODES-{axis}": modes}
    else:
        attributes |= {"NUMMODES": joined(rule.modes), "TYPE": rule.kind}
    if rule.fields:
        attributes["FIELDS"] = joined(rule.fields)
    return tag, attributes


def _completed_fields(
    rule: ExpansionRule, names: tuple[str, ...], earlier: Sequence[ExpansionRule], rules: Sequence[ExpansionRule]
) -> tuple[str, ...]:
    """The fields of a rule, and those that no other rule for the same composites claims; each once a composite."""
    if not names:
        return rule.fields
    claimed = {n for other in rules if other is not rule and _overlap(other, rule) for n in other.fields}
    taken = {name for other in earlier if _overlap(other, rule) for name in other.fields}
    return tuple(n for n in names if n not in taken and (n in rule.fields or n not in claimed))


def _overlap(one: ExpansionRule, other: ExpansionRule) -> bool:
    return not set(one.composites).isdisjoint(other.composites)


def _raised(rule: ExpansionRule, needed: int) -> ExpansionRule:
    """The rule with at least so many modes in every direction, and points to match."""
    modes = tuple(max(count, needed) for count in rule.modes)
    points = tuple(p + new - old for p, new, old in zip(rule.points, modes, rule.modes, strict=False))
    return replace(rule, modes=modes, points=points)


def _kind(expansions: Sequence[Expansion]) -> str:
    """The shorthand for a family of bases."""
    kinds = {_KINDS.get(expansion.bases[0], "MODIFIED") for expansion in expansions}
    if kinds == {"ORTHOGONAL"} and {e.shape for e in expansions} & {Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON}:
        return "MODIFIED"
    return next(iter(kinds)) if len(kinds) == 1 else "MODIFIED"


def _expansions(mesh: Mesh, sections: Sequence[OutputSection], composites: tuple[int, ...]) -> list[Expansion]:
    """The expansions of the data on the elements of some composites."""
    tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
    found = [ids for c in mesh.composites if c.id in composites for tag, ids in c.parts if tag in tags]
    elements = np.concatenate([np.empty(0, np.int64), *found])
    parts = [part for section in sections for part in section.parts]
    return [part.expansion for part in parts if np.isin(part.element_ids, elements).any()]
