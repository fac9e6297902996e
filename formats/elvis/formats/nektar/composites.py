"""Composites and domains as text: tokens such as ``T[0-9,12]`` (format notes 1.6)."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from elvis.formats.arrays import Ints
from elvis.formats.errors import FormatError
from elvis.formats.nektar import idlist
from elvis.formats.nektar.idlist import IdList
from elvis.formats.nektar.raw import RawComposite
from elvis.formats.nektar.xml import Element, located

_TOKEN = re.compile(r"([A-Z])\[([^\[\]]*)\]")
_TAGS = frozenset("VESFTQAPRH")


def parse_tokens(text: str) -> tuple[tuple[str, IdList], ...]:
    """The tokens of a composite; FormatError where there is anything else, or an unknown tag."""
    if rest := _TOKEN.sub(" ", text).strip():
        raise FormatError(f"expected tokens such as T[0-9], found {rest[:40]!r}")
    tokens = _TOKEN.findall(text)
    for tag, _ in tokens:
        if tag not in _TAGS:
            raise FormatError(f"expected one of the tags {' '.join(sorted(_TAGS))}, found {tag}")
    return tuple((tag, idlist.parse(ids)) for tag, ids in tokens)


def format_tokens(parts: Iterable[tuple[str, Ints]]) -> str:
    """The text of a composite, blanks around it as the format's own tools write it."""
    return "".join(f" {tag}[{idlist.format_ids(ids)}]" for tag, ids in parts) + " "


def composite_ids(text: str) -> IdList:
    """The list in ``C[…]``; several tokens and a bare list are understood as well."""
    lists = [idlist.parse(ids) for _, ids in _TOKEN.findall(text)]
    if not lists:
        return idlist.parse(text)
    return IdList(np.concatenate([ids.first for ids in lists]), np.concatenate([ids.last for ids in lists]))


def read_composites(section: Element | None) -> tuple[RawComposite, ...]:
    """The children ``C`` of a COMPOSITE section."""
    return tuple(_composite(child) for child in section.children() if child.tag == "C") if section else ()


def _composite(child: Element) -> RawComposite:
    with located(child):
        return number(child, "ID"), parse_tokens(child.text), child.attributes.get("NAME")


def read_domains(section: Element | None) -> dict[int, IdList]:
    """Domain id -> list of composites, from children ``D`` or from plain text."""
    if section is None or section.is_empty:
        return {}
    domains: dict[int, IdList] = {}
    for child in section.children():
        with located(child):
            domains[number(child, "ID")] = composite_ids(child.text)
    if domains:
        return domains
    with located(section):
        return {0: composite_ids(section.text)}


def number(element: Element, name: str, default: int | None = None) -> int:
    """An attribute that is a whole number from 0 up."""
    text = element.required(name) if default is None else element.attributes.get(name, str(default))
    if not re.fullmatch(r"\s*[0-9]{1,18}\s*", text):
        raise element.error(f"expected {name} to be a number, found {text[:40]!r}")
    return int(text)
