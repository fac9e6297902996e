"""Sections of field files: elements of one shape and set of bases with the coefficients of all fields.

The two codecs of fields agree on this; `pieces` cuts a section into parts of one number of modes each.

The number of coefficients of an element is known in closed form, before anything is read (format notes 4).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, distinct
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Expansion, Homogeneous
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import ASCENDING, FAMILIES, FOURIER, LINE
from elvis.core.shapes import Shape
from elvis.formats.nektar.assembly import AT_ONCE, Lookup
from elvis.formats.nektar.numbers import split
from elvis.formats.nektar.packed import Packed

_SHAPE = re.compile(r"(\w+?)(?:-Homogene?ousExp([12])D)?(-Strips)?")
_ROWS_AT_ONCE = 1 << 14
_MOST_COEFFICIENTS = 1 << 50
_MOST_FOURIER_MODES = 1 << 16


@dataclass(frozen=True, eq=False)
class Space:
    """The attributes of a section.

    names        of the fields
    modes        (1, d) if all elements agree, else (n, d), for the shape's own directions
    homogeneous  None without Fourier directions
    """

    names: tuple[str, ...]
    shape: Shape
    bases: tuple[Basis, ...]
    modes: Ints
    homogeneous: Homogeneous | None

    def counts(self, elements: int) -> Ints:
        """(elements,) coefficients of each element and field, all planes or lines together."""
        return np.broadcast_to(self._counts_of_orders(), elements)

    def total(self, elements: int) -> int:
        """Coefficients of all elements and fields, with nothing as long as there are elements where all agree.

        Raises FormatError if no file could hold them.
        """
        counts = self._counts_of_orders()
        repeats = len(self.names) * (elements if len(counts) == 1 else 1)
        roughly = repeats * float(counts.sum(dtype=np.float64))
        if roughly > _MOST_COEFFICIENTS:
            raise FormatError(f"expected coefficients within the limits of a file, found {roughly:.3g} declared")
        return repeats * int(counts.sum())

    def _counts_of_orders(self) -> Ints:
        """(1,) or (n,) as the numbers of modes are given."""
        planes = 1 if self.homogeneous is None else len(self.homogeneous.z_ids)
        return coefficient_counts(self.shape, self.modes) * planes

    def check_elements(self, elements: int) -> None:
        """Raise FormatError if orders are given element by element for another number of elements."""
        if len(self.modes) not in (1, elements):
            raise FormatError(f"expected orders of {elements} elements, found {len(self.modes)}")


@dataclass(frozen=True, eq=False)
class Section:
    """A section read: element ids (n,) and values, field by field, element by element; none if only these count."""

    space: Space
    element_ids: Ints
    values: Floats | Packed | None
    file: str
    place: str

    def unpacked(self, is_wanted: Bools | None = None) -> Section:
        """The section with the values of some elements (n,), or of all, unpacked.

        Unchanged if its values are not packed.
        """
        if not isinstance(self.values, Packed):
            return self
        is_wanted = np.ones(len(self.element_ids), bool) if is_wanted is None else is_wanted
        modes = self.space.modes if len(self.space.modes) == 1 else self.space.modes[is_wanted]
        ids, values = self.element_ids[is_wanted], self.values.of(is_wanted).reshape(-1)
        return replace(self, space=replace(self.space, modes=modes), element_ids=ids, values=values)

    def of(self, wanted: Collection[str]) -> Section:
        """The section without the other fields; at least one of the requested ones exists."""
        names = self.space.names
        rows = [row for row, name in enumerate(names) if name in wanted]
        if len(rows) == len(names):
            return self
        space = replace(self.space, names=tuple(names[row] for row in rows))
        if self.values is None:
            return replace(self, space=space)
        if isinstance(self.values, Packed):
            return replace(self, space=space, values=self.values.of_fields(rows))
        fields = self.values.reshape(len(names), -1)
        # neighbours are not copied
        own = fields[rows[0] : rows[-1] + 1] if rows[-1] - rows[0] == len(rows) - 1 else fields[rows]
        return replace(self, space=space, values=own.reshape(-1))


def lacking(sections: Sequence[Section], mesh: Mesh) -> int:
    """Number of elements of sections that are not in the mesh."""
    known = [Lookup(entities.ids, "element") for entities in mesh.elements.values()]
    found = [np.empty(0, np.int64)]
    for ids in (section.element_ids for section in sections if known):
        for some in chunks(len(ids), AT_ONCE):
            is_there = np.any([lookup.present(ids[some]) for lookup in known], axis=0)
            found.append(ids[some][~is_there])
    return len(distinct(np.concatenate(found)))


@dataclass(frozen=True, eq=False)
class Piece:
    """Elements of one expansion: coefficients (fields, n, m)."""

    names: tuple[str, ...]
    expansion: Expansion
    element_ids: Ints
    coefficients: Floats


def read_space(
    fields: tuple[str, ...],
    shape_label: str,
    bases: tuple[Basis, ...],
    modes: Ints,
    homogeneous: tuple[tuple[float, ...], tuple[int, ...], tuple[int, ...], tuple[int, ...]],
) -> Space:
    """The space that the attributes describe.

    modes        (1, d) or (n, d), Fourier directions included
    homogeneous  lengths, y ids, z ids, strips
    Raises FormatError if they contradict each other, or are unknown to the format.
    """
    shape, directions = read_shape(shape_label)
    if not fields or len(set(fields)) < len(fields) or not all(fields):
        raise FormatError(f"expected names of fields, each once, found {','.join(fields) or 'none'}")
    if len(bases) != shape.dimension + directions:
        raise FormatError(f"expected {shape.dimension + directions} bases for {shape_label}, found {len(bases)}")
    if modes.shape[1] != len(bases):
        raise FormatError(f"expected {len(bases)} numbers of modes, found {modes.shape[1]}")
    check_bases(shape, bases[: shape.dimension])
    fourier = _homogeneous(bases[shape.dimension :], modes[0, shape.dimension :], *homogeneous) if directions else None
    return Space(fields, shape, bases[: shape.dimension], modes[:, : shape.dimension], fourier)


def read_shape(label: str) -> tuple[Shape, int]:
    """The shape and its number of Fourier directions."""
    found = _SHAPE.fullmatch(label.strip())
    try:
        if found:
            return Shape.from_label(found[1]), int(found[2] or 0)
    except KeyError:
        pass
    raise FormatError(f"expected a shape, found {label[:60]!r}")


def _homogeneous(
    bases: tuple[Basis, ...],
    modes: Ints,
    lengths: tuple[float, ...],
    y_ids: tuple[int, ...],
    z_ids: tuple[int, ...],
    strips: tuple[int, ...],
) -> Homogeneous:
    if wrong := [basis.label for basis in bases if basis not in FOURIER]:
        raise FormatError(f"expected Fourier bases in homogeneous directions, found {wrong[0]}")
    if len(lengths) != len(bases) or not all(0 < length < np.inf for length in lengths):
        raise FormatError(f"expected {len(bases)} lengths above zero, found {', '.join(map(str, lengths)) or 'none'}")
    if len(bases) == 1 and not z_ids and 0 < modes[0] <= _MOST_FOURIER_MODES:
        z_ids = tuple(range(int(modes[0])))  # files from before the ids were written
    if not z_ids or len(set(zip(y_ids, z_ids, strict=False) if y_ids else z_ids)) < len(z_ids):
        raise FormatError(f"expected ids of Fourier modes, each once, found {len(z_ids)}")
    if beyond := [number for number in (*y_ids, *z_ids) if not 0 <= number < _MOST_FOURIER_MODES]:
        raise FormatError(f"expected ids of Fourier modes from 0 to {_MOST_FOURIER_MODES - 1}, found {beyond[0]}")
    if len(bases) == 2 and len(y_ids) != len(z_ids):
        raise FormatError(f"expected as many y ids as z ids, found {len(y_ids)} and {len(z_ids)}")
    return Homogeneous(bases, lengths, z_ids, y_ids if len(bases) == 2 else (), strips)


def read_bases(labels: str) -> tuple[Basis, ...]:
    """Bases of a comma-separated list of names."""
    try:
        return tuple(Basis.from_label(label) for label in split(labels))
    except KeyError as error:
        raise FormatError(f"expected names of bases, found {error.args[0]!r}") from None


def pieces(section: Section, is_wanted: Bools) -> Iterator[Piece]:
    """The requested elements (n,) by numbers of modes, in the order of first appearance.

    If all elements of a uniform section are requested, they aren't copied.
    """
    if isinstance(section.values, Packed):
        section, is_wanted = section.unpacked(is_wanted), is_wanted[is_wanted]
    space, elements = section.space, len(section.element_ids)
    if not is_wanted.any():
        return
    assert not isinstance(section.values, Packed)
    values = np.empty((len(space.names), 0)) if section.values is None else section.values.reshape(len(space.names), -1)
    if (space.modes == space.modes[0]).all():
        wanted = np.s_[:] if is_wanted.all() else np.flatnonzero(is_wanted)
        width = values.shape[1] // elements
        own = values.reshape(len(space.names), elements, width)[:, wanted]
        yield Piece(space.names, _expansion(space, space.modes[0]), section.element_ids[wanted], own)
        return

    # rows of each group of equal modes
    distinct, first, group = np.unique(space.modes, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    rows_of = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])

    counts = space.counts(elements)
    starts = np.cumsum(counts) - counts
    for index in np.argsort(first):
        rows = rows_of[index][is_wanted[rows_of[index]]]
        if len(rows):
            width = 0 if section.values is None else int(counts[rows[0]])
            gathered = _gather(values, starts[rows], width)
            yield Piece(space.names, _expansion(space, distinct[index]), section.element_ids[rows], gathered)


def _expansion(space: Space, modes: Ints) -> Expansion:
    return Expansion(space.shape, space.bases, tuple(modes.tolist()), space.homogeneous)


def _gather(fields: Floats, starts: Ints, width: int) -> Floats:
    """(fields, n, width) values from ``starts`` on."""
    out = np.empty((len(fields), len(starts), width))
    for low in range(0, len(starts), _ROWS_AT_ONCE):
        places = starts[low : low + _ROWS_AT_ONCE, None] + np.arange(width)
        for field, target in zip(fields, out, strict=True):
            np.take(field, places, out=target[low : low + _ROWS_AT_ONCE])
    return out


#: more modes in one direction than any solver uses; a bound on the demands of a damaged file
MOST_MODES = 1024


def _admissible(shape: Shape) -> tuple[frozenset[Basis], ...]:
    """By direction, the bases that a file may use: those of all families, and any line basis if the direction has one.

    Not all of these can be evaluated: a file is read even if its bases don't belong together.
    """
    directions = zip(*FAMILIES[shape], strict=True)
    known = (frozenset().union(*bases) for bases in directions)
    return tuple(bases.union(LINE) if bases.intersection(LINE) else bases for bases in known)


_ADMISSIBLE: Mapping[Shape, tuple[frozenset[Basis], ...]] = {shape: _admissible(shape) for shape in Shape}


def _triangle(p: Ints, q: Ints) -> Ints:
    return p * (p + 1) // 2 + p * (q - p)


def _tetrahedron(p: Ints, q: Ints, r: Ints) -> Ints:
    """The sum over i < p, j < q - i of r - i - j."""
    twelvefold: Ints = 12 * p * q * r - 6 * p * q * (q - 1) - 3 * (2 * r + 1) * p * (p - 1) + p * (p - 1) * (2 * p - 1)
    return twelvefold // 12


def _pyramid(p: Ints, q: Ints, r: Ints) -> Ints:
    """The sum over i < p, j < q of r - max(i, j)."""
    low, high = np.minimum(p, q), np.maximum(p, q)
    square: Ints = low * low * r - low * (low - 1) * (4 * low + 1) // 6
    rest: Ints = low * ((high - low) * r - (high * (high - 1) - low * (low - 1)) // 2)
    return square + rest


_COUNTS: Mapping[Shape, Callable[..., Ints]] = {
    Shape.SEGMENT: lambda p: p,
    Shape.TRIANGLE: _triangle,
    Shape.QUADRILATERAL: lambda p, q: p * q,
    Shape.TETRAHEDRON: _tetrahedron,
    Shape.PYRAMID: _pyramid,
    Shape.PRISM: lambda p, q, r: q * _triangle(p, r),
    Shape.HEXAHEDRON: lambda p, q, r: p * q * r,
}


def coefficient_counts(shape: Shape, modes: Ints) -> Ints:
    """(k,) numbers of coefficients for the numbers of modes (k, d), one row an element.

    Raises FormatError if a number isn't in 1 to MOST_MODES, or they don't ascend on a collapsed shape.
    """
    outside = (modes < 1) | (modes > MOST_MODES)
    if outside.any():
        raise FormatError(f"expected 1 to {MOST_MODES} modes in a direction, found {modes[outside].flat[0]}")
    for low, high in ASCENDING[shape]:
        wrong = np.flatnonzero(modes[:, low] > modes[:, high])
        if len(wrong):
            found = ",".join(map(str, modes[wrong[0]].tolist()))
            raise FormatError(f"expected ascending numbers of modes on a {shape.label.lower()}, found {found}")
    return _COUNTS[shape](*modes.T.astype(np.int64))


def check_bases(shape: Shape, bases: tuple[Basis, ...]) -> None:
    """Raise FormatError if a shape can't have these bases; data from before 5.0 on pyramids are named as such."""
    if shape is Shape.PYRAMID and Basis.MODIFIED_C in bases:
        message = "expected ModifiedPyr_C on pyramids, found Modified_C: written before version 5.0, in another layout"
        raise FormatError(message)
    allowed = _ADMISSIBLE[shape]
    if len(bases) != len(allowed) or any(b not in set_ for b, set_ in zip(bases, allowed, strict=True)):
        found = ",".join(basis.label for basis in bases) or "none"
        raise FormatError(f"expected {len(allowed)} bases that fit a {shape.label.lower()}, found {found}")


