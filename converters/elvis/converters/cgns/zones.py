"""Zones of CGNS files: their vertices and elements, structured and not.

Layout: CGNS Standard Interface Data Structures (SIDS), chapters 6 and 7.  Numbers of vertices and elements count from 1
in files, from 0 here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from elvis.converters.cgns.elements import (
    AMBIGUOUS,
    MIXED,
    NFACE,
    NGON,
    NODE,
    ElementType,
    element_type,
    node_count,
    nodes_of_type,
    sides_of_shape,
)
from elvis.converters.cgns.tree import Node
from elvis.converters.shared.inputs import check_rows
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.base.rows import Rows

#: type of the cells of structured zones, by dimension
_CELLS = {1: 3, 2: 7, 3: 17}

#: versions of the library, times 1000: with pyramids of 13 nodes; with them as type 21; with elements of order 3
_PYRAMIDS = 3000
_REORDERED = 3100
_CUBIC = 3200
_PYRA_5, _PYRA_13, _PYRA_14 = 12, 21, 13

#: cartesian coordinates, and cylindrical ones
_CARTESIAN = ("CoordinateX", "CoordinateY", "CoordinateZ")
_CYLINDRICAL = ("CoordinateR", "CoordinateTheta")
#: types of sides, by their number of corners: BAR_2, TRI_3, QUAD_4
_SIDES = {2: 3, 3: 5, 4: 7}


@dataclass(eq=False)
class Group(Rows):
    """Elements of one type in a section: ``numbers`` (n,) in the zone, ``nodes`` (n, k) vertices."""

    kind: ElementType
    section: str
    numbers: Ints
    nodes: Ints


@dataclass(eq=False)
class Zone:
    """A zone of a base.

    sizes   vertices along each direction of a structured zone; total number of vertices of an unstructured one
    points  (n, 3) or (n, 2) positions of the vertices, the first direction fastest
    cells   elements of the dimension of the base, in the order of their numbers
    others  elements of lower dimension
    notes, warnings  decisions made during reading, and doubts
    """

    node: Node
    dimension: int
    is_structured: bool
    sizes: tuple[int, ...]
    points: Floats
    cells: list[Group] = field(default_factory=list)
    others: list[Group] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Its name in the file."""
        return self.node.name

    @property
    def vertex_count(self) -> int:
        """Number of vertices, without rind planes."""
        return math.prod(self.sizes)

    @property
    def cell_sizes(self) -> tuple[int, ...]:
        """Cells along each direction of a structured zone."""
        return tuple(n - 1 for n in self.sizes)

    @cached_property
    def cell_count(self) -> int:
        """Number of cells."""
        return sum(len(group.numbers) for group in self.cells)


def read_zone(node: Node, dimension: int, physical: int, version: int, coordinates: str) -> Zone:
    """A zone of a base with cells of a dimension, in a space of a dimension.

    version      of the library that wrote the file, times 1000
    coordinates  name of the node with the places of the vertices
    """
    kind = node.child("ZoneType")
    is_structured = kind is None or kind.text() != "Unstructured"
    table = node.ints(3, dimension if is_structured else 1)
    sizes = tuple(table[0].tolist())
    if min(sizes) < 1 or math.prod(sizes) >= 2**62:
        raise FormatError(f"expected vertices in all directions, found {sizes}", place=node.place)
    zone = Zone(node, dimension, is_structured, sizes, np.empty((0, 0)))
    zone.points = _points(zone, node.required(coordinates), physical)
    if is_structured:
        zone.cells = [_structured_cells(zone)]
        return zone
    sections = sorted(node.labelled("Elements_t"), key=lambda each: int(each.required("ElementRange").ints(2)[0]))
    by_parents = [section for section in sections if _is_by_parents(section)]
    direct = [section for section in sections if section not in by_parents]
    for section in direct:
        for group in _groups(section, version, zone):
            (zone.cells if group.kind.shape.dimension == dimension else zone.others).append(group)
    for section in by_parents:
        zone.others += _of_parents(section, zone)
    _check_cells(zone, int(table[1, 0]))
    return zone


