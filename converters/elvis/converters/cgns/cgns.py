"""CGNS files: structured and unstructured zones in either container, with solutions and boundary conditions.

Layout: CGNS Standard Interface Data Structures (SIDS) and their mapping to HDF5; CPEX 0045 for solutions in bases of
their own.  Zones of several make one mesh: vertices at their outsides are one where they lie together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elvis.converters.cgns.elements import ElementType, element_type
from elvis.converters.cgns.sides import Condition, SideList, ZoneSides, named_elements
from elvis.converters.cgns.solutions import Solutions, Values, chosen_elements, lagrange, reference_corners
from elvis.converters.cgns.tree import Node, is_cgns, opened
from elvis.converters.cgns.zones import Group, Zone, read_zone
from elvis.converters.shared.inputs import STEP, single, step_number
from elvis.core.base.arrays import Ints, joined_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, NodalValues, nearest_nodes
from elvis.plugins.conversion.plugin import DOUBLE, SINGLE, Boundary, Elements, PyramidSpace, Reads

#: the name of nothing in lists of names
_NULL = "Null"

#: above the version of any library
_NO_VERSION = 100

#: labels of nodes of families that define functions of elements and of solutions
_INTERPOLATIONS = ("ElementInterpolation_t", "SolutionInterpolation_t")

#: units of a base, in the order of the standard
_UNITS = ("mass", "length", "time", "temperature", "angle")


class Cgns(NodalConverter):
    """The zones of a base, and their solutions at one time."""

    format = "CGNS (.cgns), HDF5 or ADF"
    keeps = (
        "structured and unstructured zones, all element types up to order 4, boundary conditions and families by name, "
        "solutions at vertices, in cells and in bases of the file (CPEX 0045), time steps"
    )
    loses = "values on faces, boundary data, data of other bases; files that are linked"
    reads = Reads(
        "all",
        "1 to 4 (map), any (fields)",
        "nodal, constant, CPEX 0045",
        "conditions and families by name",
        "solutions of one file",
        "zones",
        "by place",
        "no",
    )
    options = (STEP,)
    further_files = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether this is one CGNS file, in either container."""
        return len(paths) == 1 and is_cgns(paths[0])

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The times of the steps of its base."""
        path = single(paths)
        with opened(path) as root:
            return _times(_base(root)[0])

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        path = single(paths)
        self.blocks, self.notes, self.warnings = [], [], []
        with opened(path) as root:
            self._read(root, step_number(step), path)
        self.notes = list(dict.fromkeys(self.notes))
        self.warnings = list(dict.fromkeys(self.warnings))

    def _read(self, root: Node, number: int, path: Path) -> None:
        """All that the file holds, at a step."""
        base, left = _base(root)
        if left:
            self.warnings = [f"the bases {', '.join(left)} were skipped; {base.name} was read"]
        times = _times(base)
        step: int | None = None
        if times:
            step = checked_step(number, len(times), path)
            self.time = times[step]
        moment = _Moment(base, step)
        families = {each.name: each for each in base.labelled("Family_t")}
        interpolating = [own for own in families.values() if any(own.labelled(label) for label in _INTERPOLATIONS)]
        dimension, physical = base.ints(2).tolist()
        if not 1 <= dimension <= 3 or not dimension <= physical <= 3:
            raise FormatError(f"expected dimensions 1 to 3, found {dimension} and {physical}", place=base.place)
        version = _version(root)
        zones = [
            _ZoneReading(
                read_zone(node, dimension, physical, version, moment.coordinates(node)), families, interpolating
            )
            for node in moment.zones()
        ]
        self._set(zones, moment)
        self.metadata = _units(base)
        self.notes = [*self.notes, *_remarks(base)]

    def _set(self, zones: Sequence[_ZoneReading], moment: _Moment) -> None:
        """Blocks, boundaries and fields of all zones."""
        kept = self._whole_zones(zones, moment)
        is_joined = len(kept) > 1
        ids = vertices = 0
        boundaries: dict[str, list[tuple[int, Ints, Ints]]] = {}
        blocks: list[Elements] = []
        for reading in kept:
            reading.part(moment.solutions(reading.zone.node), is_joined)
            first = len(blocks)
            blocks += reading.blocks(ids, vertices, is_joined)
            for name, group, rows, sides in reading.boundaries():
                boundaries.setdefault(name, []).append((first + group, rows, sides))
            ids += 1 + max(int(group.numbers.max()) for group in reading.zone.cells)
            vertices += reading.zone.vertex_count
        self.blocks = blocks
        self.boundaries = [Boundary(name, sides=sides) for name, sides in boundaries.items()]
        self._set_fields(kept, moment)
        self._set_remarks(kept)

    def _whole_zones(self, zones: Sequence[_ZoneReading], moment: _Moment) -> list[_ZoneReading]:
        """The zones with cells of the highest dimension there is."""
        highest = max((reading.zone.dimension for reading in zones if reading.zone.cell_count), default=0)
        if not highest:
            raise FormatError("expected elements, found none", place=moment.base.place)
        kept = [reading for reading in zones if reading.zone.dimension == highest and reading.zone.cell_count]
        left = len(zones) - len(kept)
        if left:
            self.warnings = [*self.warnings, f"{left} zones without cells of dimension {highest} were skipped"]
        return kept

    def _set_remarks(self, zones: Sequence[_ZoneReading]) -> None:
        """Collect the remarks of all zones."""
        self.is_conforming = not any(reading.is_abutting for reading in zones)
        sizes = {reading.zone.points.dtype.itemsize for reading in zones}
        self.precision = SINGLE if np.dtype(np.float32).itemsize in sizes else DOUBLE
        notes, warnings = [*self.notes], [*self.warnings]
        for reading in zones:
            notes += [*reading.zone.notes, *reading.open_functions()]
            warnings += [*reading.zone.warnings, *reading.warnings]
        self.notes = notes
        self.warnings = warnings

    def _set_fields(self, zones: Sequence[_ZoneReading], moment: _Moment) -> None:
        """The fields of all zones, brought together by name and place."""
        found: dict[tuple[str, bool, str], list[NodalValues | None]] = {}
        before = 0
        for reading in zones:
            count = len(reading.zone.cells)
            for key, values in reading.fields(moment.solutions(reading.zone.node)):
                own = found.setdefault(key, [None] * len(self.blocks))
                own[before : before + count] = values
            before += count
        at_vertices = {name for name, is_at_vertices, _ in found if is_at_vertices}
        for key, values in found.items():
            name, is_at_vertices, solution = key
            label = f"{name}_cell" if not is_at_vertices and name in at_vertices else name
            label = f"{label}_{solution}" if solution else label
            self.add_field(key, [label], values, is_continuous=is_at_vertices)


class _Moment:
    """The content of a base at a step, by the names in its iterative data; all of it without steps."""

    def __init__(self, base: Node, step: int | None) -> None:
        self.base, self._step = base, step

    def zones(self) -> list[Node]:
        """The zones; if the base names zones for the step, only these."""
        zones = self.base.labelled("Zone_t")
        iterative = next(iter(self.base.labelled("BaseIterativeData_t")), None)
        pointers = None if iterative is None else iterative.child("ZonePointers")
        if pointers is None or self._step is None:
            return zones
        raw = pointers.array()
        names = pointers.texts()
        each = len(names) // max(1, raw.shape[0]) if raw is not None and raw.ndim == 3 else 0
        own = {name.split("/")[-1] for name in names[self._step * each : (self._step + 1) * each]}
        return [zone for zone in zones if zone.name in own] if own - {_NULL} else zones

    def coordinates(self, zone: Node) -> str:
        """Name of the node with the places of vertices."""
        names = self._pointers(zone, "GridCoordinatesPointers")
        return next((name for name in names if name != _NULL), "GridCoordinates")

    def solutions(self, zone: Node) -> list[Node]:
        """The solutions of a zone at the step: the named ones, or all if none is named at any step."""
        every = zone.labelled("FlowSolution_t")
        iterative = next(iter(zone.labelled("ZoneIterativeData_t")), None)
        arrays = [] if iterative is None else iterative.children
        known = [each for each in arrays if each.name.startswith("FlowSolution") and each.name.endswith("Pointers")]
        if self._step is None or not known:
            return every
        names = {each.texts()[self._step] for each in known if self._step < len(each.texts())}
        return [each for each in every if each.name in names]

    def _pointers(self, zone: Node, name: str) -> list[str]:
        """The name that a zone's iterative data have for the step."""
        iterative = next(iter(zone.labelled("ZoneIterativeData_t")), None)
        node = None if iterative is None else iterative.child(name)
        if node is None or self._step is None:
            return []
        names = node.texts()
        return names[self._step : self._step + 1]


