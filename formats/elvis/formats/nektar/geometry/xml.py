"""The GEOMETRY section of an XML file in its two forms, text and compressed (format notes 1.1 to 1.7).

Text has one entry a vertex, edge, face, element or curve; compressed sections are payloads of 8-byte records.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import MEMBERS
from elvis.core.polynomials.points import PointsType
from elvis.core.shapes import Shape
from elvis.formats.nektar import composites, numbers
from elvis.formats.nektar.assembly import RawCurves, RawGeometry
from elvis.formats.nektar.expressions import evaluate
from elvis.formats.nektar.payload import ENCODING, decode, record_pieces
from elvis.formats.nektar.xml import Element, format_errors_at


def dimensions(geometry: Element) -> tuple[int, int]:
    """DIM and SPACE; raises FormatError unless 1 <= DIM <= SPACE <= 3."""
    dimension, space = composites.number(geometry, "DIM", 3), composites.number(geometry, "SPACE", 3)
    if not 1 <= dimension <= space <= 3:
        raise geometry.error(f"expected 1 <= DIM <= SPACE <= 3, found DIM {dimension} and SPACE {space}")
    return dimension, space


def read_geometry(geometry: Element) -> RawGeometry:
    """A GEOMETRY section that holds the mesh itself, as text or compressed."""
    sections = {child.tag: child for child in geometry.children()}
    dimension, space = dimensions(geometry)
    if "VERTEX" not in sections or "ELEMENT" not in sections:
        missing = "VERTEX" if "VERTEX" not in sections else "ELEMENT"
        raise geometry.error(f"expected a section {missing}, found {', '.join(sections) or 'nothing'}")

    vertices = sections["VERTEX"]
    with format_errors_at(vertices):
        scaling = Scaling(vertices)
        vertex_ids, points = _codec(vertices).read_vertices(vertices)
        points = scaling(points)
    tables = dict(_tables(sections, dimension))
    edge_curves, face_curves = _curves(sections.get("CURVED"), scaling)
    return RawGeometry(
        geometry.file,
        dimension,
        space,
        vertex_ids,
        points,
        tables,
        edge_curves,
        face_curves,
        composites.read_composites(sections.get("COMPOSITE")),
        composites.read_domains(sections.get("DOMAIN")),
    )


class Scaling:
    """x' = x XSCALE + XMOVE, and so on, from the attributes of VERTEX."""

    def __init__(self, vertices: Element) -> None:
        attributes = vertices.attributes
        self._scale = [evaluate(attributes.get(f"{axis}SCALE", "1")) for axis in "XYZ"]
        self._move = [evaluate(attributes.get(f"{axis}MOVE", "0")) for axis in "XYZ"]
        self._is_identity = self._scale == [1.0] * 3 and self._move == [0.0] * 3

    def __call__(self, points: Floats) -> Floats:
        """The points (n, 3), scaled in place where there is anything to do."""
        if not self._is_identity:
            with np.errstate(over="ignore"):
                points *= self._scale
                points += self._move
        return points


def is_compressed(section: Element) -> bool:
    """Whether a section says that it is compressed; raises FormatError for an unknown encoding."""
    encoding = section.attributes.get("COMPRESSED", "")
    if encoding and encoding.lower() != ENCODING.lower():
        raise section.error(f"expected the encoding {ENCODING}, found {encoding!r}")
    return bool(encoding)


def _codec(section: Element) -> _TextCodec | _CompressedCodec:
    return _COMPRESSED if is_compressed(section) else _TEXT


def _tables(sections: dict[str, Element], dimension: int) -> list[tuple[Shape, tuple[Ints, Ints]]]:
    """Edges, faces and elements by shape."""
    found: list[tuple[Shape, tuple[Ints, Ints]]] = []
    parts = [("EDGE", {"E": Shape.SEGMENT})] if dimension > 1 else []
    if dimension == 3:
        parts.append(("FACE", {"T": Shape.TRIANGLE, "Q": Shape.QUADRILATERAL}))
    parts.append(("ELEMENT", {shape.tag: shape for shape in Shape.of_dimension(dimension)}))

    for name, tags in parts:
        section = sections.get(name)
        if section is not None and not section.is_empty:
            found += list(_section_tables(section, tags).items())
    return found


