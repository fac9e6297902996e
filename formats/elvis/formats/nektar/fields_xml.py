"""Fields in XML: sections ELEMENTS and Metadata (format notes 5)."""

from __future__ import annotations

import re

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.formats.nektar import idlist, numbers
from elvis.formats.nektar.expansions import split
from elvis.formats.nektar.geometry_xml import is_compressed
from elvis.formats.nektar.payload import decode_exactly, possible_bytes
from elvis.formats.nektar.sections import Section, Space, read_bases, read_space
from elvis.formats.nektar.xml import Element, located

_ORDERS = re.compile(r"\s*(UNIORDER|MIXORDER)\s*:(.*)", re.DOTALL)


def read_section(element: Element) -> Section:
    """A section ELEMENTS; FormatError where its attributes or its data are wrong."""
    with located(element):
        is_compressed(element)
        space = _space(element)
        ids = idlist.parse(element.required("ID"))
        space.check_elements(ids.count)

        # the least that the section must hold is compared with what its text can hold, before any list is expanded
        least = ids.count * len(space.names)
        if 8 * least > possible_bytes(element.content):
            raise FormatError(f"expected {least} coefficients at least, found {len(element.content)} characters")
        element_ids = ids.expand(least)
        items = space.total(len(element_ids))
        values: Floats = decode_exactly(element.content, items).view("<f8").astype(np.float64, copy=False)
        return Section(space, element_ids, values, element.file, f"<ELEMENTS ID={element.attributes['ID'][:40]}>")


def read_metadata(element: Element | None) -> dict[str, str]:
    """Key and text of each child but Provenance."""
    if element is None:
        return {}
    return {child.tag: child.text for child in element.children() if child.tag != "Provenance"}


def _space(element: Element) -> Space:
    attributes = element.attributes
    bases = read_bases(element.required("BASIS"))
    return read_space(
        split(element.required("FIELDS")),
        element.required("SHAPE"),
        bases,
        _modes(element.required("NUMMODESPERDIR"), len(bases)),
        (
            _lengths(attributes.get("HOMOGENEOUSLENGTHS", "")),
            _numbers(attributes.get("HOMOGENEOUSYIDS", "")),
            _numbers(attributes.get("HOMOGENEOUSZIDS", "")),
            _numbers(attributes.get("HOMOGENEOUSSIDS", "")),
        ),
    )


def _modes(text: str, bases: int) -> Ints:
    """(1, bases) or (n, bases) numbers of modes."""
    found = _ORDERS.fullmatch(text)
    if found is None:
        raise FormatError(f"expected UNIORDER: or MIXORDER: in NUMMODESPERDIR, found {text[:40]!r}")
    values = list_of_ints(found[2])
    wanted = bases if found[1] == "UNIORDER" else max(len(values) // bases, 1) * bases
    if len(values) != wanted:
        raise FormatError(f"expected {wanted} numbers of modes, found {len(values)}")
    return values.reshape(-1, bases)


def list_of_ints(text: str) -> Ints:
    """(n,) whole numbers separated by commas."""
    return numbers.ints(text.replace(",", " ").encode("ascii", "replace"))


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(list_of_ints(text).tolist())


def _lengths(text: str) -> tuple[float, ...]:
    return tuple(numbers.floats(text.replace(",", " ").encode("ascii", "replace")).tolist())
