"""The GEOMETRY section of an XML file: what its text and compressed forms share (format notes 1.1 to 1.7)."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.mesh import MEMBERS
from elvis.core.shapes import Shape
from elvis.formats.nektar import composites, geometry_compressed, geometry_text
from elvis.formats.nektar.expressions import evaluate
from elvis.formats.nektar.payload import ENCODING
from elvis.formats.nektar.raw import RawCurves, RawGeometry
from elvis.formats.nektar.xml import Element, located


def dimensions(geometry: Element) -> tuple[int, int]:
    """DIM and SPACE; FormatError unless 1 <= DIM <= SPACE <= 3."""
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
    with located(vertices):
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
    """Whether a section says that it is compressed; FormatError for an unknown encoding."""
    encoding = section.attributes.get("COMPRESSED", "")
    if encoding and encoding.lower() != ENCODING.lower():
        raise section.error(f"expected the encoding {ENCODING}, found {encoding!r}")
    return bool(encoding)


def _codec(section: Element) -> geometry_text.Codec | geometry_compressed.Codec:
    return geometry_compressed.CODEC if is_compressed(section) else geometry_text.CODEC


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
    with located(section):
        widths = {tag: MEMBERS[shape] for tag, shape in tags.items()}
        children_compressed = section.tag != "EDGE" and _first_child_compressed(section)
        codec = geometry_compressed.CODEC if children_compressed else _codec(section)
        rows = codec.read_rows(section, widths)
    return {tags[tag]: table for tag, table in rows.items() if len(table[0])}


def _first_child_compressed(section: Element) -> bool:
    first = next(section.children(), None)
    return first is not None and is_compressed(first)


def _curves(section: Element | None, scaling: Scaling) -> tuple[RawCurves, RawCurves]:
    """Curved edges and faces; the text form leaves faces unscaled (a habit of the format's own reader)."""
    if section is None or section.is_empty:
        return RawCurves.none(), RawCurves.none()
    with located(section):
        edges, faces = _codec(section).read_curves(section)
        scaling(edges.points)
        if is_compressed(section):
            scaling(faces.points)
        return edges, faces
