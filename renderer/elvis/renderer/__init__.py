"""The renderer: pictures of scenes that are exact to the pixel.  Programs use ``import elvis``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.renderer.rendering import Renderer, render

__all__ = ["Renderer", "render"]

__getattr__ = lazy_names(__name__, {"elvis.renderer.rendering": ("Renderer", "render")})


def __dir__() -> list[str]:
    return __all__
