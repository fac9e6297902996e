"""Surfaces of a scene, each with the stage that draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from elvis.core.base.arrays import Floats
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.scene import Style
from elvis.scene.cameras.view import View
from elvis.scene.model.surfaces import Surface

if TYPE_CHECKING:
    from elvis.renderer.frame.copied import Copy
    from elvis.renderer.frame.stages import Stages

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
    set_back  part of the extent by which its colours lie behind it, where other surfaces may coincide with it
    copy      the copy of the data whose surface it is; None without copies.  Then hits are those of the data, seen in
              the view that `view_of` returns
    is_inside whether it lies in the elements, unlike tubes and glyphs
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
    set_back: float = 0.0
    copy: Copy | None = None
    is_inside: bool = True

    @property
    def opacity(self) -> float:
        """Opacity of the surface itself."""
        return 0.0 if self.bare else self.style.opacity

    def view_of(self, view: View) -> View:
        """The view in which its hits are those of the data."""
        return view if self.copy is None else self.copy.view(view)

    def on_device(self, quantity: str | None) -> str | None:
        """The quantity of the data that a quantity of the scene is on this surface; None is the scene's field."""
        return quantity if self.copy is None else self.copy.on_device(quantity)

    def in_world(self, hits: HitBuffer) -> HitBuffer:
        """Its hits, with normals in space."""
        if self.copy is None or self.copy.isometry.is_identity:
            return hits
        return hits.turned(self.copy.isometry.matrix)