def _section_tables(section: Element, tags: dict[str, Shape]) -> dict[Shape, tuple[Ints, Ints]]:
    with format_errors_at(section):
        widths = {tag: MEMBERS[shape] for tag, shape in tags.items()}
        children_compressed = section.tag != "EDGE" and _first_child_compressed(section)
        codec = _COMPRESSED if children_compressed else _codec(section)
        rows = codec.read_rows(section, widths)
    return {tags[tag]: table for tag, table in rows.items() if len(table[0])}


def _first_child_compressed(section: Element) -> bool:
    first = next(section.children(), None)
    return first is not None and is_compressed(first)


def _curves(section: Element | None, scaling: Scaling) -> tuple[RawCurves, RawCurves]:
    """Curved edges and faces; the text form leaves faces unscaled (a habit of the format's own reader)."""
    if section is None or section.is_empty:
        return RawCurves.none(), RawCurves.none()
    with format_errors_at(section):
        edges, faces = _codec(section).read_curves(section)
        scaling(edges.points)
        if is_compressed(section):
            scaling(faces.points)
        return edges, faces


#: tag of a curve -> the attribute that names its edge or face
_ENTITY = {"E": "EDGEID", "F": "FACEID"}


class _TextCodec:
    """Reads the sections of the text form."""

    def read_vertices(self, section: Element) -> tuple[Ints, Floats]:
        """Ids (n,) and points (n, 3)."""
        return numbers.vertex_rows(section.data, section.start, section.stop)

    def read_rows(self, section: Element, widths: Mapping[str, int]) -> dict[str, tuple[Ints, Ints]]:
        """Ids (n,) and members (n, width) by tag."""
        return numbers.rows(section.data, section.start, section.stop, widths)

    def read_curves(self, section: Element) -> tuple[RawCurves, RawCurves]:
        """Curved edges and curved faces."""
        parts: dict[str, list[RawCurves]] = {"E": [], "F": []}
        for chunk in numbers.chunks(section.data, section.start, section.stop):
            for tag, curves in _chunk_curves(chunk).items():
                parts[tag].append(curves)
        return RawCurves.joined(parts["E"]), RawCurves.joined(parts["F"])


_TEXT = _TextCodec()


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
    entities = numbers.ints(b" ".join(_head_attributes(tag, _ENTITY[tag], rb"[0-9]+", joined, len(heads))))
    counts = numbers.ints(b" ".join(_head_attributes(tag, "NUMPOINTS", rb"[0-9]+", joined, len(heads))))
    wrong = np.flatnonzero((counts > len(values)) | (stops - starts != 3 * np.minimum(counts, len(values))))
    if len(wrong):
        first = wrong[0]
        message = f"expected {counts[first]} points on <{tag} {_ENTITY[tag]}={entities[first]}>"
        raise FormatError(f"{message}, found {stops[first] - starts[first]} numbers")
    kinds = _kinds(_head_attributes(tag, "TYPE", rb"[^\"'\n]*?", joined, len(heads)))
    owned = np.repeat(starts - np.cumsum(3 * counts) + 3 * counts, 3 * counts) + np.arange(3 * counts.sum())
    return RawCurves(entities, kinds, counts, values[owned].reshape(-1, 3))


def _head_attributes(tag: str, name: str, pattern: bytes, heads: bytes, count: int) -> list[bytes]:
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


#: columns of a curve record: id, entity, number of points, 0, offset into INDEX, PointsType
_CURVE_WIDTH = 6


