"""The native format itself: other orders, several field files in one, some of the fields, another form of file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns, joined_ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import MAP_KEY, Dataset, Expansion
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count
from elvis.core.shapes import Shape
from elvis.formats.reading import is_native, read
from elvis.plugins.conversion.plugin import Boundary, Converter, Elements, Option, PyramidSpace, Reads, SourceField

#: differences of values at vertices, as a share of the field's range, below which a field may be continuous
_NEAR = 1e-14


@dataclass(frozen=True, eq=False)
class _Part:
    """Elements ``rows`` of a patch."""

    patch: Patch
    rows: Ints

    def plane(self, field: int, number: int) -> tuple[Expansion, Floats] | None:
        """A Fourier plane of a field, the field itself where it has none; None if the patch lacks the field."""
        expansion, coefficients = self.patch.fields[field], self.patch.coefficients[field]
        if expansion is None or coefficients is None:
            return None
        flat = replace(expansion, homogeneous=None)
        count = mode_count(flat)
        return flat, coefficients[:, number * count : (number + 1) * count]


class Native(Converter):
    """A mesh with the fields of any number of files."""

    format = "Nektar++ meshes and fields (.xml, .nekg, .fld)"
    keeps = (
        "the mesh with its numbers, curves, composites, domains; all shapes, orders, Fourier planes; time, metadata, "
        "conditions"
    )
    loses = "bases other than the modified ones; with --composites numbers, turns and conditions"
    reads = Reads(
        "all",
        "any",
        "all of the solver, Fourier",
        "composites by name",
        "numbered files",
        "folders of parts",
        "no",
        "Fourier planes",
    )
    options = (Option("composites", "Composites of the domain to convert: names or numbers, separated by commas."),)

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file or folder is of the native format."""
        return bool(paths) and all(is_native(path) for path in paths)

    def __init__(self, paths: Sequence[Path], composites: str | None = None) -> None:
        self._take(read(*paths), composites)

    @classmethod
    def of(cls, dataset: Dataset, composites: str | None = None) -> Native:
        """The converter of data at hand."""
        found = cls.__new__(cls)
        found._take(dataset, composites)
        return found

    def _take(self, dataset: Dataset, composites: str | None) -> None:
        names = [field.name for field in dataset.solution]
        self.mesh = dataset.mesh if composites is None else None
        wanted = None if composites is None else _composites_named(dataset.mesh, composites)
        self._parts = list(_split_patches(dataset.mesh, patches(dataset, names), wanted))
        self.blocks = [_block(dataset.mesh, i, region, part) for i, (region, part) in enumerate(self._parts)]
        self.fields = [plane for i, name in enumerate(names) for plane in self._planes(i, name)]
        self.boundaries = list(_boundaries(dataset.mesh))
        lost = ConversionErrors.of(dataset.metadata)
        self.errors = {name: (own.value, own.slope) for name, own in [("", lost.place), *lost.fields.items()]}
        self.time = dataset.time
        self.metadata = {key: text for key, text in dataset.metadata.items() if key != MAP_KEY}
        if composites is None:
            self.expansions, self.session = dataset.expansions, dataset.session
        elif dataset.session:
            tags = ", ".join(dataset.session)
            self.notes = [f"sections of the session, which name composites by number, are skipped: {tags}"]

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The map of the mesh, or of its fields."""
        part = self._parts[block.key][1]
        coefficients = part.patch.geometry_coefficients[part.rows[block.rows]]
        return evaluate(part.patch.geometry, coefficients, points).transpose(0, 2, 1)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The expansion of the field, or of one of its planes."""
        part, (number, plane) = self._parts[block.key][1], field.key
        found = part.plane(number, plane)
        assert found is not None
        expansion, coefficients = found
        return evaluate(expansion, coefficients[part.rows[block.rows]], points)

    def _planes(self, number: int, name: str) -> Iterator[SourceField]:
        """A field, or one for each of its Fourier planes."""
        expansions = [part.patch.fields[number] for _, part in self._parts]
        orders = [None if e is None else max(e.modes) - 1 for e in expansions]
        modes = [None if e is None else e.modes for e in expansions]
        is_held = all(
            e is None or block.shape is not Shape.PYRAMID or _pyramid(e) is block.pyramid
            for e, block in zip(expansions, self.blocks, strict=True)
        )
        waves = {e.homogeneous for e in expansions if e is not None}
        if len(waves) > 1:
            raise FormatError(f"expected the same Fourier directions on all elements, found {len(waves)}", place=name)
        homogeneous = next(iter(waves), None)
        for plane in range(len(homogeneous.z_ids) if homogeneous else 1):
            is_continuous = self._may_be_continuous(number, plane)
            yield SourceField(name, orders, is_continuous, is_held, (number, plane), homogeneous, modes)

    def _may_be_continuous(self, number: int, plane: int) -> bool:
        """Whether elements agree at the vertices that they share."""
        found = []
        for (_, part), block in zip(self._parts, self.blocks, strict=True):
            own = part.plane(number, plane)
            if own is None or block.vertices is None:
                return False
            values = evaluate(own[0], own[1][part.rows], block.shape.vertices)
            found.append((block.vertices.reshape(-1), values.reshape(-1)))
        if not found:
            return False
        vertices, values = joined_columns(found)
        which = np.unique(vertices, return_inverse=True)[1].reshape(-1)
        low, high = np.full(which.max() + 1, np.inf), np.full(which.max() + 1, -np.inf)
        np.minimum.at(low, which, values)
        np.maximum.at(high, which, values)
        return bool((high - low).max() <= _NEAR * max(np.ptp(values), np.abs(values).max()))


