"""Small files of Trixi.jl, after its documentation: meshes of all kinds, and solutions of functions of places."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.polynomial import legendre

#: a function of the level and the lower corner (a share of the whole) of a cell that tells whether it is refined
Refine = Callable[[int, Any], bool]


def lobatto_line(order: int) -> Any:
    """The Gauss-Lobatto nodes of [-1, 1]: the ends, and where the derivative of P_order vanishes."""
    if order == 0:
        return np.zeros(1)
    inner = legendre.legroots(legendre.legder([0] * order + [1])) if order > 1 else []
    return np.array([-1.0, *np.sort(np.real(inner)), 1.0])


def reference_nodes(line: Any, dimension: int) -> Any:
    """(m^d, d) nodes, the first direction fastest."""
    return np.array(list(product(line, repeat=dimension)))[:, ::-1]


def write_solution(
    path: Path,
    mesh: Path,
    kind: str,
    places: Any,
    functions: Mapping[str, Callable[[Any], Any]],
    order: int,
    constants: Mapping[str, Any] | None = None,
    at_nodes: Mapping[str, Any] | None = None,
    time: float = 0.25,
) -> Path:
    """A solution whose variables are functions of places (n, m^d, d), the nodes of its elements."""
    with h5py.File(path, "w") as file:
        head = {"ndims": places.shape[2], "equations": "E", "polydeg": order, "n_vars": len(functions)}
        head |= {"n_elements": len(places), "mesh_type": kind, "mesh_file": mesh.name, "time": time, "timestep": 5}
        for name, value in head.items():
            file.attrs[name] = value
        arrays = [(f"variables_{i + 1}", name, f(places).reshape(-1)) for i, (name, f) in enumerate(functions.items())]
        arrays += [(f"element_variables_{i + 1}", *each) for i, each in enumerate((constants or {}).items())]
        arrays += [(f"node_variables_{i + 1}", *each) for i, each in enumerate((at_nodes or {}).items())]
        for place, name, values in arrays:
            file[place] = values
            file[place].attrs["name"] = name
    return path


def tree_leaves(refine: Refine, dimension: int) -> list[tuple[int, tuple[int, ...]]]:
    """Levels and corners, counted in cells of the level, of the leaves of a tree in Morton order."""

    def below(level: int, corner: tuple[int, ...]) -> list[tuple[int, tuple[int, ...]]]:
        if not refine(level, np.array(corner) / 2**level):
            return [(level, corner)]
        own = [tuple(2 * c + o for c, o in zip(corner, offset[::-1], strict=True)) for offset in offsets]
        return [leaf for child in own for leaf in below(level + 1, child)]

    offsets = list(product((0, 1), repeat=dimension))
    return below(0, (0,) * dimension)


def write_tree_mesh(
    path: Path, refine: Refine, dimension: int, centre: Sequence[float], length: float, periodic: Sequence[bool]
) -> Any:
    """A TreeMesh; places (n, 2, d) of two opposite corners of its leaves, in the order of the file."""
    cells: list[tuple[int, tuple[int, ...]]] = [(0, (0,) * dimension)]
    offsets = [offset[::-1] for offset in product((0, 1), repeat=dimension)]
    children: dict[int, list[int]] = {}
    parents = {0: 0}
    for number, (level, corner) in enumerate(cells):  # cells grow while they are passed through
        if refine(level, np.array(corner) / 2**level):
            children[number] = list(range(len(cells), len(cells) + 2**dimension))
            cells += [(level + 1, tuple(2 * c + o for c, o in zip(corner, own, strict=True))) for own in offsets]
            parents |= dict.fromkeys(children[number], number + 1)
    numbers = {cell: number for number, cell in enumerate(cells)}
    neighbours = np.zeros((len(cells), 2 * dimension), int)
    for number, (level, corner) in enumerate(cells):
        for axis, end in product(range(dimension), (0, 1)):
            beside = list(corner)
            beside[axis] += 2 * end - 1
            if periodic[axis]:
                beside[axis] %= 2**level
            neighbours[number, 2 * axis + end] = numbers.get((level, tuple(beside)), -1) + 1
    levels = np.array([level for level, _ in cells])
    corners = np.array([corner for _, corner in cells])
    sizes = length / 2.0**levels
    low = np.array(centre) - length / 2 + corners * sizes[:, None]
    leaves = [number for number in range(len(cells)) if number not in children]
    with h5py.File(path, "w") as file:
        head = {"mesh_type": "TreeMesh", "ndims": dimension, "n_cells": len(cells), "n_leaf_cells": len(leaves)}
        head |= {"center_level_0": np.array(centre, float), "length_level_0": float(length)}
        head |= {"periodicity": np.array(periodic)}
        for name, value in head.items():
            file.attrs[name] = value
        file["parent_ids"] = [parents[number] for number in range(len(cells))]
        none = [-1] * 2**dimension
        file["child_ids"] = 1 + np.array([children.get(number, none) for number in range(len(cells))])
        file["neighbor_ids"], file["levels"] = neighbours, levels
        file["coordinates"] = low + sizes[:, None] / 2
    return np.stack([low[leaves], (low + sizes[:, None])[leaves]], axis=1)


def write_structured_mesh(path: Path, size: Sequence[int], mapping: str, periodic: Sequence[bool]) -> None:
    """A StructuredMesh, whose mapping is a text."""
    with h5py.File(path, "w") as file:
        head = {"mesh_type": "StructuredMesh", "ndims": len(size), "size": np.array(size)}
        for name, value in (head | {"mapping": mapping, "periodicity": np.array(periodic)}).items():
            file.attrs[name] = value


class Brick:
    """Trees in a box of unit cubes that a function bends, each refined as a function of its number tells.

    names  of the sides x_neg, ..., empty (``---``) in periodic directions
    """

    def __init__(
        self,
        size: Sequence[int],
        bend: Callable[[Any], Any],
        order: int,
        refine: Callable[[int], Refine],
        periodic: Sequence[bool] | None = None,
    ) -> None:
        self.size, self.dimension, self.order = tuple(size), len(size), order
        self.periodic = periodic or (False,) * len(size)
        self.bend, self.line = bend, lobatto_line(order)
        self.corners = [corner[::-1] for corner in product(*(range(n) for n in self.size[::-1]))]
        inside = (reference_nodes(self.line, self.dimension) + 1) / 2
        self.places = np.array([bend(corner + inside) for corner in self.corners])
        self.leaves = [tree_leaves(refine(tree), self.dimension) for tree in range(len(self.corners))]

    def nodes(self, order: int) -> Any:
        """(n, m^d, d) places of the nodes of a solution on the leaves."""
        inside = (reference_nodes(lobatto_line(order), self.dimension) + 1) / 2
        return np.array([
            self.bend(corner + (np.array(own) + inside) / 2**level)
            for corner, leaves in zip(self.corners, self.leaves, strict=True)
            for level, own in leaves
        ])  # fmt: skip

    def sides(self) -> tuple[Any, Any, Any]:
        """Of each tree: neighbours and their sides, own number and side on the outline, and the names of sides."""
        numbers = {corner: tree for tree, corner in enumerate(self.corners)}
        trees, faces, names = (np.empty((len(numbers), 2 * self.dimension), kind) for kind in (int, int, object))
        for corner, tree in numbers.items():
            for axis, end in product(range(self.dimension), (0, 1)):
                beside = list(corner)
                beside[axis] += 2 * end - 1
                if self.periodic[axis]:
                    beside[axis] %= self.size[axis]
                side = 2 * axis + end
                other = numbers.get(tuple(beside))
                trees[tree, side] = tree if other is None else other
                faces[tree, side] = side if other is None else 2 * axis + 1 - end
                names[tree, side] = "---" if other is not None else f"{'xyz'[axis]}_{('neg', 'pos')[end]}"
        return trees, faces, names

    def write(self, path: Path, kind: str) -> Path:
        """A P4estMesh, with p4est's file next to, or a T8codeMesh."""
        trees, faces, names = self.sides()
        with h5py.File(path, "w") as file:
            file.attrs["mesh_type"], file.attrs["ndims"] = kind, self.dimension
            shape = (len(self.corners), *(self.order + 1,) * self.dimension, -1)
            file["tree_node_coordinates"], file["nodes"] = self.places.reshape(shape), self.line
            file.create_dataset("boundary_names", data=names, dtype=h5py.string_dtype())
            if kind == "P4estMesh":
                file.attrs["p4est_file"] = "p4est_data"
                path.with_name("p4est_data").write_bytes(self.p4est(trees, faces))
            else:
                self._write_t8code(file, trees, faces)
        return path

    def _write_t8code(self, file: Any, trees: Any, faces: Any) -> None:
        tree, side = np.indices(trees.shape)
        own = (trees > tree) | ((trees == tree) & (faces > side))
        columns = {"treeIDs": tree, "neighIDs": trees, "faces": side, "duals": faces, "orientations": 0 * tree}
        for name, values in columns.items():
            file[name] = values[own]
        levels = [level for leaves in self.leaves for level, _ in leaves]
        file.attrs["ntrees"], file.attrs["nelements"] = len(trees), len(levels)
        file["levels"] = np.array(levels, np.uint8)
        file["num_elements_per_tree"] = [len(leaves) for leaves in self.leaves]

    def p4est(self, trees: Any, faces: Any) -> bytes:
        """The bytes of p4est's file: connectivity without corners, then quadrants."""
        code = {2: 0x2000009, 3: 0x3000009}[self.dimension]
        count = len(trees)
        data = {2: b"p4est", 3: b"p8est"}[self.dimension].ljust(8, b"\0") + b"2.8.6".ljust(24, b"\0")
        data += np.array([code, 4, 0, count, 0, 0, 0, 0, 0, 0], np.uint64).tobytes()
        data += trees.astype(np.int32).tobytes() + faces.astype(np.int8).tobytes()
        if self.dimension == 3:
            data += np.zeros(1, np.int32).tobytes()
        data += np.zeros(1, np.int32).tobytes()
        data += b"\0" * (-len(data) % 32)
        ends = np.cumsum([len(leaves) for leaves in self.leaves])
        data += np.array([code, 4, 24, 0, 0, 1, ends[-1], *ends], np.uint64).tobytes()
        data += b"\0" * (-len(data) % 32)
        rows = [(*(c << (30 - level) for c in own), level) for leaves in self.leaves for level, own in leaves]
        return data + np.array(rows, np.int32).tobytes()