@dataclass(eq=False)
class _ZoneReading:
    """A zone that is converted into blocks, one for each of its groups of cells.

    families       of the base, by name
    interpolating  those that define functions
    """

    zone: Zone
    families: dict[str, Node]
    interpolating: list[Node]

    def __post_init__(self) -> None:
        self.warnings: list[str] = []
        self._regions: list[str] = []
        self.is_abutting = False
        self._read_interfaces()

    def part(self, solutions: Sequence[Node], is_joined: bool) -> None:
        """Part groups of cells by region, and by the solutions that name some of them."""
        conditions = self._conditions()
        names = _names(self.zone.node, self.families)
        default = names[0] if names else self.zone.name if is_joined or self.zone.is_structured else ""
        groups, regions = [], []
        for group in self.zone.cells:
            labels = np.full(len(group.numbers), default or group.section, object)
            for node in conditions if not names else ():
                own = None if self.zone.is_structured else named_elements(node)
                if own is not None:
                    labels[own.hold(group.numbers)] = (_names(node, self.families) or [node.name])[0]
            marks = self._solution_marks(group, solutions)
            for label, rows in _parts(labels, marks):
                groups.append(self._with_points(group.part(rows) if len(rows) < len(labels) else group))
                regions.append(label)
        self.zone.cells, self._regions = groups, regions
        self._places = [NodalValues(self.zone.points, group.kind.functions, group.nodes) for group in groups]
        self._sides = ZoneSides(self.zone)

    def _solution_marks(self, group: Group, solutions: Sequence[Node]) -> NDArray[np.int64]:
        """(n,) a number for each cell, the same for cells that the same solutions name."""
        marks = np.zeros(len(group.numbers), np.int64)
        for node in () if self.zone.is_structured else solutions:
            own = chosen_elements(node, self.zone) if node.child("GridLocation") is not None else None
            if own is not None:
                _, marks = np.unique(2 * marks + np.isin(group.numbers, own), return_inverse=True)
        return marks

    def _with_points(self, group: Group) -> Group:
        """The group with the control points that a family of the zone gives its type (CPEX 0045)."""
        for family in self._zone_families():
            for node in family.labelled("ElementInterpolation_t"):
                points = node.child("LagrangeControlPoints")
                if int(node.ints(1)[0]) == group.kind.number and points is not None:
                    return replace(group, kind=_with_control_points(group.kind, points))
        return group

    def _zone_families(self) -> list[Node]:
        """The families that the zone names; where it names none, those of the base that define functions."""
        names = [each.text().split("/")[-1] for each in _name_nodes(self.zone.node)]
        return [self.families[name] for name in names if name in self.families] or self.interpolating

    def blocks(self, ids: int, vertices: int, is_joined: bool) -> Iterator[Elements]:
        """The blocks: cells are numbered from ``ids``, vertices from ``vertices`` on."""
        numbers = vertices + np.arange(self.zone.vertex_count)
        if is_joined or self.zone.is_structured:
            numbers[self._sides.outer_vertices()] = -1  # vertices at the same place are one
        for group, region, places in zip(self.zone.cells, self._regions, self._places, strict=True):
            yield Elements(
                group.kind.shape,
                len(group.numbers),
                group.kind.order,
                numbers[group.nodes[:, group.kind.corners]],
                ids=ids + group.numbers,
                region=region,
                pyramid=PyramidSpace.RATIONAL,
                key=NodalBlock(places),
            )

    def boundaries(self) -> Iterator[tuple[str, int, Ints, Ints]]:
        """Name, number of a group, rows and sides; for sections that no condition names, the section's name."""
        conditions = [Condition(node, self.zone, self._sides) for node in self._conditions()]
        for condition in conditions:
            self.warnings += condition.warnings
            for name in _names(condition.node, self.families) or [condition.node.name]:
                for part in condition.sides.parts():
                    yield name, *part
        named = joined_ints(condition.taken for condition in conditions)
        marked = SideList.joined([condition.sides for condition in conditions])
        flat = [group for group in self.zone.others if group.kind.shape.dimension == self.zone.dimension - 1]
        sections = {
            section: [g for g in flat if g.section == section] for section in dict.fromkeys(g.section for g in flat)
        }
        for section, groups in sections.items():
            sides, lost = self._sides.of_elements(groups)
            if lost:
                self.warnings.append(f"{lost} elements of the section {section} belong to no cell")
            is_named = any(np.isin(group.numbers, named).any() for group in groups)
            if not is_named and not sides.are_among(marked):
                for part in sides.parts():
                    yield section, *part

    def fields(self, solutions: Sequence[Node]) -> Iterator[tuple[tuple[str, bool, str], list[NodalValues | None]]]:
        """Values on each group by name, whether at vertices, and the solution where an earlier one has the name."""
        source = Solutions(self.zone, self._zone_families(), self._places)
        found: dict[tuple[str, bool, str], list[NodalValues | None]] = {}
        for node in solutions:
            for values in source.read(node):
                _merge(found, values, node.name)
        self.warnings += source.warnings
        yield from found.items()

    def open_functions(self) -> Iterator[str]:
        """A note for each type of cells whose functions the standard leaves open."""
        for name in {group.kind.name for group in self.zone.cells if not group.kind.is_standard}:
            yield f"the standard does not define {name} between its nodes; hierarchical functions were assumed"

    def _conditions(self) -> list[Node]:
        return [each for holder in self.zone.node.labelled("ZoneBC_t") for each in holder.labelled("BC_t")]

    def _read_interfaces(self) -> None:
        """Interfaces at which faces meet parts of others, and zones that overlap."""
        holders = self.zone.node.labelled("ZoneGridConnectivity_t")
        for each in (node for holder in holders for node in holder.labelled("GridConnectivity_t")):
            kind = next((node.text() for node in each.labelled("GridConnectivityType_t")), "Overset")
            self.is_abutting |= kind == "Abutting"
            if kind == "Overset":
                self.warnings.append(f"the zone {self.zone.name} overlaps others ({each.name}); both remain there")


