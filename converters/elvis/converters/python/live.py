"""Meshes and functions that live in a solver's Python session: NGSolve's and MFEM's."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.mfem.mfem import Mfem
from elvis.converters.mfem.pieces import Piece, Source
from elvis.converters.ngsolve.export import Session
from elvis.converters.ngsolve.ngsolve import NGSolve
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.plugins.conversion.arrays import checked_time, fields_by_name, short_text
from elvis.plugins.conversion.converting import Settings, converted_object

#: digits with which a number of 64 bits is the same when it is read
_DIGITS = 17
#: the name of a function of MFEM that comes without one
FUNCTION = "u"
#: maximum degree of fields that is requested from the library
HIGHEST_ORDER = 30


def from_ngsolve(
    mesh: Any,
    fields: Any = None,
    *,
    order: int | None = None,
    time: float | None = None,
    **named: Any,
) -> Dataset:
    """The dataset of NGSolve's functions: ``from_ngsolve(gfu)``, or ``from_ngsolve(mesh, u=gfu, p=gfp)``.

    mesh    an ngsolve.Mesh, or a grid function, which has a mesh and a name
    fields  grid functions by name, like the keywords, or coefficient functions, for which ``order`` must be given; a
            vector ``u`` becomes ``u_x``, ``u_y``, ``u_z``, a complex one ``u_re`` and ``u_im``, one on several spaces
            ``u_1`` and ``u_2``
    order   polynomial degree of all fields; by default the degree of the spaces, or a higher one for functions that are
            not polynomials in the reference element, such as H(div) functions on curved elements
    time    of the data

    The library evaluates all functions.  Remarks of the dataset give the error, measured at points outside the fit.
    Raises ElvisError for invalid arguments.

    >>> import ngsolve, netgen.geom2d
    >>> mesh = ngsolve.Mesh(netgen.geom2d.unit_square.GenerateMesh(maxh=0.5))
    >>> gfu = ngsolve.GridFunction(ngsolve.H1(mesh, order=3), name="gfu")
    >>> gfu.Set(ngsolve.x * ngsolve.y)
    >>> elvis.from_ngsolve(gfu)
    <Dataset 2D: ... triangles; fields gfu of order 3>
    """
    if _is_ngsolve_function(mesh):
        mesh, fields = mesh.space.mesh, _with_first(mesh.name, mesh, fields)
    elif _is_ngsolve_function(fields):
        fields = {fields.name: fields}
    _check(mesh, "MapToAllElements", "an ngsolve.Mesh or a grid function first")
    given = fields_by_name(fields, named)
    for name, field in given.items():
        _check(field, "Compile", f"a grid function or a coefficient function for {name}")
    if order is not None and (not isinstance(order, int) or not 1 <= order <= HIGHEST_ORDER):
        raise ElvisError(f"order: expected a whole number from 1 to {HIGHEST_ORDER}, found {short_text(order)}")
    source = NGSolve.of(Session(mesh, given, order))
    source.time = checked_time(time)
    return converted_object(source, "an NGSolve mesh", Settings(order=order))


def from_mfem(mesh: Any, fields: Any = None, *, time: float | None = None, **named: Any) -> Dataset:
    """The dataset of MFEM's functions: ``from_mfem(x)``, or ``from_mfem(mesh, u=x, p=y)``.

    mesh    an mfem Mesh, or a grid function, which has a mesh and becomes the field u
    fields  grid functions by name, like the keywords; a vector ``u`` becomes ``u_x``, ``u_y``, ``u_z``
    time    of the data

    The library writes them with all their digits to a scratch folder, and evaluates them in a separate process; remarks
    of the dataset give the measured error.  Raises ElvisError for invalid arguments, or a function of another mesh.

    >>> import mfem.ser as mfem
    >>> mesh = mfem.Mesh.MakeCartesian2D(2, 2, mfem.Element.QUADRILATERAL)
    >>> space = mfem.FiniteElementSpace(mesh, mfem.H1_FECollection(2, 2))
    >>> x = mfem.GridFunction(space)
    >>> _ = x.Assign(1.0)
    >>> elvis.from_mfem(x)
    <Dataset 2D: ...; fields u of order 2>
    """
    if _is_mfem_function(mesh):
        mesh, fields = mesh.FESpace().GetMesh(), _with_first(FUNCTION, mesh, fields)
    elif _is_mfem_function(fields):
        fields = {FUNCTION: fields}
    _check(mesh, "SetCurvature", "an mfem Mesh or a GridFunction first")
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


def live_data(item: Any) -> Any:
    """The dataset of a function, or a mesh, of NGSolve or MFEM; anything else unchanged."""
    if _is_ngsolve_function(item) or hasattr(item, "MapToAllElements"):
        return from_ngsolve(item)
    if _is_mfem_function(item) or hasattr(item, "SetCurvature"):
        return from_mfem(item)
    return item


def _is_ngsolve_function(item: Any) -> bool:
    """Whether something is a grid function of NGSolve."""
    return hasattr(item, "space") and hasattr(item, "components")


def _is_mfem_function(item: Any) -> bool:
    """Whether something is a grid function of MFEM on a space."""
    return hasattr(item, "FESpace") and not isinstance(item, type) and item.FESpace() is not None


def _with_first(name: str, function: Any, fields: Any) -> dict[str, Any]:
    """The function that was passed as the mesh, and the others; raises ElvisError if these have no names."""
    return {name: function, **fields_by_name(fields, {})}


def _text(item: Any) -> str:
    """The text that the library saves for a mesh or a function."""
    with TemporaryDirectory(prefix="elvis-") as folder:
        path = Path(folder, "item")
        item.Save(str(path), _DIGITS)
        return path.read_text()


def _check(item: Any, method: str, expected: str) -> None:
    """Raise ElvisError for an object of another kind, which lacks a method."""
    if not hasattr(item, method) or isinstance(item, (type, np.ndarray)):
        raise ElvisError(f"expected {expected}, found {type(item).__name__} {short_text(item)}")
