"""Sections of a session other than mesh and expansions, such as CONDITIONS: stored as text, and written unchanged.

The names of boundary regions are read from them (format notes 3), because composites seldom have names of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from elvis.formats.nektar.remarks import Remark
from elvis.formats.nektar.xml import Element, Writer

#: sections that are read and regenerated when written
_OWN = ("GEOMETRY", "EXPANSIONS")
_CONDITIONS = "CONDITIONS"
#: the list of variables; new entries go before its closing tag and continue its numbers
_VARIABLES = re.compile(r"(<VARIABLES(?:\s[^<>]*)?>)(.*?)(</VARIABLES\s*>)", re.DOTALL)
_VARIABLE = re.compile(r"<V\s[^<>]*\bID\s*=\s*[\"']\s*([0-9]{1,9})\s*[\"'][^<>]*>([^<>]*)</V\s*>")


def session_of(tags: Mapping[str, Element]) -> dict[str, str]:
    """The sections by tag as XML, without comments."""
    return {tag: element.source for tag, element in tags.items() if tag not in _OWN and not element.is_empty}


def region_names(conditions: Element | None) -> list[Remark]:
    """Lists of composites as ``C[2-3]``, and the attribute NAME of the boundary regions that these are."""
    section = conditions.find("BOUNDARYREGIONS") if conditions is not None and not conditions.is_empty else None
    found = []
    for region in section.children() if section is not None else ():
        name = region.attributes.get("NAME", "").strip()
        if name:
            found.append((bytes(region.content), name))
    return found


def write_session(writer: Writer, session: Mapping[str, str], fields: Iterable[str]) -> None:
    """The sections as they were; the list of variables also names ``fields``, as EXPANSIONS may name no others."""
    for tag, text in session.items():
        writer.source(_with_variables(text, fields) if tag == _CONDITIONS else text)


def _with_variables(conditions: str, fields: Iterable[str]) -> str:
    """CONDITIONS whose variables, if it lists any, include all fields."""
    found = _VARIABLES.search(conditions)
    if found is None:
        return conditions
    listed = _VARIABLE.findall(found[2])
    added = "".join(_entries(fields, {name.strip() for _, name in listed}, [int(id) for id, _ in listed]))
    return conditions[: found.start(3)] + added + conditions[found.start(3) :]


def _entries(fields: Iterable[str], listed: set[str], numbers: list[int]) -> Iterator[str]:
    """Entries of the fields that are not listed yet, numbered after the others."""
    from xml.sax.saxutils import escape

    number = max(numbers, default=-1) + 1
    for name in fields:
        if escape(name) not in listed:
            yield f'<V ID="{number}"> {escape(name)} </V>'
            number += 1