def write_plane_mesh(
    path: Path, order: int, corners: Any, elements: Sequence[tuple[Any, Mapping[int, Any], Any]]
) -> Path:
    """HOHQMesh's file: corners, and elements with four corners from 0, curves by side (m, 2), names of sides."""
    ends = ((0, 1), (1, 2), (2, 3), (3, 0))
    edges: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for number, (own, _, _) in enumerate(elements):
        for side, (a, b) in enumerate(ends):
            edges.setdefault(tuple(sorted((own[a], own[b]))), []).append((number + 1, side + 1))
    lines = ["ISM-V2", f"{len(corners)} {len(edges)} {len(elements)} {order}"]
    lines += [f"{x!r} {y!r}" for x, y in np.asarray(corners, float).tolist()]
    for (a, b), owners in edges.items():
        (one, side), (other, its) = owners if len(owners) == 2 else (*owners, (0, 0))
        lines.append(f"{a + 1} {b + 1} {one} {other} {side} {-its}")
    for own, curves, names in elements:
        lines += [" ".join(str(c + 1) for c in own), " ".join(str(int(side in curves)) for side in range(4))]
        lines += [f"{x!r} {y!r}" for side in range(4) for x, y in np.asarray(curves.get(side, []), float).tolist()]
        lines.append(" ".join(names))
    path.write_text("\n".join(lines) + "\n")
    return path
