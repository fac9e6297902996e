"""The text form of GEOMETRY: one entry a vertex, edge, face, element or curve (format notes 1.3 to 1.5)."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.polynomials.points import PointsType
from elvis.formats.nektar import numbers
from elvis.formats.nektar.raw import RawCurves
from elvis.formats.nektar.xml import Element

#: tag of a curve -> the attribute that names its edge or face
_ENTITY = {"E": "EDGEID", "F": "FACEID"}


class Codec:
    """Reads the sections of the text form."""

    def read_vertices(self, section: Element) -> tuple[Ints, Floats]:
        """Ids (n,) and points (n, 3)."""
        return numbers.vertex_rows(section.data, section.start, section.stop)

    def read_rows(self, section: Element, widths: Mapping[str, int]) -> dict[str, tuple[Ints, Ints]]:
        """By tag ids (n,) and members (n, width)."""
        return numbers.rows(section.data, section.start, section.stop, widths)

    def read_curves(self, section: Element) -> tuple[RawCurves, RawCurves]:
        """Curved edges and curved faces."""
        parts: dict[str, list[RawCurves]] = {"E": [], "F": []}
        for chunk in numbers.chunks(section.data, section.start, section.stop):
            for tag, curves in _chunk_curves(chunk).items():
                parts[tag].append(curves)
        return _joined(parts["E"]), _joined(parts["F"])


CODEC = Codec()


def _joined(parts: list[RawCurves]) -> RawCurves:
    if not parts:
        return RawCurves.none()
    return RawCurves(
        np.concatenate([part.entities for part in parts]),
        np.concatenate([part.kinds for part in parts]),
        np.concatenate([part.counts for part in parts]),
        np.concatenate([part.points for part in parts]),
    )


def _chunk_curves(chunk: bytes) -> dict[str, RawCurves]:
    """The curves of a piece of the section, edges and faces apart."""
    heads = {tag: re.findall(rb"<%s\s([^<>]*)>" % tag.encode(), chunk) for tag in _ENTITY}
    for code, tag in enumerate(_ENTITY):
        chunk = re.sub(rb"<%s\s[^<>]*>" % tag.encode(), b" nan %d " % code, chunk)
    values = numbers.section_numbers(chunk, np.float64)
    starts = np.flatnonzero(np.isnan(values))
    if len(values) and (not len(starts) or starts[0] != 0 or starts[-1] + 1 == len(values)):
        raise FormatError(f"expected curves <E …> and <F …>, found {values[0]}")

    # each curve is a mark, its code and its points
    stops = np.append(starts[1:], len(values))
    codes = values[starts + 1]
    return {
        tag: _curves_of(tag, heads[tag], values, starts[codes == code] + 2, stops[codes == code])
        for code, tag in enumerate(_ENTITY)
    }


def _curves_of(tag: str, heads: list[bytes], values: Floats, starts: Ints, stops: Ints) -> RawCurves:
    joined = b"\n".join(heads)
    entities = numbers.ints(b" ".join(_attributes(tag, _ENTITY[tag], rb"[0-9]+", joined, len(heads))))
    counts = numbers.ints(b" ".join(_attributes(tag, "NUMPOINTS", rb"[0-9]+", joined, len(heads))))
    wrong = np.flatnonzero((counts > len(values)) | (stops - starts != 3 * np.minimum(counts, len(values))))
    if len(wrong):
        first = wrong[0]
        message = f"expected {counts[first]} points on <{tag} {_ENTITY[tag]}={entities[first]}>"
        raise FormatError(f"{message}, found {stops[first] - starts[first]} numbers")
    kinds = _kinds(_attributes(tag, "TYPE", rb"[^\"'\n]*?", joined, len(heads)))
    owned = np.repeat(starts - np.cumsum(3 * counts) + 3 * counts, 3 * counts) + np.arange(3 * counts.sum())
    return RawCurves(entities, kinds, counts, values[owned].reshape(-1, 3))


def _attributes(tag: str, name: str, pattern: bytes, heads: bytes, count: int) -> list[bytes]:
    """The values of an attribute that every head must have."""
    found: list[bytes] = re.findall(rb"\b%s\s*=\s*[\"']\s*(%s)\s*[\"']" % (name.encode(), pattern), heads)
    if len(found) != count:
        raise FormatError(f"expected an attribute {name} in each of {count} entries <{tag} …>, found {len(found)}")
    return found


def _kinds(labels: list[bytes]) -> Ints:
    """PointsType numbers of the names."""
    distinct, inverse = np.unique(np.array(labels, dtype=bytes), return_inverse=True)
    known: list[int] = []
    for label in distinct.tolist():
        try:
            known.append(PointsType.from_label(label.decode("ascii", "replace")))
        except KeyError:
            raise FormatError(f"expected the name of a family of points, found {label[:40]!r}") from None
    return np.array(known, np.int64)[inverse] if known else np.empty(0, np.int64)
