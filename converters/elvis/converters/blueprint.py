"""Meshes of Conduit's Blueprint with high orders, as MFEM lays them out: nodes of Conduit, or dictionaries like them.

What MFEM calls a basis, as H1_3D_P2, names its finite element collection, and values are those of all its degrees of
freedom, in the order that follows from the elements (Conduit documentation, Mesh Blueprint; MFEM documentation,
ConduitDataCollection).  So a mesh is written down as MFEM's own text, which its library then evaluates.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.mfem import Mfem
from elvis.converters.mfem_pieces import Piece, Source
from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.plugins.arrays import host_array
from elvis.plugins.converting import converted_object

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
_BASIS = re.compile(r"[A-Za-z0-9_@]+")


def from_blueprint(mesh: Any, *, time: float | None = None) -> Dataset:
    """The dataset of a mesh in Conduit's Mesh Blueprint: ``from_blueprint(node)``.

    mesh  a node of Conduit, or anything with names and values like it, such as nested dictionaries: coordsets,
          topologies, fields, state; or several such domains by name.  Topologies are unstructured, of one shape or
          mixed; ``grid_function`` names the field of their curved map.
    time  of the data; that of ``state/time`` where it is not given

    Fields with a basis have any order; those without are linear, or constant in elements.  A vector ``u`` becomes
    ``u_x``, ``u_y``, ``u_z``; remarks of the dataset tell the measured error.  ElvisError where something is missing,
    or is not what it should be.
    """
    source = Mfem.of([_piece(domain) for domain in _domains(mesh)])
    source.time = _time(mesh) if time is None else time
    return converted_object(source, "a mesh of Conduit's Blueprint")


def _names(node: Any) -> list[str]:
    """What a node holds, by name; nothing where it is a value."""
    if isinstance(node, Mapping):
        return [str(name) for name in node]
    names = getattr(node, "child_names", None)
    return list(names()) if callable(names) else []


def _at(node: Any, path: str) -> Any:
    """What is at a path below a node; None where that is not there."""
    for name in path.split("/"):
        if name not in _names(node):
            return None
        node = node[name]
    return node


def _needed(node: Any, path: str, what: str) -> Any:
    found = _at(node, path)
    if found is None:
        raise ElvisError(f"Blueprint: expected {what} at {path}, found {', '.join(_names(node)) or 'nothing'}")
    return found


def _domains(mesh: Any) -> list[Any]:
    """The mesh, or its domains; ElvisError where there is neither."""
    if "topologies" in _names(mesh):
        return [mesh]
    found = [mesh[name] for name in _names(mesh) if "topologies" in _names(mesh[name])]
    if not found:
        named = ", ".join(_names(mesh)) or type(mesh).__name__
        raise ElvisError(f"expected a mesh of Conduit's Blueprint with coordsets and topologies, found {named:.60}")
    return found


def _time(mesh: Any) -> float | None:
    found = _at(_domains(mesh)[0], "state/time")
    return None if found is None else float(np.ravel(found)[0])


def _piece(domain: Any) -> Piece:
    """A domain as texts of MFEM."""
    name = _main_topology(domain)
    topology = domain["topologies"][name]
    dimension = max((_SHAPES[shape][1] for shape, _ in _elements(topology, name)), default=0)
    points = _coordinates(domain, topology)
    nodes = _at(topology, "grid_function")
    text = _mesh_text(domain, name, dimension, points, None if nodes is None else str(nodes))
    functions = {}
    for field in _names(_at(domain, "fields")):
        if field != nodes and not field.endswith("_attribute") and _at(domain, f"fields/{field}/topology") == name:
            own = _field_text(domain, field, dimension)
            functions[field] = Source(Path(field), own, False)
    return Piece(Source(Path("Blueprint"), text, False), functions)


def _main_topology(domain: Any) -> str:
    """The topology that is no boundary of another."""
    names = _names(domain["topologies"])
    boundaries = {_at(domain, f"topologies/{name}/boundary_topology") for name in names}
    found = [name for name in names if name not in boundaries]
    if not found:
        raise ElvisError("Blueprint: expected a topology, found none")
    kind = _needed(domain, f"topologies/{found[0]}/type", "unstructured")
    if kind != "unstructured":
        raise ElvisError(f"Blueprint: topology {found[0]}: expected the type unstructured, found {kind}")
    return found[0]


def _elements(topology: Any, name: str) -> Iterator[tuple[str, Ints]]:
    """Shape and vertices of each element, in order; ElvisError for shapes that there are not, and loose ends."""
    given = _needed(topology, "elements/connectivity", "vertices of elements")
    vertices: Ints = np.asarray(host_array(f"{name}: connectivity", given), np.int64).ravel()
    shape = str(_needed(topology, "elements/shape", "a shape"))
    if shape == "mixed":
        numbers = _at(topology, "elements/shape_map")
        shapes = {int(np.ravel(numbers[each])[0]): each for each in _names(numbers)}
        kinds = np.ravel(_needed(topology, "elements/shapes", "the shapes of elements")).tolist()
        labels = [shapes.get(int(kind), str(kind)) for kind in kinds]
    else:
        corners = _SHAPES.get(shape, (0, 0, 1))[2]
        if len(vertices) % corners:
            expected = f"expected {corners} for each {shape}"
            raise ElvisError(f"Blueprint: topology {name}: connectivity: {expected}, found {len(vertices)} in all")
        labels = [shape] * (len(vertices) // corners)
    for label in sorted(set(labels)):
        if label not in _SHAPES:
            raise ElvisError(f"Blueprint: topology {name}: expected shapes {', '.join(_SHAPES)}, mixed; found {label}")
    ends = np.cumsum([0, *(_SHAPES[label][2] for label in labels)])
    if ends[-1] != len(vertices):
        raise ElvisError(f"Blueprint: topology {name}: expected {ends[-1]} vertices of elements, found {len(vertices)}")
    return ((label, vertices[a:b]) for label, a, b in zip(labels, ends[:-1], ends[1:], strict=True))


def _coordinates(domain: Any, topology: Any) -> Floats:
    """(n, 2) or (n, 3) places of vertices."""
    name = str(_needed(topology, "coordset", "the name of a coordset"))
    values = _needed(domain, f"coordsets/{name}/values", "places of vertices")
    return _components(f"coordset {name}", [(axis, values[axis]) for axis in _AXES if axis in _names(values)])


def _components(name: str, parts: Sequence[tuple[str, Any]]) -> Floats:
    """(n, c) numbers of arrays of one length; ElvisError where there are none, or lengths differ."""
    found = [np.asarray(host_array(f"{name}: {own}", values), np.float64).ravel() for own, values in parts]
    lengths = {len(own) for own in found}
    if len(lengths) != 1:
        raise ElvisError(f"Blueprint: {name}: expected components of one length, found {sorted(lengths) or 'none'}")
    return np.stack(found, axis=1)


def _mesh_text(domain: Any, name: str, dimension: int, points: Floats, nodes: str | None) -> str:
    """The mesh as MFEM writes it."""
    topology = domain["topologies"][name]
    border = _at(topology, "boundary_topology")
    lines = ["MFEM mesh v1.0", "", "dimension", str(dimension), "", "elements", *_element_lines(domain, name)]
    outer = _element_lines(domain, str(border)) if border is not None else ["0"]
    lines += ["", "boundary", *outer, "", "vertices", str(len(points))]
    if nodes is None:
        rows = (" ".join(map(repr, row)) for row in points.tolist())
        return "\n".join([*lines, str(points.shape[1]), *rows, ""])
    if _at(domain, f"fields/{nodes}") is None:
        raise ElvisError(f"Blueprint: topology {name}: expected its grid function {nodes} among the fields, found none")
    return "\n".join([*lines, "", "nodes", _field_text(domain, nodes, dimension)])


def _element_lines(domain: Any, name: str) -> list[str]:
    """How many elements a topology has, then of each attribute, shape and vertices."""
    elements = list(_elements(_needed(domain, f"topologies/{name}", "a topology"), name))
    given = _at(domain, f"fields/{name}_attribute/values")
    attributes = np.ones(len(elements), np.int64) if given is None else np.ravel(np.asarray(given)).astype(np.int64)
    if len(attributes) != len(elements):
        raise ElvisError(
            f"Blueprint: {name}_attribute: expected {len(elements)} numbers, one an element, found {len(attributes)}"
        )
    rows = zip(attributes.tolist(), elements, strict=True)
    return [str(len(elements)), *(f"{a} {_SHAPES[shape][0]} {' '.join(map(str, own))}" for a, (shape, own) in rows)]


def _field_text(domain: Any, name: str, dimension: int) -> str:
    """A field as MFEM writes it: its space, then the values, one component after the other."""
    field = domain["fields"][name]
    values = _needed(field, "values", "values")
    parts = [(own, values[own]) for own in _names(values)] or [("values", values)]
    components = _components(f"field {name}", parts)
    basis = _at(field, "basis")
    if basis is None:
        association = _needed(field, "association", "vertex or element")
        known = {"vertex": f"H1_{dimension}D_P1", "element": f"L2_{dimension}D_P0"}
        if association not in known:
            raise ElvisError(
                f"Blueprint: field {name}: expected the association vertex or element, found {association}"
            )
        basis = known[association]
    if not _BASIS.fullmatch(str(basis)):
        raise ElvisError(f"Blueprint: field {name}: expected a basis such as H1_3D_P2, found {str(basis)!r:.60}")
    head = [
        "FiniteElementSpace",
        f"FiniteElementCollection: {basis}",
        f"VDim: {components.shape[1]}",
        "Ordering: 0",
        "",
    ]
    return "\n".join([*head, *map(repr, components.T.ravel().tolist()), ""])