def _composites_named(mesh: Mesh, names: str) -> list[Composite]:
    """Composites of the domain by names or numbers; raises ElvisError if the domain has none of that name."""
    domain = mesh.domain_composites()
    found = []
    for name in (part.strip() for part in names.split(",")):
        own = [c for c in domain if name in (c.name, str(c.id))]
        if not own:
            known = ", ".join(f"{c.id} {c.name or ''}".strip() for c in domain) or "none"
            raise ElvisError(f"there is no composite {name!r} in the domain; there are: {known}")
        found += own
    return found


def _split_patches(
    mesh: Mesh, found: Sequence[Patch], wanted: Sequence[Composite] | None
) -> Iterator[tuple[str, _Part]]:
    """Patches whole; or, of composites that are ``wanted``, parted by these, with their names."""
    if wanted is None:
        yield from (("", _Part(patch, np.arange(len(patch)))) for patch in found)
        return
    tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
    for patch in found:
        left = np.ones(len(patch), bool)
        for composite in wanted:
            owned = [ids for tag, ids in composite.parts if tag in tags or mesh.dimension < 3]
            rows = np.flatnonzero(left & np.isin(patch.element_ids, joined_ints(owned)))
            left[rows] = False
            if len(rows):
                yield _region(composite, True), _Part(patch, rows)


def _region(composite: Composite, is_told_apart: bool) -> str:
    """The name of a composite of the domain; empty if it only states that these are all elements of a shape."""
    name = composite.name or composite.label or (f"composite {composite.id}" if is_told_apart else "")
    return "" if name in {shape.label.lower() for shape in Shape} else name


def _block(mesh: Mesh, number: int, region: str, part: _Part) -> Elements:
    patch, entities = part.patch, mesh.of(part.patch.shape)
    ids = patch.element_ids[part.rows]
    rows = entities.rows_of(ids)
    fields = [expansion for expansion in patch.fields if expansion is not None]
    return Elements(
        patch.shape,
        len(ids),
        max(patch.geometry.modes) - 1,
        mesh.vertex_ids[local_vertices(mesh, patch.shape)[rows]],
        ids=ids,
        region=region,
        pyramid=_pyramid(fields[0]) if fields else PyramidSpace.NATIVE,
        key=number,
    )


def _pyramid(expansion: Expansion) -> PyramidSpace:
    return PyramidSpace.POLYNOMIAL if expansion.bases[-1] is Basis.ORTHO_PYR_C else PyramidSpace.NATIVE


def _boundaries(mesh: Mesh) -> Iterator[Boundary]:
    """Composites of faces, of edges in 2D, of vertices in 1D."""
    tags = {1: {"V"}, 2: {"E", "S"}, 3: {"F", "T", "Q"}}[mesh.dimension]
    for composite in mesh.composites:
        ids = [own for tag, own in composite.parts if tag in tags]
        if ids:
            vertices = list(_sides(mesh, np.concatenate(ids)))
            name = composite.name or composite.label or f"composite {composite.id}"
            yield Boundary(name, vertices=vertices, number=composite.id)


def _sides(mesh: Mesh, ids: Ints) -> Iterator[Ints]:
    """Vertex ids (n, k) of the vertices, edges, triangles and quadrilaterals of these ids."""
    if mesh.dimension == 1:
        yield ids[:, None]
        return
    for shape in Shape.of_dimension(mesh.dimension - 1):
        rows = np.flatnonzero(np.isin(mesh.of(shape).ids, ids))
        if len(rows):
            yield mesh.vertex_ids[local_vertices(mesh, shape)[rows]]