def _merge(found: dict[tuple[str, bool, str], list[NodalValues | None]], values: Values, solution: str) -> None:
    """Merge values with values of the same name on other cells; list them separately if both are on some cell."""
    key = (values.name, values.is_at_vertices, "")
    own = found.get(key)
    if own is None:
        found[key] = list(values.on_groups)
    elif any(a is not None and b is not None for a, b in zip(own, values.on_groups, strict=True)):
        found[values.name, values.is_at_vertices, solution] = list(values.on_groups)
    else:
        found[key] = [a if b is None else b for a, b in zip(own, values.on_groups, strict=True)]


def _parts(labels: NDArray[np.object_], marks: Ints) -> Iterator[tuple[str, Ints]]:
    """Each label with the rows that have it, those with unlike marks apart."""
    for label in dict.fromkeys(labels.tolist()):
        here = labels == label
        for mark in dict.fromkeys(marks[here].tolist()):
            yield label, np.flatnonzero(here & (marks == mark))


def _with_control_points(kind: ElementType, points: Node) -> ElementType:
    """A type whose nodes lie elsewhere in its reference element."""
    own = points.floats(len(kind.nodes), kind.shape.dimension).astype(np.float64)
    functions = lagrange(kind.shape, kind.order, own, points.place)
    corners = nearest_nodes(own, reference_corners(kind.shape))
    ours = corners[np.array(element_type(kind.number).corners)]
    if np.abs(own[corners] - reference_corners(kind.shape)).max() > 1e-6:
        raise FormatError("expected control points at all corners, found none at some", place=points.place)
    return replace(kind, functions=functions, corners=ours)


