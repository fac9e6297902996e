"""Elements of a Gmsh file, counted by type from the file itself, before its library reads it.

The library assumes one type for each family and entity, and writes past its arrays if an entity has several, such as
triangles of orders 1 and 2.  Layout: Gmsh reference manual, chapter "MSH file format"; versions 1, 2 and 4.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable
from mmap import mmap

import numpy as np

from elvis.core.base.arrays import Floats

_TEXT_FORMAT = re.compile(rb"\$MeshFormat\s*\n(\d+(?:\.\d+)?)\s+0\s")
_NEW_SECTION = re.compile(rb"\$Elements\s*\n(.*?)\$EndElements", re.DOTALL)
_OLD_SECTION = re.compile(rb"\$ELM\s*\n(.*?)\$ENDELM", re.DOTALL)

#: columns of an element of version 1 before its nodes: number, type, two regions, number of nodes
_COLUMNS_OF_1 = 5
#: columns of an element of version 2 before its tags: number, type, number of tags
_COLUMNS_OF_2 = 3
#: numbers that begin a block of version 4
_HEAD_OF_BLOCK = 4


def census(raw: bytes | mmap, width: Callable[[int], int]) -> Counter[int] | None:
    """Number of elements of each type in a file that is a text; None for others, and where the numbers don't fit.

    width  number of nodes of a type
    """
    numbers = _numbers(_OLD_SECTION.search(raw))
    if numbers is not None:
        return _listed(numbers, lambda _: _COLUMNS_OF_1, width)
    version = _TEXT_FORMAT.match(raw)
    numbers = _numbers(_NEW_SECTION.search(raw))
    if version is None or numbers is None:
        return None
    if version[1].startswith(b"4"):
        # version 4.1 has two more numbers, the smallest and the largest tag, before the blocks
        return _in_blocks(numbers, 2 if float(version[1]) == 4 else 4, width)
    return _listed(numbers, lambda tags: _COLUMNS_OF_2 + tags, width)


def _numbers(section: re.Match[bytes] | None) -> Floats | None:
    """The numbers of a section; None if the section is missing, or holds anything else."""
    if section is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            numbers = np.fromstring(section[1].decode("ascii", "replace"), sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    return numbers if len(numbers) and np.isfinite(numbers).all() else None


def _in_blocks(numbers: Floats, first: int, width: Callable[[int], int]) -> Counter[int] | None:
    """Elements of version 4: blocks of elements of one type from ``first`` on, each element a tag and its nodes."""
    found: Counter[int] = Counter()
    at = first
    while at + _HEAD_OF_BLOCK <= len(numbers):
        kind, count = int(numbers[at + 2]), int(numbers[at + 3])
        if kind < 1 or count < 0:
            return None
        found[kind] += count
        at += _HEAD_OF_BLOCK + count * (1 + width(kind))
    return found if at == len(numbers) and sum(found.values()) == int(numbers[1]) else None


def _listed(numbers: Floats, head: Callable[[int], int], width: Callable[[int], int]) -> Counter[int] | None:
    """Elements of versions 1 and 2: a number of elements, then each with its type in the second column.

    head  number of columns before the nodes, from the number in the third column
    """
    found: Counter[int] = Counter()
    at, left = 1, int(numbers[0])
    while left > 0 and at + _COLUMNS_OF_2 <= len(numbers):
        kind, third = int(numbers[at + 1]), int(numbers[at + 2])
        stride = head(third) + width(kind)
        if kind < 1 or stride < 1:
            return None
        count = _alike(numbers, at, stride, left)
        found[kind] += count
        at, left = at + count * stride, left - count
    return found if left == 0 and at == len(numbers) else None


def _alike(numbers: Floats, at: int, stride: int, most: int) -> int:
    """Number of elements from ``at`` on with the type and the third column of the first: at least 1."""
    count, ahead = 1, 16
    while count < most:
        rows = min(ahead, most - count, (len(numbers) - at) // stride - count)
        if rows < 1:
            return count
        first = at + count * stride
        table = numbers[first : first + rows * stride].reshape(rows, stride)[:, 1:3]
        differing = np.flatnonzero((table != numbers[at + 1 : at + 3]).any(axis=1))
        if len(differing):
            return count + int(differing[0])
        count, ahead = count + rows, 2 * ahead
    return count
