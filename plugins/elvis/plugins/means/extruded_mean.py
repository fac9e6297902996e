"""The mean of extruded 3D data along a coordinate, as plane data.

With L the height of the mesh, the mean of a field over a column of elements x(xi, t) = (p(xi), z(t)) is

    mean(xi) = 1/L sum over elements of  integral of f(xi, t) |z'(t)| dt.

It is a polynomial in the reference coordinates of the plane map p if f is one in those of its elements, so it is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import MAP_KEY, Dataset
from elvis.core.integrals.reference_cells import Piece, side_corners
from elvis.core.integrals.targets import Places
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import Conversion, Settings, convert
from elvis.plugins.conversion.plugin import Boundary, Converter, Elements, SourceField
from elvis.plugins.conversion.report import CONVERTED, REPORT
from elvis.plugins.fourier.planes import fourier_mean
from elvis.plugins.means.extruded_columns import TOLERANCE, Columns, Stack, columns_of, inner_points, layers_of

#: numbers of values at points that are held together
_BATCH = 1 << 22
#: deviation of heights of columns, relative to the height of the mesh, that counts as rounding
_ROUNDING = 1e-6


def mean_along(dataset: Dataset, axis: str) -> Dataset:
    """The exact mean of all fields along an axis, on a plane mesh, as ``elvis average --direction`` writes it.

    Parameters
    ----------
    dataset : Dataset
        Data with one Fourier direction, or hexahedra and prisms that are extruded along the axis.
    axis : str
        ``x``, ``y`` or ``z``.

    Returns
    -------
    Dataset
        Plane data; remarks state the error of a 3D mesh's projection, which is rounding for polynomials.

    Raises
    ------
    ElvisError
        If the data have no Fourier direction along the axis, or the mesh is not extruded along it.

    >>> cube = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    >>> ds = elvis.from_arrays({"hexahedron": [cube]}, u=[cube[:, 0] + cube[:, 2]])
    >>> round(elvis.mean_along(ds, "z")["u"](0.25, 0.5), 12)
    0.75
    """
    if dataset.mesh.dimension < 3:
        return fourier_mean(dataset, axis)
    conversion = extruded_mean(dataset, axis)
    return replace(conversion.dataset, remarks=tuple(conversion.report.remarks()))


def extruded_mean(dataset: Dataset, axis: str) -> Conversion:
    """The mean of all fields along an axis along which the mesh is extruded, on a plane mesh, with measured errors.

    The plane coordinates are the other two, in their order; boundaries along the axis become those of the plane mesh.

    Parameters
    ----------
    dataset : Dataset
        Hexahedra and prisms in columns that all have the same ends; their layers may have any heights.
    axis : str
        ``x``, ``y`` or ``z``.

    Raises
    ------
    ElvisError
        If the mesh is not extruded along the axis, with an element and its position.

    >>> extruded_mean(ds, "z").dataset  # doctest: +SKIP
    """
    return convert(ExtrudedMean(dataset, "xyz".index(axis)), Settings(), (f"mean along {axis}",))


class ExtrudedMean(Converter):
    """Columns of elements as elements of a plane mesh: one element of a column gives its map."""

    format = "mean along an axis"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files."""
        return False

    def __init__(self, dataset: Dataset, axis: int) -> None:
        self._label = f"--direction {'xyz'[axis]}"
        if dataset.mesh.dimension < 3:
            raise ElvisError(f"{self._label}: expected a 3D mesh or a Fourier direction, found a plane mesh")
        self._axis, self._flat = axis, [i for i in range(3) if i != axis]
        names = [own.name for own in dataset.solution]
        self._patches = patches(dataset, names)
        layers = [layer for patch in self._patches for layer in layers_of(patch, axis)]
        by_shape = {shape: [own for own in layers if own.plan is shape] for shape in Shape.of_dimension(2)}
        self._columns = [columns_of(own, shape) for shape, own in by_shape.items() if own]
        self._height = self._common_height()
        self.blocks = [self._block(number) for number in range(len(self._columns))]
        self.fields = [SourceField(name, *self._order(dataset, number, name)) for number, name in enumerate(names)]
        self.boundaries = [own for name in dataset.boundaries if (own := self._boundary(dataset, name)).sides]
        self.time = dataset.time
        dropped = {CONVERTED, REPORT, MAP_KEY}
        self.metadata = {key: text for key, text in dataset.metadata.items() if key not in dropped}
        self.metadata |= {"AveragedAlong": "xyz"[axis]}

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The plane map of one element of each column."""
        columns: Columns = block.key
        found = np.empty((len(columns), len(points), 2))
        for number, stack in enumerate(columns.stacks):
            owned = np.flatnonzero(columns.first[:, 0] == number)
            if len(owned):
                rows = stack.rows[columns.first[owned, 1]]
                found[owned] = self._plane_map(stack, rows, points)
        return found[block.rows]

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The mean of a field over columns."""
        columns: Columns = block.key
        total = np.zeros((len(columns), len(points)))
        for stack in columns.stacks:
            for part, weighted in self._integrals(stack, field.key, points):
                np.add.at(total, stack.columns[part], weighted)
        return (total / self._height)[block.rows]

    def _plane_map(self, stack: Stack, rows: Ints, points: Floats) -> Floats:
        """(n, q, 2) positions of plane points of columns by elements ``rows`` of the patch."""
        patch = stack.layer.patch
        places = stack.layer.points(stack.plane(points), np.zeros(1))
        world = evaluate(patch.geometry, patch.geometry_coefficients[rows], places)
        return np.swapaxes(world[:, self._flat], 1, 2)

    def _integrals(self, stack: Stack, number: int, points: Floats) -> Iterator[tuple[slice, Floats]]:
        """Elements of a stack, some at a time, and the integrals (n, q) of a field along the axis."""
        patch = stack.layer.patch
        expansion, coefficients = patch.fields[number], patch.coefficients[number]
        assert expansion is not None
        assert coefficients is not None
        nodes, weights = gauss(max(expansion.modes) + max(patch.geometry.modes))
        places = stack.layer.points(stack.plane(points), nodes)
        for part in chunks(len(stack.rows), max(1, _BATCH // len(places))):
            rows = stack.rows[part]
            values = evaluate(expansion, coefficients[rows], places).reshape(len(rows), len(points), len(nodes))
            _, slopes = evaluate_with_gradients(
                patch.geometry, patch.geometry_coefficients[rows][:, self._axis], places
            )
            stretch = np.abs(slopes[..., stack.layer.direction]).reshape(values.shape)
            yield part, (values * stretch) @ weights

    def _common_height(self) -> float:
        """The height of all columns; ElvisError if some end before others, or maps of one column differ."""
        lowest, highest = np.inf, -np.inf
        for patch in self._patches:
            world = evaluate(patch.geometry, patch.geometry_coefficients[:, self._axis], patch.shape.vertices)
            lowest, highest = min(lowest, float(world.min())), max(highest, float(world.max()))
        height = highest - lowest
        for columns in self._columns:
            is_short = np.abs(columns.heights - height) > _ROUNDING * height
            if is_short.any():
                found = f"{is_short.sum()} of {len(columns)} with others, such as {columns.heights[is_short][0]:.6g}"
                raise ElvisError(f"{self._label}: expected columns of the height {height:.6g}, found {found}")
            self._check_maps(columns)
        return height

    def _check_maps(self, columns: Columns) -> None:
        """Raise ElvisError if elements of a column have different plane maps."""
        shape = columns.shape
        order = max(max(stack.layer.patch.geometry.modes) for stack in columns.stacks)
        points = inner_points(shape, order)
        maps = self.positions(Elements(shape, len(columns), key=columns), points)
        for stack in columns.stacks:
            deviation = np.abs(self._plane_map(stack, stack.rows, points) - maps[stack.columns]).max(axis=(1, 2))
            sizes = np.ptp(maps[stack.columns], axis=1).max(axis=1)
            worst = int((deviation / sizes).argmax())
            if deviation[worst] > TOLERANCE * sizes[worst]:
                element = stack.layer.patch.element_ids[stack.rows[worst]]
                raise ElvisError(
                    f"{self._label}: expected equal elements on top of one another, found element {element}, off by "
                    f"{deviation[worst] / sizes[worst]:.2g} of its size"
                )

    def _block(self, number: int) -> Elements:
        """The plane elements over the columns of a shape."""
        columns = self._columns[number]
        order = max(max(stack.layer.patch.geometry.modes) - 1 for stack in columns.stacks)
        return Elements(columns.shape, len(columns), order, key=columns)

    def _order(self, dataset: Dataset, number: int, name: str) -> tuple[list[int], bool, bool, int]:
        """Order on each block, continuity, whether it is a polynomial, and number of a field."""
        expansions = [patch.fields[number] for patch in self._patches]
        if None in expansions:
            raise ElvisError(f"{self._label}: expected fields on all elements, found {name} on some")
        order = max(max(own.modes) for own in expansions if own is not None) - 1
        return [order] * len(self._columns), bool(dataset.field(name).continuous), True, number

    def _boundary(self, dataset: Dataset, name: str) -> Boundary:
        """The sides of plane elements on a boundary along the axis; those across it are left out."""
        rows = Places(dataset, self._patches, {}).named(name).rows
        pieces = [piece for row in rows for piece in row.pieces if isinstance(piece, Piece) and piece.is_side]
        found: dict[tuple[int, int], list[Ints]] = {}
        for piece in pieces:
            for number, edge, owned in self._edges(piece):
                found.setdefault((number, edge), []).append(owned)
        merged = ((key, np.unique(np.concatenate(owned))) for key, owned in found.items())
        sides = [(number, owned, np.full(len(owned), edge)) for (number, edge), owned in merged]
        return Boundary(name, sides=sides)

    def _edges(self, piece: Piece) -> Iterator[tuple[int, int, Ints]]:
        """Edges of plane elements over the sides of elements: block, local edge, and rows in the block."""
        assert piece.number is not None
        vertices = piece.patch.shape.vertices[list(side_corners(piece.patch.shape, piece.number))]
        for number, columns in enumerate(self._columns):
            edges = [set(edge) for edge in columns.shape.edges]
            for stack in columns.stacks:
                is_along = np.ptp(vertices[:, stack.layer.direction]) > 0
                if is_along and stack.layer.patch is piece.patch:
                    owned = stack.columns[np.isin(stack.rows, piece.rows)]
                    yield number, edges.index(stack.corners_of(vertices)), owned
