"""The box and the outline of the domain around the objects of a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.deformed.isometries import Isometry
from elvis.renderer.device.drafts import wants_segments
from elvis.renderer.frame.domain_outline import boundary_surface
from elvis.renderer.frame.stages import Stages
from elvis.scene import Scene
from elvis.scene.figure.domain_lines import domain_lines
from elvis.scene.record.frame import Frame

#: middles of edges are one within this part of the extent
SAME = 1e-7


def with_surroundings(frame: Frame, scene: Scene, stages: Stages) -> Frame:
    """The frame with the box of the domain, and with its outline, if the scene shows them."""
    if scene.box or scene.axes:
        frame = replace(frame, box=stages.domain())
    return _with_outline(frame, stages) if scene.shows_domain else frame


def _with_outline(frame: Frame, stages: Stages) -> Frame:
    """The frame with the outline of the domain and of its copies; without for data that have no boundary."""
    surface = None if stages.dataset is None else boundary_surface(stages.dataset)
    if surface is None:
        return frame
    places = [copy.isometry for copy in stages.copied.copies] or [Isometry()]
    edges = np.concatenate([isometry.points(surface.sharp_edges) for isometry in places])
    silhouettes = [isometry.points(surface.silhouettes(frame.view.before(isometry))) for isometry in places]
    if len(places) > 1:
        edges = edges[_is_single(edges)]
    found = domain_lines(frame.view, frame.depth, np.concatenate([edges, *silhouettes]))
    if frame.drawing is None or not wants_segments():
        return replace(frame, domain=found)
    return replace(frame, drawing=replace(frame.drawing, segments=(*frame.drawing.segments, found)))


def _is_single(edges: Floats) -> Bools:
    """(n,) whether an edge (2, 3) occurs once; edges at which two copies meet occur twice."""
    middles = edges.mean(axis=1)
    cells = np.rint(middles / (SAME * np.abs(middles).max(initial=1e-300))).astype(np.int64)
    _, group, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[group.reshape(-1)] == 1)
