"""Data in the state that a scene asks for: its reference values, complex fields at its phase, and its geometry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

from elvis.core.data.complex_fields import ComplexChoice, named_pairs
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.height_walls import height_walls
from elvis.core.quantities.reference_values import over
from elvis.plugins.data.deforming import is_deformed, with_deformation
from elvis.plugins.data.phases import with_complexes, without_phase
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.frame.undeformed import UNDEFORMED, WALLS, not_at_hand
from elvis.renderer.parts.bricks import timed
from elvis.scene import Scene
from elvis.scene.model.errors import SceneError
from elvis.scene.model.whole import Deform

#: complex fields, and a deformation
State: TypeAlias = tuple[ComplexChoice, Deform | None]


@dataclass
class DeformedData:
    """Data, and their last state.

    is_whole  whether the data were read completely, not in parts
    """

    data: Dataset | PluginData
    is_whole: bool
    _referred: Dataset | None = None
    _last: tuple[Dataset, State, Dataset] | None = None
    _ghost: tuple[State, float | None, Dataset] | None = None
    _walls: tuple[Dataset, Dataset | None] | None = None

    def of(self, scene: Scene) -> Dataset | PluginData:
        """The data in the state of a scene; SceneError if they can't have it."""
        data = self._with_reference(scene)
        if scene.deform is None and not scene.complexes:
            return data
        if not isinstance(data, Dataset):
            key = "phase" if scene.deform is None else "deform"
            raise SceneError(f"{key}: expected fields of files, found data of plugin {data.name}: remove {key}")
        if self._is_in(data, scene):
            return data
        if not self.is_whole:
            raise SceneError("deform, phase: data read in parts cannot change these: open the data with them")
        state = scene.complexes, scene.deform
        if self._last is None or self._last[0] is not data or self._last[1] != state:
            self._last = data, state, self._in_state(data, *state)
        return self._last[2]

    def _with_reference(self, scene: Scene) -> Dataset | PluginData:
        """The data with the reference values of a scene; the same object for the same values."""
        if not isinstance(self.data, Dataset):
            return self.data
        wanted = over(self.data.reference, scene.reference.values)
        if wanted == self.data.reference:
            return self.data
        if self._referred is None or self._referred.reference != wanted:
            self._referred = replace(self.data, reference=wanted)
        return self._referred

    def ghosts(self, scene: Scene) -> dict[str, Dataset]:
        """Geometries that a scene draws next to the data, by name; the same objects for the same geometries.

        SceneError for data that were not read whole, or have a limit of memory.
        """
        deform = scene.deform
        if deform is None or not scene.companions:
            return {}
        if not self.is_whole or scene.memory is not None:
            raise SceneError(not_at_hand(scene.companions[0]))
        found = {UNDEFORMED: self._undeformed(scene, deform)} if deform.undeformed else {}
        walls = self._walls_of(scene) if deform.walls else None
        return found if walls is None else {**found, WALLS: walls}

    def remarks(self, scene: Scene) -> tuple[str, ...]:
        """Remarks on the walls of a height that a scene shows."""
        if scene.deform is None or not scene.deform.walls:
            return ()
        walls = self._walls_of(scene)
        if walls is None:
            return (f"{WALLS}: the height does not jump between elements, so there are none",)
        count = walls.mesh.count
        strips = "1 vertical strip closes a jump" if count == 1 else f"{count} vertical strips close the jumps"
        return (f"{WALLS}: {strips} of the height; values and positions in records leave walls out",)

    def _walls_of(self, scene: Scene) -> Dataset | None:
        """Walls of the height that a scene shows; None where it doesn't jump."""
        data = self.of(scene)
        assert isinstance(data, Dataset)
        if self._walls is None or self._walls[0] is not data:
            self._walls = data, height_walls(data)
        return self._walls[1]

    def _undeformed(self, scene: Scene, deform: Deform) -> Dataset:
        """The data on the undeformed geometry.

        The scale is 0, so that expansions and the order of elements are those of the deformed data.
        """
        state = scene.complexes, deform.at_rest
        if self._ghost is None or self._ghost[:2] != (state, scene.time):
            data = self._with_reference(scene)
            assert isinstance(data, Dataset)
            self._ghost = state, scene.time, timed(self._in_state(data, *state), scene.time)
        return self._ghost[2]

    @staticmethod
    def _is_in(data: Dataset, scene: Scene) -> bool:
        """Whether data have the state of a scene."""
        complexes = scene.complexes
        is_same_phase = complexes.phase is None or complexes.phase == data.phase
        named = named_pairs(complexes.named, tuple(without_phase(data)))
        is_named = named.items() <= data.complexes.items()
        return is_same_phase and is_named and (scene.deform is None or is_deformed(data, scene.deform.deformation))

    @staticmethod
    def _in_state(data: Dataset, complexes: ComplexChoice, deform: Deform | None) -> Dataset:
        """Data with complex fields at a phase, and a geometry that may be made of these."""
        data = with_complexes(data, complexes) if complexes else data
        return data if deform is None else with_deformation(data, deform.deformation)
