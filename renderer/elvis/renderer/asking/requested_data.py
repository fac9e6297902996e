"""The data of a request for a picture."""

from __future__ import annotations

from pathlib import Path

from elvis.core.base.terminal import warn
from elvis.core.data.dataset import Dataset
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.asking.request import Request, reading_for
from elvis.renderer.parts.bricks import Bricks, opening_for
from elvis.scene.model.errors import SceneError


def data_of(asked: Request) -> Dataset | PluginData | Bricks:
    """The data, read where they are files, as the scene says."""
    if asked.data is not None:
        return asked.data
    scene = asked.scene
    if not scene.data:
        raise SceneError("expected data first: what read returns, or the mesh and field files; found none")
    return opening_for([scene])([Path(file) for file in scene.data], reading_for([scene]), warn)
