"""Volumes of the first ElVis (.dat): straight hexahedra and prisms with a field in Legendre and Jacobi polynomials.

A header of 24 characters, a 1 for the byte order, the number of elements; each element gives its type, range, eight
vertices, degrees and coefficients, the last index fastest.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content, leading
from elvis.core.polynomials.collapse import collapse
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, NodalValues, ShapeFunctions
from elvis.plugins.conversion.plugin import Elements, Reads

#: numbers of types; tetrahedra and pyramids were never written
_SHAPES = {1: Shape.HEXAHEDRON, 3: Shape.PRISM}

_HEADER, _START, _HIGHEST, _FIRST_RUN = 24, 32, 30, 64

#: for each of the eight corners of a cube, the vertex of a prism
_FOLDED = [0, 1, 2, 3, 4, 4, 5, 5]

Kind = tuple[int, int, int, int]

#: a kind with as few coefficients as any
_LEAST: Kind = (1, 0, 0, 0)


class ElVisDat(NodalConverter):
    """One volume, its only field called u."""

    format = "volume of the first ElVis (.dat)"
    keeps = "straight hexahedra and prisms, the field at any degrees"
    loses = "ranges of elements, which are computed again"
    reads = Reads(
        "hexahedra, prisms",
        "1 (map), any (fields)",
        "Legendre, monomials",
        "none",
        "none",
        "none",
        "no",
        "no",
    )
    further_files = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether it is one file with a text, a 1, a number of elements, and a first element that makes sense."""
        if len(paths) != 1:
            return False
        start = leading(paths[0], _START + _record(_LEAST).itemsize)
        is_text = all(byte in (0, 9, 10, 13) or 32 <= byte < 127 for byte in start[:_HEADER])
        if len(start) < _START + 4 or not is_text:
            return False
        order = _byte_order(start)
        return bool(order) and 0 <= struct.unpack_from(f"{order}i", start, _START)[0] <= 3

    def __init__(self, paths: Sequence[Path]) -> None:
        path = paths[0]
        raw = content(path)
        runs = _read(path, raw)
        self.declared = Declared(_count_of_elements(raw, _byte_order(raw)))
        self.blocks = []
        values = []
        for kind in sorted(runs):
            ids, data = joined_columns(runs[kind])
            shape = _SHAPES[kind[0]]
            places = np.asarray(data["vertices"], np.float64)[:, : len(shape.vertices)]
            key = NodalBlock(NodalValues(places, _Corners(shape)))
            self.blocks.append(Elements(shape, len(ids), 1, ids=ids, key=key))
            coefficients = np.asarray(data["coefficients"], np.float64)
            values.append(NodalValues(coefficients[:, :, None], _Polynomials(kind)))
        self.add_field("u", ["u"], values, is_continuous=True)


class _Polynomials(ShapeFunctions):
    """The functions of an element of type and degrees (a, b, c)."""

    def __init__(self, kind: Kind) -> None:
        self.kind, self.order = kind, max(kind[1:])

    def tabulate(self, points: Floats) -> Floats:
        """See `polynomials`."""
        return polynomials(self.kind, points)


class _Corners(ShapeFunctions):
    """The functions of the vertices of straight elements: trilinear in collapsed coordinates."""

    order = 1

    def __init__(self, shape: Shape) -> None:
        self.shape = shape

    def tabulate(self, points: Floats) -> Floats:
        """(n, n_vertices) values at reference points (n, 3)."""
        cube = collapse(self.shape, points)
        corners = np.prod(1 + cube[:, None, :] * Shape.HEXAHEDRON.vertices, axis=2) / 8
        if self.shape is Shape.HEXAHEDRON:
            return np.asarray(corners)
        return np.asarray(corners @ np.eye(6)[_FOLDED])