Numbering = Mapping[int, Basis]

#: Bases by their numbers in HDF5 fields, today and before March 2017 (format notes 10).  The two pyramid bases added
#: then, 7 and 8, moved all later numbers by two.
TODAY: Numbering = {int(basis): basis for basis in Basis}
_PYRAMIDS = (Basis.ORTHO_PYR_C, Basis.MODIFIED_PYR_C)
BEFORE: Numbering = dict(enumerate(basis for basis in Basis if basis not in _PYRAMIDS))

#: the last version that uses the numbers from before March 2017
_LAST = (4, 4)


def numbering(definitions: Iterable[tuple[Sequence[object], Shape]], version: str = "") -> Numbering:
    """The numbering of a file: today's, unless only the earlier one makes sense or the program is that old.

    definitions  the numbers of each section and its shape; those beyond the shape's dimension are of Fourier directions
    version      of the program that wrote the file, empty if the file doesn't say
    """
    known = list(definitions)
    fit_today, fit_before = (all(_fits(codes, shape, each) for codes, shape in known) for each in (TODAY, BEFORE))
    return BEFORE if fit_before and (not fit_today or _is_before(version)) else TODAY


def _fits(codes: Sequence[object], shape: Shape, meaning: Numbering) -> bool:
    """Whether a section could have these bases."""
    if not all(isinstance(code, int) and code in meaning for code in codes):
        return False
    bases = tuple(meaning[code] for code in codes if isinstance(code, int))
    try:
        check_bases(shape, bases[: shape.dimension])
    except FormatError:
        return False
    return frozenset(FOURIER).issuperset(bases[shape.dimension :])


def _is_before(version: str) -> bool:
    found = re.match(r"\s*(\d+)\.(\d+)", version)
    return found is not None and (int(found[1]), int(found[2])) <= _LAST
