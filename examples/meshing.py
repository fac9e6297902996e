"""Meshes of tetrahedra by Gmsh, as datasets: the same call gives the same mesh."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from elvis import Dataset, Shape
from elvis.converters.gmsh.gmsh import Gmsh
from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.geometry import GeometryBlock
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.testing import one_element
from elvis.core.validity.validity import ValidityStatus, validity
from elvis.plugins.conversion.converting import convert

#: names of sides, and whether a surface of the model belongs to one, by its box (2, 3)
Sides = Mapping[str, Callable[[Floats], bool]]
#: moves points (n, 3) as far as a strength (n,) from 0 to 1 says
Warp = Callable[[Floats, Floats], Floats]

#: looks at a mesh whose nodes are moved, and how far around a bad element they are moved less
_ROUNDS = 20
_AROUND = 0.04


@contextmanager
def session() -> Iterator[Any]:
    """Gmsh with nothing in it, silent, on one thread, so that results do not depend on the machine's load."""
    import gmsh

    gmsh.initialize(["elvis"], readConfigFiles=False, interruptible=False)
    try:
        for name, value in (("Terminal", 0), ("NumThreads", 1), ("AbortOnError", 2)):
            gmsh.option.setNumber(f"General.{name}", value)
        gmsh.option.setNumber("Mesh.RandomSeed", 1)
        for switch in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{switch}", 0)
        gmsh.model.add("case")
        yield gmsh
    finally:
        gmsh.finalize()


def name_sides(gmsh: Any, sides: Sides) -> None:
    """Make a physical group of the volumes, and one of the surfaces for each name; the first that takes one has it."""
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="volume")
    members: dict[str, list[int]] = {name: [] for name in sides}
    for _, tag in gmsh.model.getEntities(2):
        box = np.array(gmsh.model.getBoundingBox(2, tag)).reshape(2, 3)
        members[next(name for name, takes in sides.items() if takes(box))].append(tag)
    for name, tags in members.items():
        if tags:
            gmsh.model.addPhysicalGroup(2, tags, name=name)


def size_field(gmsh: Any, boxes: Sequence[tuple[float, float, Floats]], coarse: float) -> None:
    """Elements of ``size`` within a ``box`` (2, 3), growing over ``thickness`` around it to ``coarse`` far away."""
    tags = []
    for size, thickness, box in boxes:
        tag = gmsh.model.mesh.field.add("Box")
        names = ("XMin", "YMin", "ZMin", "XMax", "YMax", "ZMax")
        values = [size, coarse, thickness, *box.reshape(-1)]
        for name, value in zip(("VIn", "VOut", "Thickness", *names), values, strict=True):
            gmsh.model.mesh.field.setNumber(tag, name, float(value))
        tags.append(tag)
    set_sizes(gmsh, tags)


def size_near(
    gmsh: Any, curves: Sequence[int], surfaces: Sequence[int], near: tuple[float, float, float, float]
) -> int:
    """A size field: near = (size at the curves and surfaces, size far, distance where growth begins, where it ends)."""
    distance = gmsh.model.mesh.field.add("Distance")
    gmsh.model.mesh.field.setNumbers(distance, "CurvesList", list(curves))
    gmsh.model.mesh.field.setNumbers(distance, "SurfacesList", list(surfaces))
    gmsh.model.mesh.field.setNumber(distance, "Sampling", 100)
    tag = gmsh.model.mesh.field.add("Threshold")
    gmsh.model.mesh.field.setNumber(tag, "InField", distance)
    for name, value in zip(("SizeMin", "SizeMax", "DistMin", "DistMax"), near, strict=True):
        gmsh.model.mesh.field.setNumber(tag, name, value)
    return int(tag)


def set_sizes(gmsh: Any, fields: Sequence[int]) -> None:
    """Take the minimum of some size fields everywhere."""
    least = gmsh.model.mesh.field.add("Min")
    gmsh.model.mesh.field.setNumbers(least, "FieldsList", list(fields))
    gmsh.model.mesh.field.setAsBackgroundMesh(least)


def meshed(gmsh: Any, order: int = 1, warp: Warp | None = None) -> Dataset:
    """Mesh the model with elements of an order, all nodes moved by ``warp``, and convert what comes out."""
    gmsh.model.mesh.generate(3)
    if order > 1:
        gmsh.model.mesh.setOrder(order)
        _move_nodes(gmsh, warp)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.msh"
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(path))
        return convert(Gmsh([path])).dataset


def _move_nodes(gmsh: Any, warp: Warp | None) -> None:
    """Make all elements valid, which is proved, and move all nodes by ``warp``.

    Elements that the curved boundary folds over become straight.  Around those that ``warp`` would fold over it is
    weaker.  (Gmsh's own optimization gives another mesh each time.)
    """
    tags, places, _ = gmsh.model.mesh.getNodes()
    tetrahedra = _Tetrahedra(gmsh, tags)
    places = places.reshape(-1, 3)
    for _ in range(_ROUNDS):
        bad = tetrahedra.folded(places)
        if not len(bad):
            break
        places[bad] = tetrahedra.straight @ places[bad[:, :4]]

    moved, strength = places, np.ones(len(places))
    for _ in range(_ROUNDS):
        if warp is None:
            break
        moved = warp(places, strength)
        bad = tetrahedra.folded(moved)
        if not len(bad):
            break
        for centre in places[bad].mean(axis=1):
            strength *= 1 - np.exp(-((places - centre) ** 2).sum(axis=1) / _AROUND**2)
    for tag, place in zip(tags, moved, strict=True):
        gmsh.model.mesh.setNode(tag, place, [])


class _Tetrahedra:
    """The elements of a model, and which of them are valid for given nodes."""

    def __init__(self, gmsh: Any, tags: Ints) -> None:
        (kind,), _, (nodes,) = gmsh.model.mesh.getElements(3)
        _, _, degree, count, local, _ = gmsh.model.mesh.getElementProperties(kind)
        points = np.asarray(local).reshape(-1, 3)
        row = np.zeros(int(tags.max()) + 1, np.int64)
        row[tags] = np.arange(len(tags))
        self._nodes = row[nodes.reshape(-1, count)]
        self._expansion = modified(Shape.TETRAHEDRON, (degree + 1,) * 3)
        self._modes = values(self._expansion, 2 * points - 1)
        #: (nodes, 4) parts of the vertices in each node of a straight element
        self.straight = np.column_stack([1 - points.sum(axis=1), points])

    def folded(self, places: Floats) -> Ints:
        """(k, nodes) rows of the nodes of elements whose Jacobian is not positive for certain."""
        coefficients = np.linalg.solve(self._modes, places[self._nodes]).transpose(0, 2, 1)
        block = GeometryBlock(
            self._expansion, np.arange(len(self._nodes)), np.ascontiguousarray(coefficients, np.float64)
        )
        found = validity(Dataset(one_element(Shape.TETRAHEDRON)), [block])
        return np.asarray(self._nodes[found.status != ValidityStatus.POSITIVE])
