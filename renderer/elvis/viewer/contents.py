"""Contents of a dataset as the page lists them: elements, orders, boundaries, regions and names of quantities."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from elvis.core.distances.boundaries import boundaries, names_of_boundaries
from elvis.core.quantities.flows import CUSTOMARY, VECTORS

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.core.data.mesh import Mesh
    from elvis.core.quantities import Names

#: regions that a page lists, at most
MAX_REGIONS = 200
#: size of bodies relative to the data's box, above which the edges of the box are also shown
LARGE_BODY = 0.3


def contents_of(dataset: Dataset) -> dict[str, Any]:
    """Numbers of elements by shape and by order, of sides by boundary and of elements by region."""
    mesh = dataset.mesh
    shapes = {shape.label.lower(): len(entities) for shape, entities in mesh.elements.items()}
    return {
        "dimension": mesh.dimension,
        "space": mesh.space,
        "elements": shapes,
        "curved": [len(mesh.edge_curves.rows), len(mesh.face_curves.rows)],
        "orders": _orders(dataset),
        "time": dataset.time,
        "boundaries": _boundaries(mesh),
        "regions": _regions(mesh),
    }


def _orders(dataset: Dataset) -> dict[str, int]:
    """Number of elements of each order of the first field: the largest number of modes in a direction, less one."""
    found = Counter[int]()
    for field in dataset.solution[:1]:
        for block in field.blocks:
            found[max(block.expansion.modes) - 1] += len(block)
    return {str(order): found[order] for order in sorted(found)}


def _boundaries(mesh: Mesh) -> dict[str, int]:
    """Number of sides of each boundary."""
    if mesh.dimension < 2:
        return {}
    rows = boundaries(mesh)
    return {name: len(rows[name]) for name in names_of_boundaries(mesh)}


def _regions(mesh: Mesh) -> dict[str, int]:
    """Number of elements of each composite of elements; none if there is only one, which is the whole domain."""
    tags = {1: "S", 2: "TQ", 3: "APRH"}[mesh.dimension]
    found: dict[str, int] = {}
    for composite in mesh.composites:
        count = sum(len(ids) for tag, ids in composite.parts if tag in tags)
        if count:
            name = composite.name or str(composite.id)
            found[name] = found.get(name, 0) + count
    return dict(list(found.items())[:MAX_REGIONS]) if len(found) > 1 else {}


def first_sight(facts: Mapping[str, Any], has_field: bool) -> dict[str, Any]:
    """Keys of the scene that shows only the bodies in a far field, coloured by the pressure; none without bodies.

    has_field  whether the scene names its field
    """
    if not facts.get("bodies") or facts["kind"] != "solid":
        return {}
    pressure = facts["wall_field"]
    field = {"field": pressure} if pressure and not has_field else {}
    # a view that holds the box of a wide far field would show its body as a dot
    box = {"box": True} if facts["body_size"] > LARGE_BODY else {}
    return {**field, "objects": [{"kind": "faces", "select": facts["bodies"]}], **box}


def wall_field(fields: Sequence[str]) -> str | None:
    """The field of the first picture of walls, where velocities say little: the pressure, if the first is a velocity.

    None if the first field is no velocity, or if there is no pressure.
    """
    components = {name for vector in VECTORS for name in vector}
    if not fields or fields[0] not in components:
        return None
    return next((name for name in CUSTOMARY["p"] if name in fields), None)


def grouped_names(names: Names, has_elements: bool) -> dict[str, list[str]]:
    """Quantities that can colour a picture, by chapter; each sorted alphabetically, with numbers by their value.

    has_elements  whether the data have elements with properties, and fields with modes
    """
    chapters = {
        "fields": names.fields,
        "derived": names.flow.available,
        "mesh": [*"xyz"[: names.dimension], *(names.of_elements if has_elements else ())],
        "resolution": names.of_resolution if has_elements else (),
    }
    taken = set[str]()
    found = {}
    for title, listed in chapters.items():
        found[title] = sorted((name for name in listed if name not in taken), key=_natural)
        taken.update(found[title])
    return found


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """The key by which names are sorted: letters without their case, numbers by their size."""
    parts = re.split(r"(\d+)", name.lower())
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]
