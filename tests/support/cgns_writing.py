"""A writer of CGNS files for tests, after the documentation of both containers, and meshes of a cube for it.

A node is a tuple (name, label, data, children).  Data are None, a text, or an array with its first index the first of
the standard: files hold it transposed.
"""

from itertools import pairwise

import h5py
import numpy as np

KINDS = {"int32": "I4", "int64": "I8", "float32": "R4", "float64": "R8"}


def node(name, label, data=None, *children):
    return (name, label, data, list(children))


def laid_out(data):
    """The type of data, and the array as files hold it."""
    if data is None:
        return "MT", None
    if isinstance(data, str):
        return "C1", np.frombuffer(data.encode(), np.int8)
    if isinstance(data, list) and data and isinstance(data[0], str):
        return "C1", np.array([list(text.ljust(32).encode()) for text in data], np.int8)
    array = np.ascontiguousarray(np.asarray(data).T)
    return KINDS[str(array.dtype)], array


def write_hdf5(path, tree, version):
    """Mapping of CGNS to HDF5: a group for each node, with its label and type as attributes, and a dataset."""
    with h5py.File(path, "w", libver=("earliest", "v108")) as file:
        for each in (node("CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([version], np.float32)), *tree):
            put_group(file, each)
    return path


def put_group(parent, each):
    name, label, data, children = each
    group = parent.create_group(name)
    kind, array = laid_out(data)
    for key, value, size in (("name", name, 33), ("label", label, 33), ("type", kind, 3)):
        group.attrs.create(key, np.array(value.encode(), dtype=f"S{size}"))
    if array is not None:
        group.create_dataset(" data", data=array)
    for child in children:
        put_group(group, child)


def write_adf(path, tree, version, is_text=True, order=">"):
    """The older container: comments in ADF_internals.c of the CGNS library; numbers are text in version A alone."""
    content = bytearray(266)

    def number(value, size):
        raw = int(value)
        return b"%0*X" % (size, raw) if is_text else raw.to_bytes(size, "big" if order == ">" else "little")

    def pointer(place):
        return number(place // 4096, 8) + number(place % 4096, 4)

    def chunk(start, body, end):
        place = len(content)
        content.extend(start + pointer(place + 16 + len(body)) + body + end)
        return place

    def put(each, place=None):
        name, label, data, children = each
        kind, array = laid_out(data)
        shape = () if array is None else array.shape[::-1]
        if place is None:
            place = len(content)
            content.extend(bytes(246))
        stored = 0
        if array is not None:
            raw = array.astype(array.dtype.newbyteorder(order)).tobytes()
            stored = chunk(b"DaTa", raw, b"dEnD")
        table = 0
        if children:
            entries = [(child[0], put(child)) for child in children]
            body = b"".join(own.ljust(32).encode() + pointer(at) for own, at in entries)
            table = chunk(b"SNTb", body, b"snTE")
        head = b"NoDe" + name.ljust(32).encode() + label.ljust(32).encode()
        head += b"%08X%08X" % (len(children), len(children)) + pointer(table) + kind.ljust(32).encode()
        head += b"%02X" % len(shape) + b"".join(number(n, 8) for n in (*shape, *[0] * (12 - len(shape))))
        head += b"%04X" % (array is not None) + pointer(stored) + b"TaiL"
        content[place : place + 246] = head
        return place

    library = node("CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([version], np.float32))
    content.extend(bytes(246))
    put(node("ADF MotherNode", "Root Node of ADF File", None, library, *tree), 266)
    letter = "A" if is_text else "B"
    header = (
        f"@(#)ADF Database Version {letter}02011>".ljust(32).encode()
        + b"AdF0"
        + b" " * 28
        + b"AdF1"
        + b" " * 28
        + b"AdF2"
    )
    header += (b"BL" if order == ">" else b"LL") + b"AdF3" + b"010204080408080808080808" + b"AdF4"
    header += pointer(266) + pointer(len(content)) + pointer(186) + pointer(0) + b"AdF5"
    content[: len(header)] = header
    path.write_bytes(content)
    return path


def base(*children, dimension=3, physical=None, name="Base"):
    sizes = np.array([dimension, physical or dimension], np.int32)
    return node(name, "CGNSBase_t", sizes, *children)


def coordinates(points, name="GridCoordinates", rind=None):
    """points (…, d): an index for each direction of the zone, then the coordinate."""
    arrays = [
        node(f"Coordinate{axis}", "DataArray_t", points[..., i])
        for i, axis in zip(range(points.shape[-1]), "XYZ", strict=False)
    ]
    return node(name, "GridCoordinates_t", None, *rinds(rind), *arrays)


def rinds(planes):
    return [] if planes is None else [node("Rind", "Rind_t", np.array(planes, np.int32))]


def structured(name, points, *children, rind=None, integer=np.int32):
    """points (…, d), those of rind planes among them."""
    planes = np.zeros(2 * (points.ndim - 1), int) if rind is None else np.array(rind)
    vertices = np.array(points.shape[:-1]) - planes[::2] - planes[1::2]
    sizes = np.stack([vertices, vertices - 1, 0 * vertices], axis=1).astype(integer)
    grid = coordinates(points, rind=rind)
    return node(name, "Zone_t", sizes, node("ZoneType", "ZoneType_t", "Structured"), grid, *children)


def unstructured(name, points, cells, *children, integer=np.int32):
    sizes = np.array([[len(points), cells, 0]], integer)
    grid = coordinates(points)
    return node(name, "Zone_t", sizes, node("ZoneType", "ZoneType_t", "Unstructured"), grid, *children)


def section(name, number, first, table, integer=np.int32):
    """Elements of one type, ``table`` (n, k) of vertices from 0."""
    ends = np.array([first, first + len(table) - 1], integer)
    return elements(name, number, ends, (np.asarray(table) + 1).astype(integer).reshape(-1))


def mixed(name, first, parts, has_offsets, integer=np.int32):
    """Elements of several types: ``parts`` of number and table, one after another."""
    flat, starts = [], [0]
    for number, table in parts:
        for row in table:
            flat += [number, *(np.asarray(row) + 1)]
            starts.append(len(flat))
    ends = np.array([first, first + len(starts) - 2], integer)
    more = [node("ElementStartOffset", "DataArray_t", np.array(starts, integer))] if has_offsets else []
    return elements(name, 20, ends, np.array(flat, integer), *more)


def elements(name, number, ends, flat, *more):
    return node(
        name,
        "Elements_t",
        np.array([number, 0], np.int32),
        node("ElementRange", "IndexRange_t", ends),
        node("ElementConnectivity", "DataArray_t", flat),
        *more,
    )


def conditions(*each):
    return node("ZoneBC", "ZoneBC_t", None, *each)


def condition(name, how, points, location=None, family=None, *more):
    """how: PointRange, PointList, ElementRange or ElementList; ``points`` (n, d) from 1."""
    points = np.asarray(points)
    data = points.reshape(-1) if how.startswith("Element") else points.T
    label = "IndexRange_t" if how.endswith("Range") else "IndexArray_t"
    children = [node(how, label, data.astype(np.int32)), *more]
    children += [node("GridLocation", "GridLocation_t", location)] if location else []
    children += [node("FamilyName", "FamilyName_t", family)] if family else []
    return node(name, "BC_t", "FamilySpecified" if family else "BCWall", *children)


def solution(name, location, arrays, rind=None, *more):
    own = [node("GridLocation", "GridLocation_t", location)] if location else []
    values = [node(key, "DataArray_t", value) for key, value in arrays.items()]
    return node(name, "FlowSolution_t", None, *own, *rinds(rind), *more, *values)


def grid(*sizes, low=0.0, high=1.0):
    """(…, d) vertices of an even grid of a box, so many along each direction."""
    low, high = (np.broadcast_to(end, len(sizes)) for end in (low, high))
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, sizes, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


#: elements that fill the unit square or cube, as corners on it, in the order of the standard
SQUARE = {
    "quadrilateral": [[(0, 0), (1, 0), (1, 1), (0, 1)]],
    "triangle": [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]],
}
_BOTTOM = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
_TOP = [(x, y, 1) for x, y, _ in _BOTTOM]
_MIDDLE = (0.5, 0.5, 0.5)
_AROUND = [(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1), (1, 0, 0)]
CUBE = {
    "hexahedron": [_BOTTOM + _TOP],
    "prism": [[*(p[i] for i in t), *(q[i] for i in t)] for p, q in [(_BOTTOM, _TOP)] for t in [(0, 1, 2), (0, 2, 3)]],
    "pyramid": [
        [*(corners[i] for i in face), _MIDDLE]
        for corners in [_BOTTOM + _TOP]
        for face in [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    ],
    "tetrahedron": [[(0, 0, 0), a, b, (1, 1, 1)] for a, b in pairwise(_AROUND)],
}
