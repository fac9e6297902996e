"""Names for the arrays of the project.

Axis convention, everywhere: points are ``(n, d)``, values ``(n,)``, modes ``(n, m)``; the last axis is contiguous.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Sized
from itertools import pairwise
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]
#: structured arrays: NumPy's types say nothing of their columns, over which a type checker puzzles for seconds a line
Records: TypeAlias = Any
#: distance of 1 from the next number
EPS = float(np.finfo(np.float64).eps)
#: type of the numbers of arrays
Number = TypeVar("Number", bound=np.generic)


def frozen_floats(values: object) -> Floats:
    """``values`` as a read-only, C-contiguous float64 array; no copy where none is needed."""
    array = np.ascontiguousarray(values, dtype=np.float64).view()
    array.flags.writeable = False
    return array


def frozen_ints(values: object) -> Ints:
    """``values`` as a read-only, C-contiguous int64 array; no copy where none is needed."""
    array = np.ascontiguousarray(values, dtype=np.int64).view()
    array.flags.writeable = False
    return array


def frozen_view(values: NDArray[Any]) -> NDArray[Any]:
    """A read-only view of an array without conversion: mapped or not, of any type."""
    array = values.view()
    array.flags.writeable = False
    return array


def index_type(below: int) -> Any:
    """Type of numbers less than ``below``: 32 bits where these are enough.

    Products of two such numbers need 64 bits: `pair_numbers`.
    """
    return np.int32 if below <= 1 << 31 else np.int64


def narrow_ints(values: Ints, below: int) -> NDArray[Any]:
    """Numbers from 0 up, less than ``below``, read-only, of 32 bits where these are enough for all such."""
    return frozen_view(np.ascontiguousarray(values, index_type(below)))


def numbered(count: int, first: int = 0) -> NDArray[Any]:
    """(count,) numbers from ``first`` up, as by `narrow_ints`."""
    return frozen_view(np.arange(first, first + count, dtype=index_type(first + count)))


def pair_numbers(first: Ints, second: Ints, count: int) -> Ints:
    """A 64-bit number for each pair of numbers of any type, the second ones less than ``count``."""
    return np.asarray(first.astype(np.int64) * count + second)


def concatenated(arrays: Sequence[NDArray[Number]], axis: int = 0) -> NDArray[Number]:
    """Arrays one after another along an axis; without a copy if there is only one."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis)


def joined_ints(parts: Iterable[NDArray[Any]]) -> Ints:
    """Arrays (n,) of whole numbers as one array; an empty one if there are none."""
    return np.concatenate([np.empty(0, np.int64), *parts])


def joined_floats(parts: Iterable[NDArray[Any]]) -> Floats:
    """Arrays (n,) of numbers as one array; an empty one if there are none."""
    return np.concatenate([np.empty(0), *parts])


def starts_of(parts: Iterable[Sized]) -> Ints:
    """(n + 1,) where each of n parts starts if they stand one after another, and where the last one ends."""
    return np.cumsum([0, *map(len, parts)])


def joined_columns(rows: Iterable[Sequence[NDArray[Any]]]) -> tuple[NDArray[Any], ...]:
    """The arrays of each column of a table, joined."""
    return tuple(np.concatenate(column) for column in zip(*rows, strict=True))


def grid_points(*lines: Any) -> NDArray[Any]:
    """(n, d) the points whose coordinates are on d lines, along the last one next to each other."""
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(lines))


def every_pair(rows: Ints, points: Floats) -> tuple[Ints, Floats]:
    """(n k,) rows and (n k, d) points: all pairs of rows (n,) and points (k, d), row by row."""
    return np.repeat(rows, len(points)), np.tile(points, (len(rows), 1))


def largest(values: Floats) -> float:
    """The largest magnitude of values, 0 without any; no array is made."""
    return float(max(values.max(initial=0.0), -values.min(initial=0.0)))


def among(numbers: Ints, others: Ints) -> Bools:
    """(n,) which of numbers are among others.

    If there are no numbers, others are not examined, unlike in ``np.isin``.
    """
    return np.isin(numbers, others) if len(numbers) else np.zeros(0, bool)


