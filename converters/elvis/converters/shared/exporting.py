"""Native data at the nodes of other programs' cells: the common part of exports.

Every element becomes one cell of the lowest order that holds its map and its fields.  Pyramids and prisms that a
program's own cells cannot represent become hexahedra with a collapsed face or edge: there all their functions are
polynomials.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import plain_names
from elvis.core.data.dataset import MAP_KEY, Dataset, Expansion
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.shapes import TENSOR, Shape
from elvis.plugins.conversion.exporting import Exporter, Loss
from elvis.plugins.conversion.nodal import nearest_nodes
from elvis.plugins.conversion.report import CONVERTED, REPORT

#: points of each element at which an export is compared with the data
_CHECKS = 24
_AT_ONCE = 1 << 12


@dataclass(frozen=True, eq=False)
class Cell:
    """A kind of cells of another program.

    number  number of the type in its files
    nodes   (k, d) reference coordinates of the nodes, in the coordinates of ``shape``
    """

    shape: Shape
    order: int
    number: int
    nodes: Floats


class Target(ABC):
    """The cells of a program: their shapes and orders, and the functions of their nodes."""

    #: the highest order of its cells, of pyramids that are the native ones of that order, and of prisms
    highest: int
    highest_pyramid: int
    highest_prism: int

    def shape(self, shape: Shape) -> Shape:
        """The shape of the cells that represent elements of a shape; collapsed ones have all their functions."""
        return shape

    @abstractmethod
    def cell(self, shape: Shape, order: int) -> Cell:
        """The cells of a shape and order."""

    @abstractmethod
    def table(self, cell: Cell, points: Floats) -> Floats:
        """(n, k) values of the functions of a cell's nodes at points (n, d), in the coordinates of its shape."""


class BoxTarget(Target):
    """Points on the box of collapsed coordinates of every shape; functions are products of one in each direction."""

    highest, highest_pyramid, highest_prism = 30, 0, 0

    def shape(self, shape: Shape) -> Shape:
        """The box of each dimension."""
        return TENSOR[shape.dimension - 1]

    def directions(self, dimension: int) -> Iterable[int]:
        """The directions from the slowest to the fastest in the order of points."""
        return range(dimension)

    @abstractmethod
    def along_line(self, order: int, places: Floats) -> Floats:
        """(n, order + 1) the functions of one direction at places (n,) in [-1, 1]."""

    def table(self, cell: Cell, points: Floats) -> Floats:
        """Products of the functions of all directions."""
        table = np.ones((len(points), 1))
        for axis in self.directions(cell.shape.dimension):
            own = self.along_line(cell.order, points[:, axis])
            table = (table[:, :, None] * own[:, None, :]).reshape(len(points), -1)
        return table


@dataclass(frozen=True, eq=False)
class Piece:
    """Elements of one patch as cells: places (n, k, 3) and, for each field, values (n, k) of the nodes."""

    patch: Patch
    cell: Cell
    places: Floats
    values: tuple[Floats | None, ...]

    @property
    def is_collapsed(self) -> bool:
        """Whether cells of another shape represent the elements, such as hexahedra for pyramids or prisms."""
        return self.cell.shape is not self.patch.shape

    @property
    def corners(self) -> Ints:
        """(v,) which vertex of the elements each vertex of the cells is."""
        shape = self.patch.shape
        return nearest_nodes(shape.vertices, _in_elements(shape, self.cell, self.cell.shape.vertices))


@dataclass(eq=False)
class Export:
    """All pieces of a dataset, the names of the fields, and the losses: of the coordinates, then of each field."""

    names: tuple[str, ...]
    pieces: list[Piece] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)


def exported(dataset: Dataset, names: Sequence[str] | None, order: int | None, target: Target) -> Export:
    """The dataset as cells of a program, compared with itself at points between the nodes.

    order  of all cells; None for the lowest that holds map and fields, as far as the program goes
    Raises ElvisError for unknown fields and for data with Fourier directions.
    """
    if any(block.expansion.homogeneous for each in dataset.fields for block in each.blocks):
        raise ElvisError("expected fields without Fourier directions, found some with")
    chosen = tuple([field.name for field in dataset.solution] if names is None else names)
    result = Export(plain_names(chosen), losses=[Loss("coordinates"), *(Loss(name) for name in chosen)])
    for patch in patches(dataset, chosen):
        piece = _piece(patch, order, target)
        result.pieces.append(piece)
        _compare(piece, target, result.losses)
    return result


def title(composite: Composite, mesh: Mesh) -> str:
    """The name of a composite in other programs' files."""
    shapes = [shape for shape in Shape.of_dimension(mesh.dimension) if shape.tag in dict(composite.parts)]
    kind = shapes[0].label.lower() if shapes else "boundary"
    return composite.name or composite.label or f"{kind} {composite.id}"


