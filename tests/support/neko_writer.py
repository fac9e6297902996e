"""VTKHDF files as Neko writes them (vtkhdf_file.F90): Gauss-Lobatto nodes, values in virtual arrays."""

import h5py
import numpy as np
from h5py import h5d, h5p, h5s, h5t

from elvis.core.polynomials.quadrature import lobatto

#: corners of a square around, as Neko and VTK number them
AROUND = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}


def _position(node, count):
    """Where a node (i, j, k) of ``count`` a line stands in the list of VTK."""
    inner = count - 2
    i, j, k = node
    is_end = [index in (0, count - 1) for index in node]
    end = [int(index > 0) for index in node]
    if all(is_end):
        return AROUND[end[0], end[1]] + 4 * end[2]
    if sum(is_end) == 2:
        if not is_end[0]:
            return 8 + i - 1 + inner * (2 * end[1] + 4 * end[2])
        if not is_end[1]:
            return 8 + j - 1 + inner * ((1 if end[0] else 3) + 4 * end[2])
        return 8 + k - 1 + inner * (8 + AROUND[end[0], end[1]])
    faces = 8 + 12 * inner
    if is_end[0]:
        return faces + j - 1 + inner * (k - 1) + inner**2 * end[0]
    if is_end[1]:
        return faces + i - 1 + inner * (k - 1) + inner**2 * (2 + end[1])
    if is_end[2]:
        return faces + i - 1 + inner * (j - 1) + inner**2 * (4 + end[2])
    return faces + 6 * inner**2 + i - 1 + inner * (j - 1 + inner * (k - 1))


def vtk_order(count):
    """(count^3,) the nodes of a hexahedron, the first direction the fastest, in the order of VTK."""
    order = np.zeros(count**3, int)
    for number in range(count**3):
        node = (number % count, number // count % count, number // count**2)
        order[_position(node, count)] = number
    return order


def write_neko(path, count, steps, bend, fields):
    """Four elements in a row, two of each of two processes, with ``count`` nodes a line.

    fields  functions of points (n, 3) and the number of a step, by name
    """
    line = (lobatto(count)[0] + 1) / 2
    k, j, i = np.meshgrid(line, line, line, indexing="ij")
    unit = np.stack([i, j, k], axis=-1).reshape(-1, 3)
    points = np.concatenate([bend(unit + np.array([element, 0, 0])) for element in range(4)])
    size = count**3
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 6], "i4")
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        root["NumberOfPoints"] = np.full(2 * steps, 2 * size)
        root["NumberOfCells"] = np.full(2 * steps, 2)
        root["NumberOfConnectivityIds"] = np.full(2 * steps, 2 * size)
        root["Points"] = points
        cells = np.concatenate([vtk_order(count), size + vtk_order(count)])
        root["Connectivity"] = np.concatenate([cells, cells]).astype("i4")
        root["Offsets"] = np.tile([0, size, 2 * size], 2).astype("i4")
        root["Types"] = np.full(4, 72, "u1")
        group = root.create_group("Steps")
        group.attrs["NSteps"] = np.int32(steps)
        group["Values"] = 0.5 * np.arange(steps)
        group["NumberOfParts"] = np.full(steps, 2)
        for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            group[name] = np.zeros(steps, int)
        root.create_group("PointData")
        for name, function in fields.items():
            group[f"PointDataOffsets/{name}"] = len(points) * np.arange(steps)
            add_virtual(root["PointData"], name, np.shape(function(points, 0)), steps, f"{path.stem}.data/%b.h5")
    path.with_suffix(".data").mkdir()
    for step in range(steps):
        with h5py.File(path.with_suffix(".data") / f"{step}.h5", "w") as file:
            for name, function in fields.items():
                file[name] = function(points, step)
    return path


def add_virtual(group, name, shape, steps, pattern):
    """An array of all steps, whose blocks of rows lie in files by a pattern."""
    ones = (1,) * (len(shape) - 1)
    source = h5s.create_simple(shape)
    source.select_all()
    space = h5s.create_simple((steps * shape[0], *shape[1:]), (h5s.UNLIMITED, *shape[1:]))
    space.select_hyperslab((0,) * len(shape), (h5s.UNLIMITED, *ones), stride=shape, block=shape)
    layout = h5p.create(h5p.DATASET_CREATE)
    layout.set_virtual(space, pattern.encode(), name.encode(), source)
    h5d.create(group.id, name.encode(), h5t.IEEE_F64LE, space, layout)