def rind_of(node: Node, directions: int) -> list[tuple[int, int]]:
    """Number of rind planes, points or elements before and after the zone, in each direction."""
    rind = node.child("Rind")
    if rind is None:
        return [(0, 0)] * directions
    planes = rind.ints(2 * directions)
    if (planes < 0).any():
        raise FormatError(f"expected no negative numbers of rind planes, found {planes.tolist()}", place=rind.place)
    return [(int(planes[2 * i]), int(planes[2 * i + 1])) for i in range(directions)]


def core_of(node: Node, sizes: Sequence[int], rind: Sequence[tuple[int, int]]) -> Floats:
    """(n,) the numbers of an array over a zone, without rind planes, the first direction fastest."""
    whole = [n + low + high for n, (low, high) in zip(sizes, rind, strict=True)]
    found = node.array()
    flat = found is not None and len(whole) > 1 and found.ndim == 1
    values = node.floats(math.prod(whole)).reshape(whole[::-1]) if flat else node.floats(*whole[::-1])
    inside = tuple(slice(low, low + n) for n, (low, _) in zip(sizes[::-1], rind[::-1], strict=True))
    return np.ascontiguousarray(values[inside]).reshape(-1)


def _points(zone: Zone, grid: Node, physical: int) -> Floats:
    """Places of the vertices; cylindrical coordinates are converted."""
    arrays = {each.name: each for each in grid.labelled("DataArray_t")}
    rind = rind_of(grid, len(zone.sizes))
    if not arrays:
        raise FormatError("expected coordinates, found none", place=grid.place)
    if set(_CYLINDRICAL) <= set(arrays) and "CoordinateX" not in arrays:
        return _cylindrical(zone, arrays, rind)
    names = [name for name in _CARTESIAN[: max(physical, 1)] if name in arrays]
    if names != list(_CARTESIAN[: len(names)]) or not names or len(names) < zone.dimension:
        found = ", ".join(arrays)
        raise FormatError(f"expected coordinates X, Y, Z or R, Theta, Z, found {found[:200]}", place=grid.place)
    return np.stack([core_of(arrays[name], zone.sizes, rind) for name in names], axis=1)


def _cylindrical(zone: Zone, arrays: dict[str, Node], rind: Sequence[tuple[int, int]]) -> Floats:
    """Places of vertices that are given by radius, angle and, in three dimensions, height."""
    radius, angle = (core_of(arrays[name], zone.sizes, rind).astype(np.float64) for name in _CYLINDRICAL)
    units = arrays["CoordinateTheta"].child("DimensionalUnits")
    if units is not None and units.texts()[-1:] == ["Degree"]:
        angle = np.radians(angle)
    columns = [radius * np.cos(angle), radius * np.sin(angle)]
    if "CoordinateZ" in arrays:
        columns.append(core_of(arrays["CoordinateZ"], zone.sizes, rind).astype(np.float64))
    zone.notes.append("cylindrical coordinates were converted at the vertices; elements between them are straight")
    return np.stack(columns, axis=1)


def _structured_cells(zone: Zone) -> Group:
    """The cells of a structured zone, numbered with the first direction fastest."""
    kind = element_type(_CELLS[zone.dimension])
    cells = zone.cell_sizes
    if min(cells) < 1:
        raise FormatError(f"expected two or more vertices in each direction, found {zone.sizes}", place=zone.node.place)
    steps = np.cumprod([1, *zone.sizes[:-1]])
    grid = np.indices(cells[::-1]).reshape(len(cells), -1)[::-1]
    first = steps @ grid
    # our local vertices lie at the ends -1 and 1 of each direction
    offsets = ((kind.shape.vertices > 0) @ steps).astype(np.int64)
    nodes = np.empty((len(first), len(offsets)), np.int64)
    nodes[:, kind.corners] = first[:, None] + offsets
    return Group(kind, "", np.arange(len(first)), nodes)


