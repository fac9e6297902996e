"""Rules for the XML of a mesh and for payloads: attributes, digits, lines, the form of composites and domains."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from elvis.formats.nektar.composites import composite_ids
from elvis.formats.nektar.payload import ENCODING
from elvis.formats.nektar.xml import Element
from elvis.formats.strict.finding import Finding, library_rule, style_rule

_ATTRIBUTES = frozenset({"DIM", "SPACE", "PARTITION", "HDF5FILE"})
_NUMBER = re.compile(rb"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_ID = re.compile(r"\s*[0-9]{1,18}\s*")
_TOKENS = re.compile(rb"\s*(?:[VESFTQAPRH]\[[0-9]+(?:-[0-9]+)?(?:,[0-9]+(?:-[0-9]+)?)*\]\s*)*")
_DOMAIN = re.compile(rb"\s*C\[[0-9]+(?:-[0-9]+)?(?:,[0-9]+(?:-[0-9]+)?)*\]\s*")

#: numbers with more digits than a hand writes, but fewer than a double needs, were cut
_FEWEST, _ENOUGH = 5, 16
_SAMPLE = 1 << 18


def geometry_findings(geometry: Element) -> Iterator[Finding]:
    """The rules that the section GEOMETRY itself breaks."""
    unknown = sorted(set(geometry.attributes) - _ATTRIBUTES)
    if unknown:
        sentence = f"expected only DIM, SPACE, PARTITION or HDF5FILE, found {', '.join(unknown)}"
        yield library_rule(geometry.place, sentence)
    if "HDF5FILE" in geometry.attributes:
        return
    sections = {child.tag: child for child in geometry.children()}
    yield from _coding(sections)
    for name in ("VERTEX", "CURVED"):
        section = sections.get(name)
        if section is not None and not _is_coded(section):
            yield from (style_rule(section.place, sentence) for sentence in _digits(section))
    yield from _composites(sections, "PARTITION" in geometry.attributes)


def payload_findings(place: str, element: Element) -> Iterator[Finding]:
    """Defects of a payload's text: it must be one line of base64, and should declare this."""
    if element.attributes.get("COMPRESSED", "").lower() != ENCODING.lower():
        found = element.attributes.get("COMPRESSED") or "none"
        yield style_rule(place, f"expected COMPRESSED={ENCODING}, found {found}")
    if re.search(rb"\s", bytes(element.content).strip()):
        yield library_rule(place, "expected base64 on one line, found blanks in it")


def _is_coded(section: Element) -> bool:
    """Whether a section, or one of its children, is compressed."""
    return bool(section.attributes.get("COMPRESSED")) or (
        section.tag in ("FACE", "ELEMENT") and any(child.attributes.get("COMPRESSED") for child in _first(section))
    )


def _first(section: Element) -> Iterator[Element]:
    for child in section.children():
        yield child
        return


def _coding(sections: dict[str, Element]) -> Iterator[Finding]:
    """All sections are compressed, each payload on one line, or none is."""
    filled = [s for t, s in sections.items() if t in ("VERTEX", "EDGE", "FACE", "ELEMENT", "CURVED") and not s.is_empty]
    coded = {section.tag: _is_coded(section) for section in filled}
    for section in filled:
        if coded[section.tag] != coded.get("VERTEX", False):
            wanted = "compressed" if coded.get("VERTEX") else "text"
            yield library_rule(section.place, f"expected {wanted} like VERTEX, found another form")
        if coded[section.tag]:
            for payload in _payloads(section):
                if re.search(rb"\s", bytes(payload.content).strip()):
                    yield library_rule(payload.place, "expected base64 on one line, found blanks in it")


def _payloads(section: Element) -> Iterator[Element]:
    if section.tag in ("VERTEX", "EDGE"):
        yield section
        return
    for child in section.children():
        if child.tag == "DATAPOINTS":
            yield from child.children()
        else:
            yield child


def _digits(section: Element) -> Iterator[str]:
    """Coordinates in text need 17 digits; short ones, as a hand writes them, do with fewer."""
    text = re.sub(rb"<[^<>]*>", b" ", bytes(section.content[:_SAMPLE]))
    cut = [len(_significant(token)) for token in _NUMBER.findall(text)[:4096] if not _is_whole(token)]
    if cut and _FEWEST <= max(cut) < _ENOUGH:
        yield f"expected coordinates with 17 digits, found {max(cut)} at most"


def _significant(token: bytes) -> bytes:
    return re.split(rb"[eE]", token)[0].translate(None, b"+-.").strip(b"0")


def _is_whole(token: bytes) -> bool:
    """Whether the double of a token, printed with 17 digits, has the same digits as the token."""
    return _significant(b"%.17g" % float(token)) == _significant(token)


def _composites(sections: dict[str, Element], is_piece: bool) -> Iterator[Finding]:
    """Check that composites have the form TAG[list] and the domain C[list], directly or in children D.

    is_piece  whether this is a part of a mesh, which may lack composites that others have
    """
    present: list[int] = []
    for child in sections["COMPOSITE"].children() if "COMPOSITE" in sections else ():
        if _ID.fullmatch(child.attributes.get("ID", "")):
            present.append(int(child.attributes["ID"]))
        if not _TOKENS.fullmatch(bytes(child.content)):
            yield library_rule(child.place, f"expected TAG[ids] without blanks in brackets, found {child.text[:40]!r}")
    domain = sections.get("DOMAIN")
    if domain is None or domain.is_empty:
        place = domain.place if domain else "<GEOMETRY>"
        yield library_rule(place, 'expected a DOMAIN such as <D ID="0"> C[0] </D>, found none')
        return
    for entry in list(domain.children()) or [domain]:
        if entry.tag not in ("D", "DOMAIN") or not _DOMAIN.fullmatch(bytes(entry.content)):
            yield library_rule(entry.place, f"expected C[ids], found {entry.text[:40]!r}")
            continue
        ids = composite_ids(bytes(entry.content))
        unknown = ids.first_outside(np.unique(np.array(present, np.int64)))
        if unknown is not None:
            kind = style_rule if is_piece else library_rule
            yield kind(entry.place, f"expected composites of the mesh, found {unknown}")