def polynomials(kind: Kind, points: Floats) -> Floats:
    """(n, m) the functions of an element of type and degrees (a, b, c) at reference points (n, 3).

    P_i P_j P_k on hexahedra; on prisms, in collapsed coordinates, P_i P_j (1 - z)^i P_k^(2i+1,0)(z) with k <= c - i.
    """
    shape, (a, b, c) = _SHAPES[kind[0]], kind[1:]
    x, y, z = collapse(shape, np.asarray(points, np.float64)).T
    first, second = jacobi(a, 0, 0, x), jacobi(b, 0, 0, y)
    if shape is Shape.HEXAHEDRON:
        table = np.einsum("in,jn,kn->nijk", first, second, jacobi(c, 0, 0, z))
        return np.asarray(table.reshape(len(x), -1))
    columns = []
    for i in range(a + 1):
        upper = (1 - z) ** i * jacobi(c - i, 2 * i + 1, 0, z)
        columns.append(np.einsum("n,jn,kn->jkn", first[i], second, upper).reshape(-1, len(x)))
    # for each i all j, for each j all k
    return np.concatenate(columns).T


def _byte_order(start: bytes) -> str:
    """The byte order in which a 1 follows the header, empty if none does."""
    found = [order for order in "><" if struct.unpack_from(f"{order}i", start, _HEADER)[0] == 1]
    return found[0] if found else ""


def _count(kind: Kind) -> int:
    """Number of coefficients of an element."""
    a, b, c = kind[1:]
    return (a + 1) * (b + 1) * (c + 1) if kind[0] == 1 else (a + 1) * (b + 1) * (c + 2) // 2


def _record(kind: Kind, order: str = ">") -> np.dtype[Any]:
    """An element of a kind as it stands in the file."""
    parts = {"type": ("i4", ()), "flag": ("i4", ()), "range": ("f8", (2,)), "vertices": ("f8", (8, 3))}
    parts |= {"degrees": ("i4", (3,)), "coefficients": ("f8", (_count(kind),))}
    fields = [(name, order + code, size) for name, (code, size) in parts.items()]
    return np.dtype(fields)


def _read(path: Path, raw: bytes) -> dict[Kind, list[tuple[Ints, Any]]]:
    """Numbers and records of the elements by kind, in runs of one kind."""
    order = _byte_order(raw) if len(raw) >= _START else ""
    if not order:
        raise FormatError("expected a 1 that marks the byte order, found none", file=path, place="header")
    count = _count_of_elements(raw, order)
    if count <= 0:
        raise FormatError(f"expected elements, found {count}", file=path, place="header")
    at, number, most = _START, 0, _FIRST_RUN
    runs: dict[Kind, list[tuple[Ints, Any]]] = {}
    while number < count:
        kind = _kind(path, raw, order, at, number)
        record = _record(kind, order)
        whole = (len(raw) - at) // record.itemsize
        if whole == 0:
            raise FormatError(f"expected {count} elements, found {number} complete elements", file=path)
        data = np.frombuffer(raw, record, min(whole, count - number, most), at)
        other = np.flatnonzero((data["type"] != kind[0]) | (data["degrees"] != kind[1:]).any(axis=1))
        length = int(other[0]) if len(other) else len(data)
        runs.setdefault(kind, []).append((number + np.arange(length), data[:length]))
        at, number, most = at + length * record.itemsize, number + length, max(2 * length, _FIRST_RUN)
    if at != len(raw):
        raise FormatError(f"expected the end after {count} elements, found {len(raw) - at} bytes more", file=path)
    return runs


def _count_of_elements(raw: bytes, order: str) -> int:
    """The number of elements in the header."""
    (count,) = struct.unpack_from(f"{order}i", raw, _HEADER + 4)
    return int(count)


def _kind(path: Path, raw: bytes, order: str, at: int, number: int) -> Kind:
    """Type and degrees of the element at a place."""
    head, place = _record(_LEAST, order).fields, f"element {number}"
    assert head is not None
    if at + head["coefficients"][1] > len(raw):
        raise FormatError("expected an element, found the end", file=path, place=place)
    (number_of_type,) = struct.unpack_from(f"{order}i", raw, at)
    degrees = struct.unpack_from(f"{order}3i", raw, at + head["degrees"][1])
    if number_of_type not in _SHAPES:
        raise FormatError(f"expected type 1 or 3, found {number_of_type}", file=path, place=place)
    if not all(0 <= degree <= _HIGHEST for degree in degrees):
        raise FormatError(f"expected degrees from 0 to {_HIGHEST}, found {degrees}", file=path, place=place)
    if number_of_type == 3 and degrees[0] != degrees[2]:
        raise FormatError(f"expected the same first and third degree, found {degrees}", file=path, place=place)
    return (number_of_type, *degrees)