def rows_of(ids: Ints, wanted: Ints) -> Ints:
    """(m,) the row of each of the requested ids (m,) among distinct ids (n,), which hold all of them, in any order."""
    order = np.argsort(ids, kind="stable")
    return np.asarray(order[np.searchsorted(ids, wanted, sorter=order)])


def distinct(numbers: Ints) -> Ints:
    """(m,) the distinct numbers of (n,), ascending; the same array if it is already strictly ascending.

    Sorts, since the hash table that ``np.unique`` fills is slower for arrays of millions.
    """
    if (numbers[1:] > numbers[:-1]).all():
        return numbers
    ordered = np.sort(numbers)
    is_first = np.ones(len(ordered), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=is_first[1:])
    return np.asarray(ordered[is_first])


def distinct_bits(rows: NDArray[Any]) -> tuple[Ints, Ints]:
    """The first row (m,) of each distinct one of rows (n, k) of numbers, and which of these each row is (n,).

    Rows are compared by their bytes.  Their order is arbitrary: hashes of the rows are sorted, not the rows.
    """
    bits = np.ascontiguousarray(rows)
    # whole numbers of 32 bits are compared as they are
    bits = bits.view(np.uint64) if bits.itemsize == 8 else bits
    hashes = np.zeros(len(bits), np.uint64)
    for narrow in bits.T:
        column = narrow.astype(np.uint64, copy=False)
        hashes ^= column ^ (column >> np.uint64(29))
        hashes *= _FACTOR
        hashes ^= hashes >> np.uint64(32)
    first, which = groups(hashes)
    parts = (slice(start, start + _ROWS_AT_ONCE) for start in range(0, len(bits), _ROWS_AT_ONCE))
    if not all(np.array_equal(bits[first[which[part]]], bits[part]) for part in parts):
        # different rows have one number
        _, first, which = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    return first, which.reshape(-1)


#: an odd number whose bits are as if thrown: 2^64 over the golden ratio
_FACTOR = np.uint64(0x9E3779B97F4A7C15)


def groups(keys: NDArray[Any]) -> tuple[Ints, Ints]:
    """The first row (m,) of each distinct key (n,), keys ascending, and which of these each row has (n,)."""
    if keys.dtype.kind in "iu" and len(keys) and 0 <= keys.min() <= keys.max() < len(keys):
        return _groups_of_small(keys)
    order = np.argsort(keys)
    is_new = np.ones(len(keys), bool)
    ordered = keys[order]
    order = order.astype(index_type(len(order)), copy=False)
    # keys that only the caller's expression held are freed, as are other arrays of this size as early as possible
    del keys
    np.not_equal(ordered[1:], ordered[:-1], out=is_new[1:])
    del ordered
    starts = np.flatnonzero(is_new)
    first = np.minimum.reduceat(order, starts) if len(starts) else order
    del starts
    numbers = np.cumsum(is_new, dtype=order.dtype)
    numbers -= 1
    which = np.empty_like(order)
    which[order] = numbers
    return first, which


def _groups_of_small(keys: NDArray[Any]) -> tuple[Ints, Ints]:
    """`groups` of keys from 0 up that are less than their number: looked up in a table instead of sorted."""
    kind = index_type(len(keys) + 1)
    first = np.full(int(keys.max()) + 1, len(keys), kind)
    for start in range(0, len(keys), _ROWS_AT_ONCE):
        part = keys[start : start + _ROWS_AT_ONCE]
        np.minimum.at(first, part, np.arange(start, start + len(part), dtype=kind))
    is_known = first < len(keys)
    numbers = np.cumsum(is_known, dtype=kind) - kind(1)
    return first[is_known], numbers[keys]


def uses_of(rows: Ints, count: int) -> NDArray[Any]:
    """(count,) how often each row occurs among ``rows`` (n, ...), which ``np.bincount`` copies to 64 bits."""
    found: NDArray[Any] = np.zeros(count, np.int32)
    flat = rows.reshape(-1)
    for start in range(0, len(flat), _ROWS_AT_ONCE):
        # 1 of the type of the counts, otherwise it is forty times slower
        np.add.at(found, flat[start : start + _ROWS_AT_ONCE], np.int32(1))
    return found


