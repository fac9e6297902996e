"""What copies of data need, examined before they are drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.copied_domains import check_copies as check_domains
from elvis.core.deformed.copied_domains import periods
from elvis.core.quantities import Names
from elvis.core.summary.picturing import Kind
from elvis.plugins.runtime.opening import PluginData
from elvis.scene import Copies, Scene
from elvis.scene.model.errors import SceneError


def with_periods(scene: Scene, data: Dataset | PluginData) -> Scene:
    """The scene with the periods of data instead of the names of directions."""
    if scene.copies is None:
        return scene
    return replace(scene, copies=scene.copies.with_periods(periods_of(data)))


def periods_of(data: Dataset | PluginData) -> dict[str, float]:
    """The periods that data declare, by the names of the axes; those of a plugin declare none."""
    return periods(data) if isinstance(data, Dataset) else {}


class CopyChecks:
    """Checks of copies, made once for the same copies of the same data."""

    def __init__(self) -> None:
        self._known: tuple[Copies, object, object] | None = None

    def check(self, scene: Scene, kind: Kind | None, data: Dataset | PluginData, *, is_whole: bool) -> None:
        """SceneError for copies that can't be drawn, mirrors that cut the domain, and copies that overlap.

        is_whole  whether all of the data are at hand
        """
        if scene.copies is None:
            return
        check_drawable(scene, kind, is_whole=is_whole)
        own = (data.mesh, data.deformation) if isinstance(data, Dataset) else (data, None)
        if self._known != (scene.copies, *own):
            check_copies(scene.copies, data)
            self._known = scene.copies, *own


def check_drawable(scene: Scene, kind: Kind | None, *, is_whole: bool) -> None:
    """SceneError for pictures that copies have no part in.

    is_whole  whether all of the data are at hand
    """
    if kind is Kind.LINE:
        raise SceneError("copies: 1D data are drawn without copies: remove mirror, turn and repeat")
    if not is_whole or scene.memory is not None:
        raise SceneError("copies: not available for data in parts or with a limit of memory: remove this setting")


def check_copies(copies: Copies, data: Dataset | PluginData) -> None:
    """SceneError for mirrors that cut the domain, and copies that overlap; nothing is known of a plugin's data."""
    if not isinstance(data, Dataset):
        return
    isometries = copies.isometries()
    if Names.of(data).dimension < 3 and any(own.rotation[2] != (0.0, 0.0, 1.0) or own.shift[2] for own in isometries):
        raise SceneError("copies: 2D data are copied in their own plane: expected mirrors, turns and repetitions in it")
    mirrors = [(np.array(plane.point, np.float64), np.array(plane.normal, np.float64)) for plane in copies.mirror]
    try:
        check_domains(data, mirrors, isometries)
    except ElvisError as error:
        raise SceneError(str(error)) from error
