"""Meshes and functions that live in a solver's Python session: NGSolve's and MFEM's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.mfem import Mfem
from elvis.converters.mfem_pieces import Piece, Source
from elvis.converters.ngsolve import NGSolve
from elvis.converters.ngsolve_export import Session
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.plugins.arrays import checked_time, fields_by_name, short_text
from elvis.plugins.converting import Settings, converted_object

#: digits with which a number of 64 bits is the same when it is read
_DIGITS = 17
#: the highest degree of fields that is asked of the library
HIGHEST_ORDER = 30


def from_ngsolve(
    mesh: Any,
    fields: Mapping[str, Any] | None = None,
    *,
    order: int | None = None,
    time: float | None = None,
    **named: Any,
) -> Dataset:
    """The dataset of an NGSolve mesh and its functions: ``from_ngsolve(mesh, u=gfu, p=gfp)``.

    fields  grid functions by name, as the keywords are, or coefficient functions, for which ``order`` must be given;
            a vector ``u`` becomes ``u_x``, ``u_y``, ``u_z``, a complex one ``u_re`` and ``u_im``, one on several
            spaces ``u_1`` and ``u_2``
    order   polynomial degree of all fields; where it is not given, that of the spaces, or a higher one for functions
            that are no polynomials in the reference element, such as those of H(div) on curved elements
    time    of the data

    The library evaluates all functions.  Remarks of the dataset tell the error, measured at points that no fit has
    used.  ElvisError where there is another thing.
    """
    _check(mesh, "MapToAllElements", "an ngsolve.Mesh first")
    given = fields_by_name(fields, named)
    for name, field in given.items():
        _check(field, "Compile", f"a grid function or a coefficient function for {name}")
    if order is not None and (not isinstance(order, int) or not 1 <= order <= HIGHEST_ORDER):
        raise ElvisError(f"order: expected a whole number from 1 to {HIGHEST_ORDER}, found {short_text(order)}")
    source = NGSolve.of(Session(mesh, given, order))
    source.time = checked_time(time)
    return converted_object(source, "an NGSolve mesh", Settings(order=order))


def from_mfem(
    mesh: Any, fields: Mapping[str, Any] | None = None, *, time: float | None = None, **named: Any
) -> Dataset:
    """The dataset of an MFEM mesh and grid functions on it: ``from_mfem(mesh, u=x)``.

    fields  grid functions by name, as the keywords are; a vector ``u`` becomes ``u_x``, ``u_y``, ``u_z``
    time    of the data

    The library writes them with all their digits to a scratch folder, and evaluates them in a process of its own;
    remarks of the dataset tell the measured error.  ElvisError where there is another thing, or a function of another
    mesh.
    """
    _check(mesh, "GetNE", "an mfem Mesh first")
    given = fields_by_name(fields, named)
    for name, field in given.items():
        _check(field, "FESpace", f"a GridFunction for {name}")
        space = field.FESpace()
        if space is None:
            raise ElvisError(f"{name}: expected a function on a space, found one without")
        own = space.GetMesh()
        if (own.GetNE(), own.GetNV()) != (mesh.GetNE(), mesh.GetNV()):
            raise ElvisError(f"{name}: expected a function on the mesh's {mesh.GetNE()} elements, found {own.GetNE()}")
    texts = {name: _text(field) for name, field in given.items()}
    functions = {name: Source(Path(name), text, False) for name, text in texts.items()}
    source = Mfem.of([Piece(Source(Path("MFEM"), _text(mesh), False), functions)])
    source.time = checked_time(time)
    return converted_object(source, "an MFEM mesh")


def _text(item: Any) -> str:
    """What the library saves of a mesh or a function."""
    with TemporaryDirectory(prefix="elvis-") as folder:
        path = Path(folder, "item")
        item.Save(str(path), _DIGITS)
        return path.read_text()


def _check(item: Any, method: str, expected: str) -> None:
    """ElvisError for what is of another kind, told by a method that it lacks."""
    if not hasattr(item, method) or isinstance(item, (type, np.ndarray)):
        raise ElvisError(f"expected {expected}, found {type(item).__name__} {short_text(item)}")