def _groups(section: Node, version: int, zone: Zone) -> list[Group]:
    """The elements of a section by type, without its rind."""
    number = _current(int(section.ints(2)[0]), version)
    first, count = _range(section)
    if number == MIXED:
        groups = _mixed(section, first, count, version)
    else:
        nodes = _known_count(number, section)
        table = section.required("ElementConnectivity").flat_ints()
        if len(table) != count * nodes:
            expected = f"{count * nodes} vertices of {count} elements"
            raise FormatError(f"expected {expected}, found {len(table)}", place=section.place)
        own = table.reshape(count, nodes) - 1
        groups = (
            [] if number == NODE else [Group(element_type(number), section.name, first - 1 + np.arange(count), own)]
        )
    ((low, high),) = rind_of(section, 1)
    inside = [_within(group, first - 1 + low, first - 1 + count - high) for group in groups]
    return [_settled(group, zone, section) for group in inside if len(group.numbers)]


def _range(section: Node) -> tuple[int, int]:
    """The number of the first element of a section, and how many it has."""
    first, last = section.required("ElementRange").ints(2).tolist()
    count = last - first + 1
    if first < 1 or count < 0:
        raise FormatError(f"expected numbers of elements from 1, found {first} to {last}", place=section.place)
    return first, count


def _is_by_parents(section: Node) -> bool:
    """Whether a section names sides by cells and numbers of their sides: all vertices are 0, as IOSS writes them."""
    if not all(section.child(f"ParentElements{what}") for what in ("", "Position")):
        return False
    table = section.required("ElementConnectivity").flat_ints()
    return table.size > 0 and not table.any()


def _of_parents(section: Node, zone: Zone) -> list[Group]:
    """The sides of cells that a section names, as elements with their corners."""
    first, count = _range(section)
    parents = section.required("ParentElements").ints(2, count)[0] - 1
    places = section.required("ParentElementsPosition").ints(2, count)[0]
    found = []
    for cells in zone.cells:
        rows = np.minimum(np.searchsorted(cells.numbers, parents), len(cells.numbers) - 1)
        is_here = cells.numbers[rows] == parents
        for place, corners in enumerate(sides_of_shape(cells.kind.shape), start=1):
            own = np.flatnonzero(is_here & (places == place))
            nodes = cells.nodes[rows[own]][:, list(corners)]
            found.append(Group(element_type(_SIDES[len(corners)]), section.name, first - 1 + own, nodes))
    lost = count - sum(len(group.numbers) for group in found)
    if lost:
        raise FormatError(f"expected cells and numbers of their sides, found {lost} others", place=section.place)
    return [group for group in found if len(group.numbers)]


def _within(group: Group, first: int, end: int) -> Group:
    """The elements with numbers from one to another."""
    is_inside = (group.numbers >= first) & (group.numbers < end)
    return group if is_inside.all() else group.part(np.flatnonzero(is_inside))


def _settled(group: Group, zone: Zone, section: Node) -> Group:
    """A group whose vertices are known to be there, and whose inner nodes lie where they are."""
    check_rows(group.nodes, zone.vertex_count, "vertices", 1, place=section.place)
    if group.kind.number in AMBIGUOUS and _lie_by_notes(group.kind.number, zone.points[group.nodes]):
        note = f"inner nodes of {group.kind.name} in {section.name} lie where notes in the standard define them"
        zone.notes.append(f"{note}, not evenly, and were read accordingly")
        return Group(element_type(group.kind.number, True), group.section, group.numbers, group.nodes)
    return group


def _lie_by_notes(number: int, places: Floats) -> bool:
    """Whether inner nodes of elements lie where notes in the standard define them, and not evenly.

    Both are held against where the nodes on the edges suggest them.
    """
    edges = element_type(AMBIGUOUS[number])
    count = len(edges.nodes)
    off = []
    for by_notes in (False, True):
        table = edges.functions.at(nodes_of_type(number, by_notes)[count:])
        off.append(float(np.abs(np.matmul(table, places[:, :count]) - places[:, count:]).sum()))
    return off[1] < off[0]


