"""Surfaces of geometries next to the data: the undeformed one, and walls of a height."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from elvis.core.summary.picturing import Kind
from elvis.renderer.asking.completing import arranged
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.scene import Faces, Implicit, MeshLines, Scene, Style
from elvis.scene.model.errors import SceneError

if TYPE_CHECKING:
    from elvis.renderer.frame.stages import Stages

#: names of the geometries, as in scenes
UNDEFORMED, WALLS = "undeformed", "walls"
#: colour of the undeformed geometry
GREY = (0.45, 0.45, 0.45)
#: opacity of its faces
OPACITY = 0.25
#: part of the extent within which surfaces of both geometries coincide in pictures
APART = 1e-6
#: how the word of a scene is drawn
STYLES = {
    "outline": Style(color=GREY),
    "mesh": Style(color=GREY, mesh_lines=MeshLines(color=GREY)),
    "faces": Style(color=GREY, opacity=OPACITY),
}
#: walls of a height
WALL = Style(color=(0.8, 0.8, 0.8))


def not_at_hand(name: str) -> str:
    """A message about a geometry that needs whole data."""
    return f"{name}: not available for data in parts or with a limit of memory: remove this setting"


def with_ghosts(draw_calls: list[DrawCall], ghosts: Mapping[str, Stages], scene: Scene) -> list[DrawCall]:
    """The draw calls of a scene and those of geometries next to its data.

    Parameters
    ----------
    draw_calls : list of DrawCall
        Surfaces of the data.
    ghosts : mapping of str to Stages
        Stages over the other geometries by name; a height without jumps has no walls.
    scene : Scene
        It names the geometries.

    Raises
    ------
    SceneError
        If the undeformed geometry is not at hand, and for clips that walls have no values for.
    """
    found = draw_calls
    if scene.undeformed is not None:
        if UNDEFORMED not in ghosts:
            raise SceneError(not_at_hand(UNDEFORMED))
        found = _with_undeformed(found, ghosts[UNDEFORMED], scene.undeformed)
    if WALLS in ghosts:
        if any(isinstance(clip.surface, Implicit) for clip in scene.clip):
            raise SceneError("walls: expected clips by surfaces, found an implicit one: remove walls or the clip")
        found = [*found, _draw_call(ghosts[WALLS], WALLS, WALL)]
    return found


def _with_undeformed(draw_calls: list[DrawCall], ghost: Stages, how: str) -> list[DrawCall]:
    """The draw calls and that of the undeformed geometry."""
    own = _draw_call(ghost, UNDEFORMED, STYLES[how])
    # an outline needs the nearest surfaces only
    is_bare = how != "faces"
    # where both geometries coincide, lines belong in front and faces behind
    own = replace(own, bare=is_bare, once=own.once or how == "outline", set_back=-APART if is_bare else APART)
    return [own, *draw_calls]


def _draw_call(ghost: Stages, name: str, style: Style) -> DrawCall:
    """The outer faces of a geometry, or all of it in the plane."""
    assert ghost.dataset is not None
    scene = arranged(Scene(objects=(Faces(style=style),)), Kind.of(ghost.dataset))
    return replace(ghost.draw_calls(scene)[0], name=name, ghost=ghost)