def exporter_of(
    target: Callable[[], Target], write: Callable[[Path, Export, Dataset], object], *, has_time: bool = True
) -> Exporter:
    """An exporter: the dataset becomes cells of a target, the losses are reported, ``write`` makes the file.

    has_time  whether the file contains the time
    """

    def export(
        dataset: Dataset,
        names: Sequence[str] | None,
        order: int | None,
        path: Path,
        report: Callable[[Sequence[Loss]], object],
    ) -> list[str]:
        found = exported(dataset, names, order, target())
        report(found.losses)
        write(path, found, dataset)
        return left_out(dataset, has_time=has_time)

    return export


def left_out(dataset: Dataset, written: Collection[str] = (), *, has_time: bool = True) -> list[str]:
    """Messages about omissions: composites other than ``written``, metadata, sections of a session, the time.

    Unnamed regions that only separate shapes are ignored, and so are notes of an earlier conversion.
    """
    mesh, known = dataset.mesh, {CONVERTED, REPORT, MAP_KEY, "Time"}
    composites = [own for own in mesh.composites if any(len(ids) for _, ids in own.parts)]
    domain = {id for ids in mesh.domains.values() for id in ids}
    shapes = [own for own in composites if own.id in domain and not (own.name or own.label)]
    if len(shapes) > len(mesh.elements):
        shapes = []
    names = dict.fromkeys(title(own, mesh) for own in composites if own not in shapes)
    found = {
        "boundaries and regions": [name for name in names if name not in written],
        "metadata": [name for name in dataset.metadata if name not in known],
        "sections of the session": list(dataset.session),
        "data without fields": ["the time"] if dataset.time is not None and not has_time else [],
    }
    return [f"{kind} are skipped: {', '.join(words)}" for kind, words in found.items() if words]


def _piece(patch: Patch, order: int | None, target: Target) -> Piece:
    spaces = [patch.geometry, *(own for own in patch.fields if own is not None)]
    wanted = max(max(own.modes) - 1 for own in spaces)
    shape = target.shape(patch.shape)
    if patch.shape is Shape.PYRAMID and (wanted > target.highest_pyramid or any(_is_ortho(own) for own in spaces)):
        shape = Shape.HEXAHEDRON
        wanted = max(_vertical(own) for own in spaces)
    if shape is Shape.PRISM and min(order or wanted, target.highest) > target.highest_prism:
        shape = Shape.HEXAHEDRON
    cell = target.cell(shape, min(order or max(1, wanted), target.highest))
    nodes = _in_elements(patch.shape, cell, cell.nodes)
    places = evaluate(patch.geometry, patch.geometry_coefficients, nodes).transpose(0, 2, 1)
    values = tuple(
        None if own is None or coefficients is None else evaluate(own, coefficients, nodes)
        for own, coefficients in zip(patch.fields, patch.coefficients, strict=True)
    )
    return Piece(patch, cell, places, values)


def _in_elements(shape: Shape, cell: Cell, points: Floats) -> Floats:
    """(n, d) points of cells in the reference coordinates of the elements of a shape that the cells represent."""
    return points if cell.shape is shape else uncollapse(shape, points)


def _is_ortho(expansion: Expansion) -> bool:
    return expansion.bases[-1] is Basis.ORTHO_PYR_C and max(expansion.modes) > 1


def _vertical(expansion: Expansion) -> int:
    """The highest power of a collapsed coordinate in a pyramid's functions (format notes 8)."""
    order = max(expansion.modes) - 1
    return 2 * order if _is_ortho(expansion) else max(order, 2 * order - 2)


def _compare(piece: Piece, target: Target, losses: Sequence[Loss]) -> None:
    """Take in the differences at random points of every element."""
    patch, cell = piece.patch, piece.cell
    eta = np.random.default_rng(0).uniform(-1, 1, (_CHECKS, cell.shape.dimension))
    points = eta if piece.is_collapsed else uncollapse(cell.shape, eta)
    native = _in_elements(patch.shape, cell, points)
    table = target.table(cell, points)
    for part in _parts(len(patch)):
        exact = evaluate(patch.geometry, patch.geometry_coefficients[part], native)
        _add(losses[0], cell, patch, part, exact.reshape(len(exact), -1),
             (table @ piece.places[part]).transpose(0, 2, 1).reshape(len(exact), -1))  # fmt: skip
        for loss, own, coefficients, values in zip(
            losses[1:], patch.fields, patch.coefficients, piece.values, strict=True
        ):
            if own is not None and coefficients is not None and values is not None:
                _add(loss, cell, patch, part, evaluate(own, coefficients[part], native), values[part] @ table.T)


def _add(loss: Loss, cell: Cell, patch: Patch, part: slice, exact: Floats, found: Floats) -> None:
    loss.order = max(loss.order, cell.order)
    loss.note(patch.element_ids[part], exact, found)


def _parts(count: int) -> Iterator[slice]:
    return (slice(first, first + _AT_ONCE) for first in range(0, count, _AT_ONCE))