class _CompressedCodec:
    """Reads the sections of the compressed form."""

    def read_vertices(self, section: Element) -> tuple[Ints, Floats]:
        """Ids (n,) and points (n, 3)."""
        records = decode(section.content, 4)
        return records.view("<i8")[:, 0].astype(np.int64), records.view("<f8")[:, 1:].astype(np.float64)

    def read_rows(self, section: Element, widths: Mapping[str, int]) -> dict[str, tuple[Ints, Ints]]:
        """Ids (n,) and members (n, width) by tag.

        EDGE is itself a payload; other sections have one payload per tag.
        """
        if section.tag == "EDGE":
            return {"E": _record_table(section, widths["E"])}
        rows: dict[str, tuple[Ints, Ints]] = {}
        for child in section.children():
            if child.tag not in widths or child.tag in rows:
                raise child.error(f"expected {', '.join(widths)}, each once, found <{child.tag}>")
            rows[child.tag] = _record_table(child, widths[child.tag])
        return rows

    def read_curves(self, section: Element) -> tuple[RawCurves, RawCurves]:
        """Curved edges and curved faces."""
        children = {child.tag: child for child in section.children()}
        data = children.get("DATAPOINTS")
        parts = {child.tag: child for child in data.children()} if data else {}
        if "INDEX" not in parts or "POINTS" not in parts:
            raise FormatError("expected DATAPOINTS with INDEX and POINTS, found none")

        index = _records(parts["INDEX"], 1)[:, 0]
        with format_errors_at(parts["POINTS"]):
            _, points = self.read_vertices(parts["POINTS"])
        if len(index) and not 0 <= index.min() <= index.max() < len(points):
            raise parts["INDEX"].error(f"expected indices of {len(points)} points, found a larger one")
        edges = _record_curves(children.get("E"), index, points)
        return edges, _record_curves(children.get("F"), index, points)


_COMPRESSED = _CompressedCodec()


def _record_table(element: Element, width: int) -> tuple[Ints, Ints]:
    """Ids and members of records of one more item."""
    records = _narrow_records(element, width + 1)
    return records[:, 0].copy(), records[:, 1:].copy()


def _narrow_records(element: Element, width: int) -> NDArray[Any]:
    """`_records` with 32 bits if these suffice for all."""
    narrow = np.dtype(np.int32)
    least, greatest = np.iinfo(narrow).min, np.iinfo(narrow).max
    out = bytearray()
    with format_errors_at(element):
        for piece in record_pieces(element.content, width):
            numbers = np.frombuffer(piece, "<i8")
            if len(numbers) and not least <= numbers.min() <= numbers.max() <= greatest:
                return _records(element, width)
            out += numbers.astype(narrow).tobytes()
    return np.frombuffer(out, narrow).reshape(-1, width)


def _records(element: Element, width: int) -> Ints:
    with format_errors_at(element):
        return decode(element.content, width).view("<i8").astype(np.int64, copy=False)


def _record_curves(element: Element | None, rows: Ints, points: Floats) -> RawCurves:
    """The curves of one kind; ``rows`` holds the rows of INDEX in ``points``."""
    if element is None or element.is_empty:
        return RawCurves.none()
    table = _records(element, _CURVE_WIDTH)
    entities, counts, offsets, kinds = table[:, 1].copy(), table[:, 2].copy(), table[:, 4], table[:, 5].copy()
    with format_errors_at(element):
        return RawCurves(entities, kinds, counts, points[rows[owned(counts, offsets, len(rows))]])


def owned(counts: Ints, offsets: Ints, available: int) -> Ints | slice:
    """Places of the points of all curves, one after another.

    Raises FormatError if they aren't among those available.
    """
    if np.any((counts < 0) | (counts > available) | (offsets < 0) | (offsets > available - counts)):
        raise FormatError(f"expected curves of at most {available} points, found a longer one")
    total = int(counts.sum())
    if total > 16 * (available + 1):
        raise FormatError(f"expected curves of {available} points in all, found {total}")
    ends = np.cumsum(counts)
    if np.array_equal(offsets, offsets[:1] + ends - counts):
        start = int(offsets[0]) if len(offsets) else 0
        return slice(start, start + total)
    places = np.repeat(offsets - ends + counts, counts)
    places += np.arange(total)
    return places
