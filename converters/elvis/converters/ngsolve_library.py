"""What NGSolve's library does with files, in a process of its own: samples of a mesh and of functions as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from elvis.converters.ngsolve_export import samples
from elvis.core.errors import ElvisError, FormatError


class Library:
    """The library, which reads a mesh and functions on it."""

    def __init__(self) -> None:
        import ngsolve

        self._ngsolve: Any = ngsolve

    def samples(self, path: str, named: str, fields: Mapping[str, tuple[str, str, int]]) -> dict[str, Any]:
        """See `elvis.converters.ngsolve_export.samples`; ``fields`` are file, space and order by name.

        FormatError where a function has another number of values than its space, or, naming ``named``, where the
        samples can't be made.
        """
        mesh = self._ngsolve.Mesh(path)
        functions = {
            name: _function(self._ngsolve, mesh, Path(file), kind, order)
            for name, (file, kind, order) in fields.items()
        }
        try:
            return samples(mesh, functions)
        except ElvisError as error:
            raise FormatError(str(error), file=named) from error


def _function(ngsolve: Any, mesh: Any, path: Path, kind: str, order: int) -> Any:
    """The grid function of a file; FormatError where it has another number of values than the space."""
    space = getattr(ngsolve, kind)(mesh, order=order)
    if path.stat().st_size != 8 * space.ndof:
        expected = f"{space.ndof} numbers of {kind} of order {order}"
        raise FormatError(f"expected {expected}, found {path.stat().st_size / 8:g}", file=path)
    function = ngsolve.GridFunction(space)
    function.Load(str(path))
    return function
