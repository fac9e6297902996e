"""Surfaces of a scene, each with the stage that draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from elvis.core.arrays import Floats
from elvis.renderer.hit_buffer import HitBuffer
from elvis.scene import Style
from elvis.scene.surfaces import Surface
from elvis.scene.view import View

if TYPE_CHECKING:
    from elvis.renderer.stages import Stages

Draw = Callable[[View, Floats | None], HitBuffer]


@dataclass(frozen=True, eq=False)
class DrawCall:
    """A surface of a scene that one stage draws.

    name      in the scene
    quantity  of its hit buffers' field; None is the parts' own
    draw      as every stage: the nearest hits in a view behind given depths
    once      whether a ray meets it at most once
    surface   the cutting surface, which does not clip itself
    level     constant value of its quantity, if it is an isosurface of that
    ghost     stages of the undeformed geometry, if the surface belongs to it: such surfaces have no part in ranges and
              records
    bare      whether only its lines are drawn
    """

    name: str
    style: Style
    quantity: str | None
    draw: Draw
    lit: bool
    once: bool = False
    surface: Surface | None = None
    level: float | None = None
    ghost: Stages | None = None
    bare: bool = False

    @property
    def opacity(self) -> float:
        """Opacity of the surface itself."""
        return 0.0 if self.bare else self.style.opacity
