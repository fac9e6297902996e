"""Coefficients from samples of coordinates and fields, block by block, with one trace on shared entities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_ints, largest
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.terminal import track
from elvis.core.data.dataset import Expansion
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.projections import Operator, best, conforming
from elvis.core.polynomials.expansion import mode_count, mode_indices
from elvis.core.polynomials.interpolation import modified
from elvis.plugins.conversion.plugin import SourceField
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.spaces import is_contained
from elvis.plugins.projection.traces import Skins, Traces

#: quadrature points each way beyond the order, for what isn't in the space
_EXTRA = 1

#: share of the largest coordinate up to which elements agree on what they share
_AGREEING = 1e-12


@dataclass(frozen=True, eq=False)
class FieldFit:
    """A field on native blocks.

    modes         number of modes in each direction on each block, 0 on blocks without the field
    coefficients  (n, m) on each block, (n, 0) on blocks without the field
    jump          largest difference of coefficients between elements that share an entity, 0 if not measured
    is_continuous whether elements that share an entity have the same coefficients
    """

    field: SourceField
    modes: tuple[int, ...]
    coefficients: tuple[Floats, ...]
    jump: float = 0.0
    is_continuous: bool = False


def field_modes(block: NativeBlock, field: SourceField) -> int:
    """Number of modes each way in which a field is projected on a block: at least 2, or 0 if the block lacks it."""
    order = field.order_on(block.number)
    return 0 if order is None else max(2, block.modes or order + 1)


def operator(block: NativeBlock, field: SourceField, modes: int) -> Operator:
    """The projection of a field on a block."""
    order = field.order_on(block.number) or 0
    source = block.source
    is_exact = field.is_polynomial and is_contained(source, order, modes - 1, block.is_ortho, block.is_collapsed)
    extra = 0 if is_exact else _EXTRA
    if field.is_continuous and not block.is_ortho:
        return conforming(block.expansion(modes), extra)
    return best(block.expansion(modes), extra)


def fit_fields(sampler: Sampler, blocks: Sequence[NativeBlock], fields: Sequence[SourceField]) -> list[FieldFit]:
    """The fields on the blocks, each element for itself."""
    modes = [[field_modes(block, field) for block in blocks] for field in fields]
    found = [
        [np.empty((len(b), mode_count(b.expansion(n)) if n else 0)) for b, n in zip(blocks, own, strict=True)]
        for own in modes
    ]
    for number, rows, points, group in track(list(_work(sampler, blocks, fields)), "projecting"):
        for i, which in group:
            with np.errstate(invalid="ignore"):  # values that are not finite remain so
                found[i][number][rows] = sampler.fitted(blocks[number], rows, fields[i], points, which.fit)
    return [FieldFit(f, tuple(n), tuple(c)) for f, n, c in zip(fields, modes, found, strict=True)]


def _work(
    sampler: Sampler, blocks: Sequence[NativeBlock], fields: Sequence[SourceField]
) -> Iterator[tuple[int, slice | Ints, Floats, list[tuple[int, Operator]]]]:
    """Block number, rows, points, and the fields to sample there with the operators that ask for these points."""
    for number, block in enumerate(blocks):
        groups: dict[int, list[tuple[int, Operator]]] = {}
        for i, field in enumerate(fields):
            if not field.is_on(block.number):
                continue
            own = operator(block, field, field_modes(block, field))
            groups.setdefault(id(own.points), []).append((i, own))
        for group in groups.values():
            for rows, points in sampler.batches(block, group[0][1].points):
                yield number, rows, points, group


@dataclass(frozen=True, eq=False)
class Positions:
    """The coordinates of elements, and what elements share of them.

    columns  (3, n, m) coefficients on each block of the traces; none if they are not needed again
    space    number of axes up to the last with coordinates other than 0
    """

    columns: list[Floats]
    skins: Skins
    space: int

    def is_on(self, blocks: Sequence[NativeBlock]) -> bool:
        """Whether these are the coordinates of ``blocks``, which has no empty blocks."""
        kept = [own for own in self.skins.blocks if len(own)]
        is_alike = len(kept) == len(blocks) and all(own.rows is b.rows for own, b in zip(kept, blocks, strict=True))
        return bool(self.columns) and is_alike

    def joined(self) -> list[Floats] | None:
        """The coefficients (3, n, m) on blocks that aren't empty, with one trace on what elements share.

        They are changed in place.  None if those of shared entities differ by more than rounding.
        """
        magnitude = max(map(largest, self.columns), default=0.0)
        change = self.skins.apply([own.transpose(1, 0, 2) for own in self.columns]).max(initial=0)
        agrees = change <= _AGREEING * magnitude
        return [own for own in self.columns if own.shape[1]] if agrees else None


def fit_positions(
    sampler: Sampler, mesh: Mesh, blocks: Sequence[NativeBlock], in_own_space: bool = False, is_kept: bool = True
) -> Positions:
    """The coordinates on the blocks.

    in_own_space  in each block's own expansion; else in the Modified one, whose edges and faces a mesh file holds
    is_kept       whether the coefficients are needed again
    """
    operators = [position_operator(block, in_own_space) for block in blocks]
    sizes = zip(map(len, blocks), operators, strict=True)
    columns = [np.empty((3, count, own.matrix.shape[1])) for count, own in sizes] if is_kept else []
    is_used = np.zeros(3, bool)

    def parts() -> Iterator[tuple[int, slice | Ints, Floats]]:
        for number, rows, own in _mapped(sampler, blocks, operators):
            np.logical_or(is_used, own.any(axis=(0, 2)), out=is_used)
            if is_kept:
                columns[number][:, rows] = own.transpose(1, 0, 2)
            yield number, rows, own

    modes = [0 if block.is_ortho and in_own_space else block.source.order + 1 for block in blocks]
    skins = Traces(mesh, blocks, modes).taken(parts(), 3)
    return Positions(columns, skins, 1 + int(np.flatnonzero(is_used).max(initial=0)))


def _mapped(
    sampler: Sampler, blocks: Sequence[NativeBlock], operators: Sequence[Operator]
) -> Iterator[tuple[int, slice | Ints, Floats]]:
    """Block, rows and coefficients (k, 3, m) of the coordinates there, a batch at a time."""
    for number, (block, which) in enumerate(zip(blocks, operators, strict=True)):
        for rows, points in track(list(sampler.batches(block, which.points)), "mapping"):
            yield number, rows, sampler.fitted(block, rows, None, points, which.fit)


def position_operator(block: NativeBlock, in_own_space: bool) -> Operator:
    """The projection of the coordinates of a block."""
    source, modes = block.source, block.source.order + 1
    is_ortho = block.is_ortho and in_own_space
    is_exact = source.is_polynomial and is_contained(source, source.order, source.order, is_ortho, block.is_collapsed)
    extra = 0 if is_exact else _EXTRA
    if is_ortho:
        return best(block.expansion(modes), extra)
    return conforming(modified(block.shape, (modes,) * block.shape.dimension), extra)


def join_traces(fitted: FieldFit, traces: Traces) -> FieldFit:
    """The field with one trace on every shared entity: its coefficients are changed in place, by up to ``jump``."""
    wide = [own[:, None, :] for own in fitted.coefficients]
    jump = float(traces.gather(wide).apply(wide)[0])
    return FieldFit(fitted.field, fitted.modes, fitted.coefficients, jump, True)


def padded(coefficients: Floats, few: Expansion, many: Expansion) -> Floats:
    """Coefficients (..., m) in another expansion of the same family: new ones are zero, missing ones are dropped."""
    if few == many:
        return coefficients
    result = np.zeros((*coefficients.shape[:-1], len(mode_indices(many))))
    places = _places(few, many)
    result[..., places[places >= 0]] = coefficients[..., places >= 0]
    return result


def beyond(coefficients: Floats, few: Expansion, many: Expansion) -> float:
    """The largest of the coefficients (..., m) that the expansion ``many`` has no function for."""
    return float(np.abs(coefficients[..., _places(few, many) < 0]).max(initial=0.0))


@bounded_cache
def _places(few: Expansion, many: Expansion) -> Ints:
    """Positions (m,) in ``many`` of the functions of ``few``; -1 for missing ones."""
    known = {tuple(index): number for number, index in enumerate(mode_indices(many).tolist())}
    return frozen_ints(np.array([known.get(tuple(index), -1) for index in mode_indices(few).tolist()], np.int64))
