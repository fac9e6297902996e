"""Pictures of objects in a Python session, in one call."""

from __future__ import annotations

from typing import Any

from elvis.core.base.needing import is_there
from elvis.scene.figure.showing import is_notebook


def draw(*data: Any, **keywords: Any) -> None:
    """Show data at once: interactively in a notebook, elsewhere as a picture in the system's viewer.

    Parameters
    ----------
    data
        A grid function of NGSolve or MFEM (see `from_ngsolve` and `from_mfem`), a dataset, or names of files; then
        the quantity that colours the picture.
    keywords
        Options of `render`.

    Raises
    ------
    ElvisError
        As in `render`, and for objects of other types.

    Examples
    --------
    >>> import ngsolve, netgen.geom2d
    >>> mesh = ngsolve.Mesh(netgen.geom2d.unit_square.GenerateMesh(maxh=0.5))
    >>> gfu = ngsolve.GridFunction(ngsolve.H1(mesh, order=3), name="gfu")
    >>> gfu.Set(ngsolve.x * ngsolve.y)
    >>> elvis.draw(gfu)  # doctest: +SKIP
    """
    from elvis.converters.python.live import live_data
    from elvis.renderer.frame.rendering import render
    from elvis.viewer.widget import view

    first, *rest = data or ((),)
    shown = live_data(first)
    if is_notebook() and is_there("anywidget"):
        from IPython.display import display

        display(view(shown, *rest, **keywords))
    else:
        render(shown, *rest, **keywords).show()
