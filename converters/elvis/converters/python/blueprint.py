"""Meshes of Conduit's Blueprint with high orders, in MFEM's layout: nodes of Conduit, or dictionaries like them.

MFEM's basis, such as H1_3D_P2, is the name of its finite element collection.  Values belong to all its degrees of
freedom, in the order that follows from the elements (Conduit documentation, Mesh Blueprint; MFEM documentation,
ConduitDataCollection).  The mesh is therefore written as MFEM's own text, which its library then evaluates.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.mfem.mfem import Mfem
from elvis.converters.mfem.pieces import Piece, Source
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import one_line
from elvis.core.data.dataset import Dataset
from elvis.plugins.conversion.arrays import checked_time, host_array
from elvis.plugins.conversion.converting import converted_object

#: MFEM's number, the dimension and the corners of each shape
_SHAPES = {
    "point": (0, 0, 1),
    "line": (1, 1, 2),
    "tri": (2, 2, 3),
    "quad": (3, 2, 4),
    "tet": (4, 3, 4),
    "hex": (5, 3, 8),
    "hexs": (5, 3, 8),
    "wedge": (6, 3, 6),
    "pyramid": (7, 3, 5),
}
_AXES = ("x", "y", "z")
#: whole numbers that floating-point numbers can represent
_LARGEST = 2.0**53
_BASIS = re.compile(r"[A-Za-z0-9_@]+")


def from_blueprint(mesh: Any, *, time: float | None = None) -> Dataset:
    """The dataset of a mesh in Conduit's Mesh Blueprint: ``from_blueprint(node)``.

    mesh  a node of Conduit, or anything with names and values like it, such as nested dictionaries: coordsets,
          topologies, fields, state; or several such domains by name.  Topologies are unstructured, of one shape or
          mixed; ``grid_function`` names the field of their curved map.
    time  time of the data; by default ``state/time``

    Fields with a basis have any order; fields without a basis are linear, or constant in elements.  A vector ``u``
    becomes ``u_x``, ``u_y``, ``u_z``; remarks of the dataset give the measured error.  Raises ElvisError if data are
    missing or invalid.

    >>> coordinates = {"type": "explicit", "values": {"x": [0.0, 1.0, 0.0], "y": [0.0, 0.0, 1.0]}}
    >>> elements = {"shape": "tri", "connectivity": [0, 1, 2]}
    >>> mesh = {"type": "unstructured", "coordset": "coords", "elements": elements}
    >>> u = {"topology": "mesh", "association": "vertex", "values": [0.0, 1.0, 0.0]}
    >>> elvis.from_blueprint({"coordsets": {"coords": coordinates}, "topologies": {"mesh": mesh}, "fields": {"u": u}})
    <Dataset 2D: 1 triangle; fields u of order 1>
    """
    pieces = [_piece(domain) for domain in _domains(mesh)]
    _check_same_fields(pieces)
    source = Mfem.of(pieces)
    source.time = _time(mesh) if time is None else checked_time(time)
    return converted_object(source, "a mesh of Conduit's Blueprint")


def _children(node: Any) -> dict[str, Any]:
    """The children of a node, by name; empty for a value."""
    if isinstance(node, Mapping):
        return {str(name): child for name, child in node.items()}
    names = getattr(node, "child_names", None)
    return {name: node[name] for name in names()} if callable(names) else {}


def _at(node: Any, path: str) -> Any:
    """The node at a path below a node; None if it does not exist."""
    for name in path.split("/"):
        node = _children(node).get(name)
    return node


def _needed(node: Any, path: str, what: str) -> Any:
    found = _at(node, path)
    if found is None:
        names = _shown(", ".join(_children(node)) or "nothing")
        raise ElvisError(f"Blueprint: expected {what} at {_shown(path)}, found {names}")
    return found


def _name_at(node: Any, path: str, what: str) -> str:
    """A name at a path below a node; raises ElvisError for other values, and if it is missing."""
    found = _needed(node, path, what)
    if not isinstance(found, str):
        raise ElvisError(f"Blueprint: expected {what} at {_shown(path)}, found {_shown(found)}")
    return found


def _whole_numbers(name: str, given: Any) -> Ints:
    """(n,) whole numbers of an array; raises ElvisError for others."""
    found = _real_numbers(name, given)
    is_whole = np.isfinite(found) & (found == np.rint(found)) & (np.abs(found) < _LARGEST)
    if not is_whole.all():
        raise _fault(name, f"expected whole numbers, found {_shown(found[~is_whole][0])}")
    return found.astype(np.int64)


def _real_numbers(name: str, given: Any) -> Floats:
    """(n,) numbers of an array; raises ElvisError for others."""
    return np.ravel(host_array(_shown(name), given))


def _fault(place: str, sentence: str) -> ElvisError:
    """An error at a place of the mesh."""
    return ElvisError(f"Blueprint: {_shown(place)}: {sentence}")


def _shown(value: Any) -> str:
    """A value for a message: on one line, and shortened."""
    return one_line(f"{value!s:.60}")


def _domains(mesh: Any) -> list[Any]:
    """The mesh, or its domains; raises ElvisError if there is neither."""
    if "topologies" in _children(mesh):
        return [mesh]
    found = [child for child in _children(mesh).values() if "topologies" in _children(child)]
    if not found:
        named = _shown(", ".join(_children(mesh)) or type(mesh).__name__)
        raise ElvisError(f"expected a mesh of Conduit's Blueprint with coordsets and topologies, found {named}")
    return found


def _check_same_fields(pieces: Sequence[Piece]) -> None:
    """Raise ElvisError where a domain has other fields than the first one."""
    expected = sorted(pieces[0].functions)
    for number, piece in enumerate(pieces[1:], 2):
        found = sorted(piece.functions)
        if found != expected:
            one, other = (_shown(", ".join(own) or "none") for own in (expected, found))
            raise ElvisError(f"Blueprint: domain {number}: expected the fields {one} as in the first, found {other}")


def _time(mesh: Any) -> float | None:
    found = _at(_domains(mesh)[0], "state/time")
    if found is None:
        return None
    numbers = _real_numbers("state/time", found)
    if len(numbers) != 1 or not np.isfinite(numbers[0]):
        raise ElvisError(f"Blueprint: state/time: expected a finite number, found {_shown(found)}")
    return float(numbers[0])


def _piece(domain: Any) -> Piece:
    """A domain as texts of MFEM."""
    name = _main_topology(domain)
    topology = _at(domain, f"topologies/{name}")
    dimension = max((_SHAPES[shape][1] for shape, _ in _elements(topology, name)), default=0)
    points = _coordinates(domain, topology)
    has_nodes = _at(topology, "grid_function") is not None
    nodes = _name_at(topology, "grid_function", "the name of a field") if has_nodes else None
    text = _mesh_text(domain, name, dimension, points, nodes)
    functions = {}
    for field in _children(_at(domain, "fields")):
        if field != nodes and not field.endswith("_attribute") and _topology_of(domain, field) == name:
            own = _field_text(domain, field, dimension)
            functions[field] = Source(Path(field), own, False)
    return Piece(Source(Path("Blueprint"), text, False), functions)


def _topology_of(domain: Any, field: str) -> str | None:
    """The name of the topology of a field; None if it is not a name."""
    found = _at(_at(domain, "fields"), f"{field}/topology") if "/" not in field else None
    return found if isinstance(found, str) else None


def _main_topology(domain: Any) -> str:
    """The first topology that is not a boundary of another."""
    topologies = _children(_at(domain, "topologies"))
    boundaries = [_at(own, "boundary_topology") for own in topologies.values()]
    names = {own for own in boundaries if isinstance(own, str)}
    found = [name for name in topologies if name not in names and "/" not in name]
    if not found:
        raise ElvisError("Blueprint: expected a topology, found none")
    kind = _name_at(domain, f"topologies/{found[0]}/type", "unstructured")
    if kind != "unstructured":
        name = _shown(found[0])
        raise _fault(f"topology {name}", f"expected the type unstructured, found {_shown(kind)}")
    return found[0]


def _elements(topology: Any, name: str) -> Iterator[tuple[str, Ints]]:
    """Shape and vertices of each element, in order; raises ElvisError for unknown shapes and incomplete elements."""
    given = _needed(topology, "elements/connectivity", "vertices of elements")
    vertices = _whole_numbers(f"{name}: connectivity", given)
    shape = _name_at(topology, "elements/shape", "a shape")
    if shape == "mixed":
        numbers = _children(_at(topology, "elements/shape_map"))
        shapes = {int(kind): each for each, own in numbers.items() for kind in _whole_numbers("shape_map", own)}
        kinds = _whole_numbers("shapes", _needed(topology, "elements/shapes", "the shapes of elements"))
        labels = [shapes.get(kind, str(kind)) for kind in kinds.tolist()]
    else:
        corners = _SHAPES.get(shape, (0, 0, 1))[2]
        if len(vertices) % corners:
            expected = f"expected {corners} for each {shape}"
            raise _fault(f"topology {name}", f"connectivity: {expected}, found {len(vertices)} in all")
        labels = [shape] * (len(vertices) // corners)
    for label in sorted(set(labels)):
        if label not in _SHAPES:
            raise _fault(f"topology {name}", f"expected shapes {', '.join(_SHAPES)}, mixed; found {_shown(label)}")
    ends = np.cumsum([0, *(_SHAPES[label][2] for label in labels)])
    if ends[-1] != len(vertices):
        raise _fault(f"topology {name}", f"expected {ends[-1]} vertices of elements, found {len(vertices)}")
    return ((label, vertices[a:b]) for label, a, b in zip(labels, ends[:-1], ends[1:], strict=True))


def _coordinates(domain: Any, topology: Any) -> Floats:
    """(n, 2) or (n, 3) places of vertices."""
    name = _name_at(topology, "coordset", "the name of a coordset")
    values = _children(_needed(domain, f"coordsets/{name}/values", "places of vertices"))
    return _components(f"coordset {name}", [(axis, values[axis]) for axis in _AXES if axis in values])


def _components(name: str, parts: Sequence[tuple[str, Any]]) -> Floats:
    """(n, c) numbers of arrays of one length; raises ElvisError if there are none, or lengths differ."""
    found = [_real_numbers(f"{name}: {own}", values) for own, values in parts]
    lengths = {len(own) for own in found}
    if len(lengths) != 1:
        raise _fault(f"{name}", f"expected components of one length, found {sorted(lengths) or 'none'}")
    return np.stack(found, axis=1)


def _mesh_text(domain: Any, name: str, dimension: int, points: Floats, nodes: str | None) -> str:
    """The mesh as MFEM writes it."""
    topology = _at(domain, f"topologies/{name}")
    has_border = _at(topology, "boundary_topology") is not None
    border = _name_at(topology, "boundary_topology", "the name of a topology") if has_border else None
    lines = ["MFEM mesh v1.0", "", "dimension", str(dimension), "", "elements", *_element_lines(domain, name)]
    outer = _element_lines(domain, border) if border is not None else ["0"]
    lines += ["", "boundary", *outer, "", "vertices", str(len(points))]
    if nodes is None:
        rows = (" ".join(map(repr, row)) for row in points.tolist())
        return "\n".join([*lines, str(points.shape[1]), *rows, ""])
    if _at(domain, f"fields/{nodes}") is None:
        raise _fault(f"topology {name}", f"expected its grid function {nodes} among the fields, found none")
    return "\n".join([*lines, "", "nodes", _field_text(domain, nodes, dimension)])


def _element_lines(domain: Any, name: str) -> list[str]:
    """The number of elements of a topology, then attribute, shape and vertices of each."""
    elements = list(_elements(_needed(domain, f"topologies/{name}", "a topology"), name))
    given = _at(domain, f"fields/{name}_attribute/values")
    attributes = np.ones(len(elements), np.int64)
    if given is not None:
        attributes = _whole_numbers(f"{name}_attribute", given)
    if len(attributes) != len(elements):
        raise _fault(f"{name}_attribute", f"expected {len(elements)} numbers, one an element, found {len(attributes)}")
    rows = zip(attributes.tolist(), elements, strict=True)
    return [str(len(elements)), *(f"{a} {_SHAPES[shape][0]} {' '.join(map(str, own))}" for a, (shape, own) in rows)]


def _field_text(domain: Any, name: str, dimension: int) -> str:
    """A field as MFEM writes it: its space, then the values, one component after the other."""
    field = _children(_at(domain, "fields"))[name]
    values = _needed(field, "values", "values")
    parts = list(_children(values).items()) or [("values", values)]
    components = _components(f"field {name}", parts)
    basis = _at(field, "basis")
    if basis is None:
        association = _name_at(field, "association", "vertex or element")
        known = {"vertex": f"H1_{dimension}D_P1", "element": f"L2_{dimension}D_P0"}
        if association not in known:
            raise _fault(f"field {name}", f"expected the association vertex or element, found {_shown(association)}")
        basis = known[association]
    if not _BASIS.fullmatch(str(basis)):
        raise _fault(f"field {name}", f"expected a basis such as H1_3D_P2, found {_shown(basis)!r}")
    head = [
        "FiniteElementSpace",
        f"FiniteElementCollection: {basis}",
        f"VDim: {components.shape[1]}",
        "Ordering: 0",
        "",
    ]
    return "\n".join([*head, *map(repr, components.T.ravel().tolist()), ""])
