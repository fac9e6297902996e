"""The native format itself: other orders, several field files in one, some of the fields, another form of file."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elvis.formats import read
from elvis.formats.arrays import Floats, Ints
from elvis.formats.bases import Basis
from elvis.formats.dataset import Dataset, Expansion
from elvis.formats.errors import FormatError
from elvis.formats.evaluation import evaluate
from elvis.formats.geometry import MAP_FIELDS
from elvis.formats.mesh import Composite, Mesh
from elvis.formats.nektar.sources import GZIP_SIGNATURE, HDF5_SIGNATURE
from elvis.formats.orientation import local_vertices
from elvis.formats.patch import Patch, patches
from elvis.formats.shapes import Shape
from elvis.plugins.conversion import Boundary, Converter, Elements, PyramidSpace, SourceField

_ROOT = re.compile(rb"<NEKTAR[\s>/]")
_PIECE = re.compile(r"(P\d+\.(xml(\.gz)?|fld)|Info\.xml)")
_HEAD = 1 << 16

#: differences of values at vertices, as a share of the field's range, below which a field may be continuous
_NEAR = 1e-14


@dataclass(frozen=True, eq=False)
class _Part:
    """Elements ``rows`` of a patch."""

    patch: Patch
    rows: Ints


class Native(Converter):
    """A mesh with the fields of any number of files."""

    format = "Nektar++ meshes and fields (.xml, .nekg, .fld)"
    keeps = "all shapes, bases and orders, curves, geometry maps, names of composites, time, metadata"
    loses = (
        "numbers of composites, turns of elements, bases other than the modified ones; Fourier directions are refused"
    )

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file or folder is of the native format."""
        return bool(paths) and all(_is_native(path) for path in paths)

    def __init__(self, paths: Sequence[Path]) -> None:
        dataset = read(*paths)
        if any(block.expansion.homogeneous for field in dataset.fields for block in field.blocks):
            raise FormatError("expected fields without Fourier directions, found some with", file=paths[0])
        maps = _map_names(dataset)
        names = [field.name for field in dataset.fields if field.name not in maps]
        self._parts = list(_parted(dataset.mesh, patches(dataset, names)))
        self.blocks = [_block(dataset.mesh, i, region, part) for i, (region, part) in enumerate(self._parts)]
        self.fields = [self._field(dataset, i, name) for i, name in enumerate(names)]
        self.boundaries = list(_boundaries(dataset.mesh))
        self.time = dataset.time
        self.metadata = {key: text for key, text in dataset.metadata.items() if key != "GeometryMap"}

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The map of the mesh, or of its fields."""
        part = self._parts[block.key][1]
        coefficients = part.patch.geometry_coefficients[part.rows[block.rows]]
        return evaluate(part.patch.geometry, coefficients, points).transpose(0, 2, 1)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The expansion of the field."""
        part = self._parts[block.key][1]
        expansion, coefficients = part.patch.fields[field.key], part.patch.coefficients[field.key]
        assert expansion is not None
        assert coefficients is not None
        return evaluate(expansion, coefficients[part.rows[block.rows]], points)

    def _field(self, dataset: Dataset, number: int, name: str) -> SourceField:
        expansions = [part.patch.fields[number] for _, part in self._parts]
        orders = [None if e is None else max(e.modes) - 1 for e in expansions]
        is_held = all(
            e is None or block.shape is not Shape.PYRAMID or _pyramid(e) is block.pyramid
            for e, block in zip(expansions, self.blocks, strict=True)
        )
        return SourceField(name, orders, self._may_be_continuous(number), is_held, key=number)

    def _may_be_continuous(self, number: int) -> bool:
        """Whether elements agree at the vertices that they share."""
        found = []
        for (_, part), block in zip(self._parts, self.blocks, strict=True):
            expansion, coefficients = part.patch.fields[number], part.patch.coefficients[number]
            if expansion is None or coefficients is None or block.vertices is None:
                return False
            values = evaluate(expansion, coefficients[part.rows], block.shape.vertices)
            found.append((block.vertices.reshape(-1), values.reshape(-1)))
        vertices, values = (np.concatenate(each) for each in zip(*found, strict=True))
        which = np.unique(vertices, return_inverse=True)[1].reshape(-1)
        low, high = np.full(which.max() + 1, np.inf), np.full(which.max() + 1, -np.inf)
        np.minimum.at(low, which, values)
        np.maximum.at(high, which, values)
        return bool((high - low).max() <= _NEAR * max(np.ptp(values), np.abs(values).max()))


def _is_native(path: Path) -> bool:
    try:
        if path.is_dir():
            return any(_PIECE.fullmatch(entry.name) for entry in path.iterdir())
        with path.open("rb") as file:
            head = file.read(_HEAD)
        if head.startswith(GZIP_SIGNATURE):
            head = zlib.decompressobj(wbits=31).decompress(head, _HEAD)
        return _holds_nektar(path) if head.startswith(HDF5_SIGNATURE) else bool(_ROOT.search(head))
    except (OSError, zlib.error):
        return False


def _holds_nektar(path: Path) -> bool:
    import h5py  # type: ignore[import-untyped]

    with h5py.File(path, "r") as file:
        return "NEKTAR" in file


def _map_names(dataset: Dataset) -> tuple[str, ...]:
    if "GeometryMap" not in dataset.metadata:
        return ()
    return tuple(name.strip() for name in dataset.metadata["GeometryMap"].split(",") if name.strip()) or MAP_FIELDS


def _parted(mesh: Mesh, found: Sequence[Patch]) -> Iterator[tuple[str, _Part]]:
    """Patches by the composites of the domain, with the names of these."""
    known = {composite.id: composite for composite in mesh.composites}
    domain = [known[c] for composites in mesh.domains.values() for c in composites if c in known]
    owner = {composite.id: np.concatenate([ids for _, ids in composite.parts]) for composite in domain}
    for patch in found:
        left = np.ones(len(patch), bool)
        for composite in domain:
            rows = np.flatnonzero(left & np.isin(patch.element_ids, owner[composite.id]))
            left[rows] = False
            if len(rows):
                yield _region(composite, len(domain) > len(mesh.elements)), _Part(patch, rows)
        if left.any():
            yield "", _Part(patch, np.flatnonzero(left))


def _region(composite: Composite, is_told_apart: bool) -> str:
    """The name of a composite of the domain; none where it only tells that these are all elements of a shape."""
    name = composite.name or (f"composite {composite.id}" if is_told_apart else "")
    return "" if name in {shape.label.lower() for shape in Shape} else name


def _block(mesh: Mesh, number: int, region: str, part: _Part) -> Elements:
    patch, entities = part.patch, mesh.of(part.patch.shape)
    ids = patch.element_ids[part.rows]
    order = np.argsort(entities.ids, kind="stable")
    rows = order[np.searchsorted(entities.ids, ids, sorter=order)]
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
            yield Boundary(composite.name or f"composite {composite.id}", vertices=vertices)


def _sides(mesh: Mesh, ids: Ints) -> Iterator[Ints]:
    """Vertex ids (n, k) of the vertices, edges, triangles and quadrilaterals of these ids."""
    if mesh.dimension == 1:
        yield ids[:, None]
        return
    for shape in Shape.of_dimension(mesh.dimension - 1):
        rows = np.flatnonzero(np.isin(mesh.of(shape).ids, ids))
        if len(rows):
            yield mesh.vertex_ids[local_vertices(mesh, shape)[rows]]
