"""Composites and domains as text, in tokens such as ``T[0-9,12]`` (format notes 1.6), read and written."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from elvis.core.base.arrays import Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import Composite, Mesh
from elvis.formats.nektar import numbers
from elvis.formats.nektar.assembly import RawComposite
from elvis.formats.nektar.numbers import IdList
from elvis.formats.nektar.xml import Element, format_errors_at

_TOKEN = re.compile(rb"([A-Z])\[([^\[\]]*)\]")
_TAGS = b"VESFTQAPRH"


def parse_tokens(text: bytes) -> tuple[tuple[str, IdList], ...]:
    """The ids in a composite by tag; raises FormatError if there is anything else, or an unknown tag."""
    lists, end = dict[bytes, list[bytes]](), 0
    for token in _TOKEN.finditer(text):
        _check_blank(text[end : token.start()])
        if token[1] not in _TAGS:
            raise FormatError(f"expected one of the tags {_TAGS.decode()}, found {token[1].decode()}")
        lists.setdefault(token[1], []).append(token[2])
        end = token.end()
    _check_blank(text[end:])
    return tuple((tag.decode(), _joined(ids)) for tag, ids in lists.items())


def _joined(lists: Iterable[bytes]) -> IdList:
    """The ids of all lists: a composite may name a million elements one by one."""
    return numbers.parse_ids(b",".join(ids for ids in lists if ids.strip()))


def _check_blank(text: bytes) -> None:
    if found := text.strip(b" \t\r\n,"):
        raise FormatError(f"expected tokens such as T[0-9], found {found[:40].decode('utf-8', 'replace')!r}")


def format_tokens(parts: Iterable[tuple[str, Ints]]) -> str:
    """The text of a composite, blanks around it as the format's own tools write it."""
    return "".join(f" {tag}[{numbers.format_ids(ids)}]" for tag, ids in parts) + " "


def composite_ids(text: bytes) -> IdList:
    """The list in ``C[…]``; several tokens and a bare list are understood as well."""
    lists = [ids for _, ids in _TOKEN.findall(text)]
    return _joined(lists) if lists else numbers.parse_ids(text)


def read_composites(section: Element | None) -> tuple[RawComposite, ...]:
    """The children ``C`` of a COMPOSITE section."""
    return tuple(_composite(child) for child in section.children() if child.tag == "C") if section else ()


def _composite(child: Element) -> RawComposite:
    with format_errors_at(child):
        return number(child, "ID"), parse_tokens(bytes(child.content)), child.attributes.get("NAME")


def read_domains(section: Element | None) -> dict[int, IdList]:
    """Domain id -> list of composites, from children ``D`` or from plain text."""
    if section is None or section.is_empty:
        return {}
    domains: dict[int, IdList] = {}
    for child in section.children():
        with format_errors_at(child):
            domains[number(child, "ID")] = composite_ids(bytes(child.content))
    if domains:
        return domains
    with format_errors_at(section):
        return {0: composite_ids(bytes(section.content))}


def number(element: Element, name: str, default: int | None = None) -> int:
    """An attribute that is a whole number from 0 up."""
    text = element.require(name) if default is None else element.attributes.get(name, str(default))
    if not re.fullmatch(r"\s*[0-9]{1,18}\s*", text):
        raise element.error(f"expected {name} to be a number, found {text[:40]!r}")
    return int(text)


def with_domain(mesh: Mesh) -> Mesh:
    """The mesh with a domain: where it names none, every element, in one new composite a shape."""
    if any(mesh.domains.values()):
        return mesh
    free = max((composite.id for composite in mesh.composites), default=-1) + 1
    shapes = enumerate(mesh.elements.items(), free)
    added = tuple(Composite(id, ((shape.tag, entities.ids),)) for id, (shape, entities) in shapes)
    domains = {0: tuple(composite.id for composite in added)}
    return replace(mesh, composites=(*mesh.composites, *added), domains=domains)


def written_composites(mesh: Mesh) -> list[Composite]:
    """The composites that hold anything, as the format has no empty ones; labels become names if no other has them."""
    found = []
    words = {word for composite in mesh.composites for word in (composite.name, str(composite.id))}
    for composite in mesh.composites:
        parts = tuple((tag, ids) for tag, ids in composite.parts if len(ids))
        if parts:
            label = None if composite.label in words else composite.label
            found.append(replace(composite, parts=parts, name=composite.name or label))
    return found
