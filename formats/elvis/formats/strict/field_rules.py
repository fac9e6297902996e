"""Rules for fields and for the EXPANSIONS that must cover them: the data must arrive whole in other programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Ints, joined_ints
from elvis.core.data.dataset import Dataset, ExpansionRule
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.shapes import Shape
from elvis.formats.nektar.sections import Section
from elvis.formats.strict.finding import Finding, library_rule, style_rule

_PLACE = "<EXPANSIONS>"
#: the most modes in any direction of the data of a field on a composite of the domain: by its id and the field's name
Needed: TypeAlias = Mapping[tuple[int, str], int]


def section_findings(mesh: Mesh, sections: Sequence[Section]) -> Iterator[Finding]:
    """One section a shape, each element of the domain once for each field, none of elsewhere."""
    yield from repeated_sections(sections)
    domain = mesh.domain_ids()
    for name in dict.fromkeys(name for section in sections for name in section.space.names):
        own = [section for section in sections if name in section.space.names]
        yield from _covering(f"field {name}", mesh, domain, own)


def repeated_sections(sections: Sequence[Section]) -> Iterator[Finding]:
    """One section a shape."""
    seen: dict[object, str] = {}
    for section in sections:
        space = section.space
        key = (space.names, space.shape, space.bases, space.homogeneous)
        if key in seen:
            sentence = f"expected one section a shape, found another {space.shape.label} after {seen[key]}"
            yield style_rule(section.place, sentence)
        seen.setdefault(key, section.place)


def _covering(place: str, mesh: Mesh, domain: Ints, sections: Sequence[Section]) -> Iterator[Finding]:
    ids, counts = np.unique(np.concatenate([section.element_ids for section in sections]), return_counts=True)
    missing = np.setdiff1d(domain, ids, assume_unique=True)
    if len(missing):
        sentence = f"expected values on all {len(domain)} elements of the domain, found none on {len(missing)}"
        yield style_rule(place, sentence)
    if (counts > 1).any() and not any(section.space.homogeneous for section in sections):
        sentence = f"expected each element once, found {int(ids[counts > 1][0])} {int(counts.max())} times"
        yield style_rule(place, sentence)
    every = np.concatenate([own.ids for own in mesh.elements.values()] or [ids[:0]])
    unknown = np.setdiff1d(ids, every)
    if len(unknown):
        # readers skip them, but for pyramids
        pyramids = [section.element_ids for section in sections if section.space.shape is Shape.PYRAMID]
        kind = library_rule if np.isin(unknown, np.concatenate([ids[:0], *pyramids])).any() else style_rule
        yield kind(place, f"expected elements of the mesh, found {len(unknown)} others, such as {unknown[0]}")
    for section in sections:
        shape = section.space.shape
        wrong = np.setdiff1d(np.intersect1d(section.element_ids, every), mesh.of(shape).ids)
        if len(wrong):
            sentence = f"expected a {shape.label.lower()} in the mesh for element {wrong[0]}, found another"
            yield library_rule(place, sentence)


def expansion_findings(dataset: Dataset, rules: Sequence[ExpansionRule], needed: Needed) -> Iterator[Finding]:
    """Check that every composite of the domain has rules; and check for the trap of format notes 3.

    Names and orders in EXPANSIONS control what the programs read from field files: they cut data of fields that no rule
    names, and data of higher orders, to the orders of EXPANSIONS.  Genuine files have this defect, so the finding is
    only advice.
    """
    names = [field.name for field in dataset.fields]
    if not rules:
        yield library_rule(_PLACE, "expected rules for the composites of the domain, found none")
        return
    for composite in dataset.mesh.domain_composites():
        own = [rule for rule in rules if composite.id in rule.composites]
        if not own:
            yield library_rule(_PLACE, f"expected a rule for composite {composite.id} of the domain, found none")
        for name in names:
            yield from _on_composite(composite, name, own, needed[composite.id, name])


def needed_modes(dataset: Dataset, sections: Sequence[Section]) -> Needed:
    """The modes of all fields on all composites of the domain; for a part of a mesh, those on its elements."""
    return {
        (composite.id, field.name): _modes(
            dataset.mesh, composite, [section for section in sections if field.name in section.space.names]
        )
        for composite in dataset.mesh.domain_composites()
        for field in dataset.fields
    }


def _on_composite(composite: Composite, name: str, rules: Sequence[ExpansionRule], needed: int) -> Iterator[Finding]:
    fitting = [rule for rule in rules if name in rule.fields]
    where = f"on composite {composite.id}"
    if rules and len(fitting) != 1:
        kind = library_rule if fitting else style_rule
        yield kind(_PLACE, f"expected one rule that names the field {name} {where}, found {len(fitting) or 'none'}")
        return
    for rule in fitting:
        if min(rule.modes) < needed:
            sentence = f"expected NUMMODES of {needed} or more for {name} {where}, found {min(rule.modes)}"
            yield style_rule(_PLACE, sentence)


def _modes(mesh: Mesh, composite: Composite, sections: Sequence[Section]) -> int:
    """The most modes in any direction of the data on a composite."""
    tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
    ids = joined_ints(part for tag, part in composite.parts if tag in tags)
    most = 0
    for section in sections:
        inside = np.isin(section.element_ids, ids)
        if inside.any():
            modes = section.space.modes
            most = max(most, int(modes.max() if len(modes) == 1 else modes[inside].max()))
    return most