def rows_by_number(numbers: Ints) -> Iterator[tuple[int, Ints]]:
    """Each distinct number of (n,), ascending, with the rows (k,) that have it, ascending."""
    order = np.argsort(numbers, kind="stable")
    ordered = numbers[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])[: len(order)])
    for start, end in pairwise([*starts.tolist(), len(order)]):
        yield int(ordered[start]), order[start:end]


#: pairs of places to be put in order, by the number of places; Knuth, The Art of Computer Programming 3, 5.3.4
_EXCHANGES = {
    1: (),
    2: ((0, 1),),
    3: ((0, 1), (1, 2), (0, 1)),
    4: ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2)),
}


def sorted_columns(numbers: Ints) -> Ints:
    """(k, n) numbers with each column sorted, k at most 4, by a sorting network applied to all columns at once."""
    result = np.array(numbers, order="C")
    for low, high in _EXCHANGES[len(numbers)]:
        smaller = np.minimum(result[low], result[high])
        np.maximum(result[low], result[high], out=result[high])
        result[low] = smaller
    return result


def distinct_rows(rows: Ints) -> tuple[Ints, Ints]:
    """Rows (n, k), k at most 4, that hold the same numbers, none negative, in any order, are one.

    The first row (m,) of each distinct one, and which distinct one each row is (n,); in ascending order of the numbers.
    """
    return groups(_row_keys(rows))


def distinct_sides(views: Sequence[tuple[Ints, Sequence[int]]]) -> tuple[Ints, Ints]:
    """`distinct_rows` of the sides of elements, view after view, without an array of all of them.

    views  (n, v) numbers of the vertices of elements, and the columns of one side, as many in each view
    """
    return groups(_side_keys(views))


def rows_of_sides(views: Sequence[tuple[Ints, Sequence[int]]], chosen: Ints) -> Ints:
    """(m, k) numbers of the vertices of the sides ``chosen`` (m,) of `distinct_sides`."""
    found = np.empty((len(chosen), len(views[0][1])), np.result_type(*(table for table, _ in views)))
    start = 0
    for table, columns in views:
        here = np.flatnonzero((chosen >= start) & (chosen < start + len(table)))
        rows = chosen[here] - start
        for place, column in enumerate(columns):
            found[here, place] = table[rows, column]
        start += len(table)
    return found


def _side_keys(views: Sequence[tuple[Ints, Sequence[int]]]) -> NDArray[np.uint64]:
    """`_row_keys` of sides."""
    base = 1 + max((int(table.max(initial=0)) for table, _ in views), default=0)
    width = len(views[0][1]) if views else 1
    if base**width >= 1 << 64:
        return _row_keys(np.concatenate([table[:, list(columns)] for table, columns in views]))
    keys = np.empty(sum(len(table) for table, _ in views), np.uint64)
    start = 0
    for table, columns in views:
        for first in range(0, len(table), _ROWS_AT_ONCE):
            part = table[first : first + _ROWS_AT_ONCE, list(columns)]
            keys[start : start + len(part)] = _packed(sorted_columns(part.T), base)
            start += len(part)
    return keys


#: rows whose numbers are put in order together
_ROWS_AT_ONCE = 1 << 16


def _packed(columns: Ints, base: int) -> NDArray[np.uint64]:
    """(n,) numbers with the digits ``columns`` (k, n) to a base; if 64 bits are too few, numbers in the same order."""
    fits = base ** len(columns) < 1 << 64
    keys: NDArray[np.uint64] = columns[0].astype(np.uint64)
    for column in columns[1:]:
        if not fits:
            # replace the numbers so far by their rank among all of them
            keys = groups(keys)[1].astype(np.uint64)
        keys *= np.uint64(base)
        keys += column.astype(np.uint64, copy=False)
    return keys


def _row_keys(rows: Ints) -> NDArray[np.uint64]:
    """(n,) one number for each row: its numbers, ascending, as digits."""
    columns = sorted_columns(rows.T)
    return _packed(columns, int(columns.max(initial=0)) + 1)


def corners_of(*points: Floats) -> Floats:
    """(2, d) minimum and maximum coordinates of points in several arrays (n, d), at least one of them not empty."""
    ends = [(own.min(axis=0), own.max(axis=0)) for own in points if len(own)]
    lower, upper = zip(*ends, strict=True)
    return np.stack([np.min(lower, axis=0), np.max(upper, axis=0)])