def _version(root: Node) -> int:
    """The version of the library that wrote the file, times 1000."""
    node = root.required("CGNSLibraryVersion")
    found = float(node.floats(1)[0])
    if not 0 < found < _NO_VERSION:
        raise FormatError(f"expected a version from 1 to {_NO_VERSION}, found {found}", place=node.place)
    return round(1000 * found)


def _base(root: Node) -> tuple[Node, list[str]]:
    """The first base with the highest dimension of cells, and the names of the others."""
    bases = [each for each in root.labelled("CGNSBase_t") if each.labelled("Zone_t")]
    if not bases:
        raise FormatError("expected a base with zones, found none")
    highest = max(int(base.ints(2)[0]) for base in bases)
    chosen = next(base for base in bases if int(base.ints(2)[0]) == highest)
    return chosen, [base.name for base in bases if base is not chosen]


def _times(base: Node) -> list[float]:
    """Times of the steps of a base, or the numbers of their iterations; none if it has no steps."""
    for node in base.labelled("BaseIterativeData_t"):
        for name in ("TimeValues", "IterationValues"):
            own = node.child(name)
            if own is not None:
                return [float(time) for time in own.floats(None)]
    return []


def _name_nodes(node: Node) -> list[Node]:
    return [*node.labelled("FamilyName_t"), *node.labelled("AdditionalFamilyName_t")]


def _names(node: Node, families: dict[str, Node]) -> list[str]:
    """Names of the families of a node: the families that contain these if any, else their own names."""
    found: list[str] = []
    for own in _name_nodes(node):
        name = own.text().split("/")[-1]
        family = families.get(name)
        above = [] if family is None else [each.text() for each in family.labelled("FamilyName_t")]
        found += [each for each in above if each] or ([name] if name else [])
    return list(dict.fromkeys(found))


def _units(base: Node) -> dict[str, str]:
    """The units of a base by dimension."""
    for node in base.labelled("DimensionalUnits_t"):
        names = dict(zip(_UNITS, node.texts(), strict=False))
        return {f"unit of {what}": name for what, name in names.items() if name not in ("", _NULL, "UserDefined")}
    return {}


def _remarks(base: Node) -> list[str]:
    """Remarks about values that are used without conversion."""
    kinds = [each.text() for each in base.labelled("DataClass_t")]
    scaled = [kind for kind in kinds if kind == "NormalizedByDimensional"]
    return ["values are normalized, and were read unchanged"] if scaled else []