def _mixed(section: Node, first: int, count: int, version: int) -> list[Group]:
    """The elements of a section in which a type stands before the vertices of each; since version 4 with offsets."""
    table = section.required("ElementConnectivity").flat_ints()
    offsets = section.child("ElementStartOffset")
    starts = _walked(table, count, version, section) if offsets is None else offsets.ints(count + 1)
    if offsets is not None:
        is_sound = len(starts) and starts[0] == 0 and starts[-1] == len(table) and (np.diff(starts) > 1).all()
        if not is_sound:
            raise FormatError(f"expected ascending offsets from 0 to {len(table)}, found others", place=offsets.place)
    kinds = table[starts[:-1]]
    groups = []
    for kind in np.unique(kinds).tolist():
        number, rows = _current(kind, version), np.flatnonzero(kinds == kind)
        nodes = _known_count(number, section)
        if (starts[rows + 1] - starts[rows] != nodes + 1).any():
            raise FormatError(f"expected {nodes} vertices of each element of type {number}", place=section.place)
        own = table[starts[rows][:, None] + 1 + np.arange(nodes)] - 1
        if number != NODE:
            groups.append(Group(element_type(number), section.name, first - 1 + rows, own))
    return groups


def _walked(table: Ints, count: int, version: int, section: Node) -> Ints:
    """(count + 1,) where the types of the elements stand, found by going from each to the next."""
    starts, at, flat = [0], 0, table.tolist()
    lengths: dict[int, int] = {}
    for _ in range(count):
        if at >= len(flat):
            break
        kind = flat[at]
        if kind not in lengths:
            lengths[kind] = 1 + _known_count(_current(kind, version), section)
        at += lengths[kind]
        starts.append(at)
    if len(starts) != count + 1 or at != len(flat):
        raise FormatError(f"expected {count} elements in {len(flat)} numbers, found others", place=section.place)
    return np.array(starts, np.int64)


def _known_count(number: int, section: Node) -> int:
    """Number of nodes of a type; raises FormatError for polygons, polyhedra and invalid types."""
    nodes = node_count(number)
    if nodes is not None:
        return nodes
    expected = "elements with functions, such as HEXA_27"
    if number not in (NGON, NFACE):
        raise FormatError(f"expected {expected}, found type {number}", place=section.place)
    kind = "NFACE_n" if number == NFACE else "NGON_n"
    advice = "polygons and polyhedra of finite volumes have none; write cells of the standard's other types"
    raise FormatError(f"expected {expected}, found {kind}: {advice}", place=section.place)


def _current(number: int, version: int) -> int:
    """The number that a type has now.

    Pyramids of 13 nodes came with version 3.0 and got another number with 3.1.  Before 3.2, a number above the number
    of polygons meant a polygon, with the difference as its number of nodes.
    """
    own = number
    if version < _PYRAMIDS:
        own = number + 1 if number > MIXED else number
    elif version < _REORDERED and _PYRA_5 < number < NGON:
        own = _PYRA_13 if number == _PYRA_14 else number - 1
    return NGON if version < _CUBIC and own >= NGON and own != NFACE else own


def _check_cells(zone: Zone, declared: int) -> None:
    """Cells of the highest dimension there is, and a note where they are not as many as the zone declares."""
    if not zone.cells and zone.others:
        highest = max(group.kind.shape.dimension for group in zone.others)
        zone.cells = [group for group in zone.others if group.kind.shape.dimension == highest]
        zone.others = [group for group in zone.others if group.kind.shape.dimension < highest]
        zone.warnings.append(f"the zone {zone.name} has no cells of dimension {zone.dimension}, but of {highest}")
        zone.dimension = highest
    elif zone.cell_count != declared:
        zone.warnings.append(f"the zone {zone.name} declares {declared} cells and holds {zone.cell_count}")
