"""Representation of meshes, fields and datasets: one line at a prompt, a table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.core.data.dataset import Block, Dataset, Field
    from elvis.core.data.mesh import Mesh
    from elvis.core.files.columns import Columns
    from elvis.core.numbers.sampling import Samples
    from elvis.core.shapes import Shape

#: names of fields that one line holds
_NAMES = 8
#: rows at each end of a long table
_ENDS = 5


def line_of_mesh(mesh: Mesh) -> str:
    """``<Mesh 3D: 48 tetrahedra, 12 prisms; 35 vertices, 6 curved edges>``."""
    curved = [(len(mesh.edge_curves.rows), "edges"), (len(mesh.face_curves.rows), "faces")]
    parts = [f"{len(mesh.vertices)} vertices", *(f"{count} curved {what}" for count, what in curved if count)]
    return f"<Mesh {_dimensions(mesh)}: {elements_of(mesh)}; {', '.join(parts)}>"


def line_of_block(block: Block) -> str:
    """``<Block of 48 tetrahedra: 10 coefficients each>``."""
    count = block.coefficients.shape[-1]
    return f"<Block of {_shape_count(len(block), block.expansion.shape)}: {count} coefficients each>"


def line_of_field(field: Field) -> str:
    """``<Field p: 60 elements of order 3>``."""
    return f"<Field {field.name}: {sum(map(len, field.blocks))} elements{_of_order([field])}>"


def line_of_dataset(dataset: Dataset) -> str:
    """``<Dataset 3D: 48 tetrahedra; fields p, u, v of order 3; time 0.5>``."""
    names = [field.name for field in dataset.solution]
    told = names if len(names) <= _NAMES else [*names[: _NAMES - 1], f"… ({len(names)} in all)"]
    parts = [f"{_dimensions(dataset.mesh)}: {elements_of(dataset.mesh)}"]
    parts.append(f"fields {', '.join(told)}{_of_order(dataset.solution)}" if names else "no fields")
    parts += [] if dataset.time is None else [f"time {dataset.time:g}"]
    return f"<Dataset {'; '.join(parts)}>"


def table_of_dataset(dataset: Dataset) -> str:
    """HTML: what ``elvis info`` opens with, and a row for each field; names are escaped, as they come from files."""
    from html import escape

    rows = []
    for field in dataset.solution:
        kinds = "continuous" if field.continuous else "" if field.continuous is None else "discontinuous"
        cells = (field.name, str(sum(map(len, field.blocks))), _orders([field]), kinds)
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in ("field", "elements", "order", ""))
    time = "" if dataset.time is None else f"; time {dataset.time:g}"
    caption = f"{_dimensions(dataset.mesh)}: {elements_of(dataset.mesh)}{time}"
    return f"<table><caption>{escape(caption)}</caption><tr>{head}</tr>{''.join(rows)}</table>"


def line_of_samples(samples: Samples) -> str:
    """``<Samples of speed, p at 200 points: 190 inside, 10 outside>``."""
    from elvis.core.mapping.inverse import Status

    status = samples.location.status
    counts = [f"{int((status == state).sum())} {state.name.lower()}" for state in Status if (status == state).any()]
    told = f": {', '.join(counts)}" if counts else ""
    return f"<Samples of {', '.join(samples.names) or 'nothing'} at {len(samples)} points{told}>"


def table_of_columns(columns: Columns, caption: str) -> str:
    """HTML: a row for each entry of the columns; a long table shows only the first and the last entries."""
    from html import escape

    count = len(next(iter(columns.values())))
    rows = range(count) if count <= 2 * _ENDS else [*range(_ENDS), None, *range(count - _ENDS, count)]
    lines = []
    for row in rows:
        cells = ("…" if row is None else f"{column[row]:.6g}" for column in columns.values())
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    return f"<table><caption>{escape(caption)}</caption><tr>{head}</tr>{''.join(lines)}</table>"


def elements_of(mesh: Mesh) -> str:
    """``48 tetrahedra, 12 prisms``."""
    found = [_shape_count(len(entities), shape) for shape, entities in mesh.elements.items()]
    return ", ".join(found) or "no elements"


def _dimensions(mesh: Mesh) -> str:
    return f"{mesh.dimension}D" if mesh.space == mesh.dimension else f"{mesh.dimension}D in {mesh.space}D"


def _shape_count(count: int, shape: Shape) -> str:
    name = shape.label.lower()
    if count != 1:
        name = f"{name[:-2]}a" if name.endswith("hedron") else f"{name}s"
    return f"{count} {name}"


def _of_order(fields: Sequence[Field]) -> str:
    orders = _orders(fields)
    return f" of order {orders}" if orders else ""


def _orders(fields: Iterable[Field]) -> str:
    """``3``, or ``2 to 5``: polynomial orders, modes less one."""
    found = {modes - 1 for field in fields for block in field.blocks for modes in block.expansion.modes}
    if not found:
        return ""
    least, most = min(found), max(found)
    return str(most) if least == most else f"{least} to {most}"
