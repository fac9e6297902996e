"""The renderer: pictures of scenes that are exact to the pixel.

Programs use ``import elvis``.  Its other names are found here too, for scripts that were written before it had them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.base.lazy import names_of_elvis

if TYPE_CHECKING:
    from elvis.renderer.frame.renderer import Renderer
    from elvis.renderer.frame.rendering import render

__all__ = ["Renderer", "render"]


__getattr__ = names_of_elvis(__name__)


def __dir__() -> list[str]:
    return __all__
