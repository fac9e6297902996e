"""Elements that are inverted or folded, found quickly enough for every command.

Most elements pass a test that costs little (`regularity`).  The rest is proved as in `validity`, up to a limit of work.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, distinct, joined_ints
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import Assembly, GeometryBlock, Part, parts
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.expansion import values
from elvis.core.shapes import Shape
from elvis.core.validity.regularity import are_regular
from elvis.core.validity.validity import TOUCHING, ValidityStatus, validity

#: determinant of a straight simplex, relative to the product of its edges, that exceeds rounding
ROUNDING = 1e-13
#: number of elements examined together, and maximum number of coefficients of determinants' nets that are proved
TOGETHER = 1 << 11
PROVED_NUMBERS = 1 << 23
#: straight simplices examined together
SIMPLICES = 1 << 14
#: number of ids in a message
LISTED = 5


@dataclass(frozen=True, eq=False)
class Folded:
    """Elements whose Jacobian is not positive all over.

    wrong      (n,) ids of elements where it is proved not to be positive somewhere
    undecided  (m,) ids of those where that could not be decided; no elements where it is not negative for certain
    """

    wrong: Ints
    undecided: Ints

    @staticmethod
    def joined(parts: Sequence[Folded]) -> Folded:
        """The combined results for parts of a dataset."""
        wrong, undecided = (
            distinct(joined_ints(ids)) for ids in ([own.wrong for own in parts], [own.undecided for own in parts])
        )
        return Folded(wrong, undecided)

    def sentences(self) -> Iterator[str]:
        """Messages that every command prints."""
        if len(self.wrong):
            yield (
                f"{_elements(self.wrong)} inverted or folded, because the Jacobian is not positive everywhere "
                f"({_some(self.wrong)}): integrals use its absolute value there (elvis integrate --jacobian signed "
                "keeps the sign), points may have several reference positions, and quadrature may not converge, "
                "because |J| has a kink; elvis info --jacobian shows where"
            )
        if len(self.undecided):
            yield (
                f"{_elements(self.undecided)} perhaps folded, because it could not be decided whether the Jacobian is "
                f"positive everywhere ({_some(self.undecided)}); elvis info --jacobian shows details"
            )


def folded(dataset: Dataset, ranks: Ranks = ALONE, suspects: Ints | None = None) -> Folded:
    """The elements of a dataset whose validity is not certain; for several ranks, of all parts.

    suspects  ids of all elements that don't pass `are_unfolded`, where these are known

    If space has more dimensions than the elements, the determinant has no sign, and the result is empty.  Segments on a
    line may run either way.
    """
    wrong, undecided = np.empty(0, np.int64), np.empty(0, np.int64)
    if dataset.mesh.space == dataset.mesh.dimension:
        wrong, undecided = _of_suspects(dataset, suspects)
    every = ranks.exchange((wrong, undecided), "elements that fold")
    return Folded.joined([Folded(*own) for own in every])


def are_unfolded(part: Part, rows: Ints, coefficients: Floats | None = None) -> Bools:
    """(n,) whether elements ``rows`` (n,) of a part of the map pass the quick test; False proves nothing.

    coefficients  (n, 3, m) of these elements, where they are at hand
    """
    is_simplex = part.expansion.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON)
    if isinstance(part, Assembly) and part.is_straight and is_simplex:
        return _are_positive_simplices(part.skeleton.vertices[part.vertices[part.rows[rows]]])
    own = part.take(rows) if coefficients is None else coefficients
    return are_regular(part.expansion, _forward(part, own))


def _suspects(dataset: Dataset, known: Ints | None) -> Iterator[tuple[Part, Ints]]:
    """Parts of the map, and rows (n,) of elements that don't pass the quick test, or that have ``known`` ids."""
    for part in parts(dataset):
        if known is not None:
            yield part, np.flatnonzero(np.isin(part.element_ids, known))
            continue
        together = SIMPLICES if max(part.expansion.modes) == 2 else TOGETHER
        for chunk in chunks(len(part), together):
            rows = np.arange(chunk.start, chunk.stop)
            yield part, rows[~are_unfolded(part, rows)]


def _forward(part: Part, coefficients: Floats) -> Floats:
    """Coefficients (n, 3, m) of elements; for segments that run backwards, coefficients of their mirror image."""
    if part.expansion.shape is not Shape.SEGMENT:
        return coefficients
    start, end = values(part.expansion, Shape.SEGMENT.vertices)
    direction = np.sign(coefficients[:, 0] @ (end - start))
    return np.asarray(coefficients * np.where(direction < 0, -1.0, 1.0)[:, None, None])


def _are_positive_simplices(corners: Floats) -> Bools:
    """(n,) whether straight simplices with corners (n, d + 1, 3) have a positive determinant."""
    dimension = corners.shape[1] - 1
    edges = (corners[:, 1:] - corners[:, :1])[:, :, :dimension]
    sizes = np.linalg.norm(edges, axis=2).prod(axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.det(edges) > ROUNDING * sizes)


def _of_suspects(dataset: Dataset, known: Ints | None) -> tuple[Ints, Ints]:
    """Ids of elements that are proved not to be positive, and of undecided ones, among ``known`` suspects if given."""
    wrong, undecided = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    left = PROVED_NUMBERS
    for part, rows in _suspects(dataset, known):
        if not len(rows):
            continue
        size = (3 * max(part.expansion.modes)) ** part.expansion.shape.dimension
        count = min(len(rows), left // size)
        left -= count * size
        ids = part.element_ids
        own = GeometryBlock(part.expansion, ids[rows[:count]], _forward(part, part.take(rows[:count])))
        found = validity(dataset, [own])
        wrong.append(found.element_ids[found.status == ValidityStatus.NOT_POSITIVE])
        is_nonnegative = found.lower >= -TOUCHING * found.error
        undecided.append(found.element_ids[(found.status == ValidityStatus.UNDECIDED) & ~is_nonnegative])
        undecided.append(ids[rows[count:]])
    return np.concatenate(wrong), np.concatenate(undecided)


def _elements(ids: Ints) -> str:
    return f"{len(ids)} elements are" if len(ids) > 1 else "1 element is"


def _some(ids: Ints) -> str:
    return ", ".join(map(str, ids[:LISTED].tolist())) + (", …" if len(ids) > LISTED else "")
