"""Surfaces of the undeformed geometry, drawn next to the deformed one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from elvis.core.picturing import Kind
from elvis.renderer.completing import arranged
from elvis.renderer.draw_calls import DrawCall
from elvis.scene import Faces, MeshLines, Scene, Style
from elvis.scene.errors import SceneError

if TYPE_CHECKING:
    from elvis.renderer.stages import Stages

#: colour of the undeformed geometry
GREY = (0.45, 0.45, 0.45)
#: opacity of its faces
OPACITY = 0.25
#: how the word of a scene is drawn
STYLES = {
    "outline": Style(color=GREY),
    "mesh": Style(color=GREY, mesh_lines=MeshLines(color=GREY)),
    "faces": Style(color=GREY, opacity=OPACITY),
}


def with_undeformed(draw_calls: list[DrawCall], ghost: Stages | None, how: str | None) -> list[DrawCall]:
    """The draw calls of a scene and that of the undeformed geometry.

    Parameters
    ----------
    draw_calls : list of DrawCall
        Surfaces of the deformed geometry.
    ghost : Stages, optional
        Stages over the undeformed geometry.
    how : str, optional
        ``outline``, ``mesh`` or ``faces``; None draws nothing else.

    Raises
    ------
    SceneError
        If the undeformed geometry is not at hand.
    """
    if how is None:
        return draw_calls
    if ghost is None or ghost.dataset is None:
        raise SceneError("undeformed: not available for data in parts or with a limit of memory: remove this setting")
    kind = Kind.of(ghost.dataset)
    scene = arranged(Scene(objects=(Faces(style=STYLES[how]),)), kind)
    own = ghost.draw_calls(scene)[0]
    # an outline needs the nearest surfaces only
    is_outline = how == "outline"
    own = replace(own, name="undeformed", ghost=ghost, bare=how != "faces", once=own.once or is_outline)
    # both geometries lie in the plane of 2D data: lines belong in front, faces behind
    is_behind = kind is Kind.PLANE and how == "faces"
    return [*draw_calls, own] if is_behind else [own, *draw_calls]
