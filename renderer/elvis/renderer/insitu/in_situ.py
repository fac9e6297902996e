"""Pictures of a running solver, from its own arrays: nothing is written but pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import number_of_process
from elvis.core.base.terminal import one_line, warn
from elvis.core.data.dataset import Dataset
from elvis.core.files.output import check_place
from elvis.core.mapping.geometry import share
from elvis.plugins.data.run_states import states_of
from elvis.renderer.asking.request import asked_by
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.insitu.triggers import Trigger
from elvis.scene import Scene
from elvis.scene.commandline.keywords import scene_of_keywords
from elvis.scene.figure.step_outputs import first_outputs, save_step
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import read_scene
from elvis.scene.model.ownership import check_own
from elvis.scene.record.frame import Frame

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


class Session:
    """Pictures of a solver's steps: ``Session(mesh, "scene.toml", every=10).show(step, time, {"u": array})``.

    mesh       a dataset: arrays are then coefficients (n, m) of its expansions; or positions of nodes (n, k, d) by
               shape,
               as in `from_arrays`: arrays are then values (n, k) or components (n, k, c) there
    scene      a Scene or a scene file, which keywords change, as of `render`; its outputs may have {step} and {time}
    every      number of steps from one picture to the next
    when       a condition, such as ``max(mach) > 1`` or ``min(rho) < 0.1 and max(p) > 2``: no picture if certified
               bounds prove it false
    reference  as of `from_arrays`
    device     as of `render`

    Results that depend on the mesh, the structure of bounds, kernels and the device are reused from step to step.

    Raises ElvisError for an invalid mesh, scene or trigger, before the solver has begun.
    """

    def __init__(
        self,
        mesh: Any,
        scene: Scene | str | Path | None = None,
        *,
        every: int = 1,
        when: str = "",
        reference: Mapping[str, Any] | None = None,
        device: str | None = None,
        **keywords: Any,
    ) -> None:
        _check_is_first_rank()
        base = scene if isinstance(scene, Scene) or scene is None else read_scene(scene)
        self.scene = scene_of_keywords(keywords, base) if keywords else base or Scene()
        self.faults: list[str] = []
        self._kinds: set[str] = set()
        self.drawn = 0
        self._trigger = Trigger.of(every, when)
        # copies may need further components of vectors: no quantities stand for all fields
        is_copied = self.scene.copies is not None
        self._quantities = () if is_copied else (*asked_by([self.scene]), *self._trigger.quantities)
        self._states = states_of(mesh, reference)
        self._device = device or self.scene.device
        self._pictures: Pictures | None = None
        self._is_from_file = not (isinstance(scene, Scene) or scene is None or {"output", "outputs"} & keywords.keys())
        _check(self.scene, self._is_from_file)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Session: {self.drawn} pictures drawn, {len(self.faults)} faults>"

    def close(self) -> None:
        """Release the device; the next picture opens it again."""
        pictures, self._pictures = self._pictures, None
        if pictures is not None:
            pictures.close()

    def is_due(self, step: int) -> bool:
        """Whether ``every`` selects a step: other steps need no arrays."""
        return self._trigger.is_due(step)

    def show(self, step: int, time: float, fields: Mapping[str, Any] | Callable[[], Any]) -> Frame | None:
        """The picture of a step, written to the scene's outputs; None if the step is skipped or drawing fails.

        step    number of the step, from 0
        time    of the solver
        fields  arrays by name, of NumPy or with DLPack; or a dataset, as of `from_blueprint`; or a function that
                returns them,
                which is called only if they are needed

        Only a signal (Ctrl-C) or an exit leaves this function: errors are reported on standard error, each message once
        for all its numbers, and stored in ``faults``; the next step is tried again.
        """
        try:
            return self._show(step, time, fields)
        except Exception as error:  # noqa: BLE001 - no fault of a picture may stop the solver
            self._report(step, error)
            return None

    def _show(self, step: int, time: float, fields: Any) -> Frame | None:
        if not self.is_due(step):
            return None
        time = _number(time)
        data = self._states.at(time, fields() if callable(fields) else fields, self._quantities)
        for sentence in _values_missing(data):
            self._note(sentence, f"step {step}")
        if not self._trigger.holds(data):
            return None
        if self._pictures is None:
            share(data.mesh)
            self._pictures = Pictures(data, self._device)
        else:
            self._pictures.show(data)
        frame = self._pictures.draw(self.scene)
        save_step(frame, step, time, self._is_from_file)
        self.drawn += 1
        return frame

    def _report(self, step: int, error: Exception) -> None:
        """Report a fault once: faults that differ only in numbers, such as steps or values, are the same."""
        told = str(error) if isinstance(error, ElvisError) else f"{type(error).__name__}: {error}"
        self._note(one_line(told), f"step {step} was not drawn; the solver continues")

    def _note(self, sentence: str, beginning: str) -> None:
        """Keep a fault and print it, unless one that differs only in numbers is known."""
        kind = _NUMBER.sub("#", sentence)
        if kind not in self._kinds:
            self._kinds.add(kind)
            self.faults.append(sentence)
            warn(f"{beginning}: {sentence}")


def _check_is_first_rank() -> None:
    """Raise ElvisError in ranks other than the first: each would draw its part over the pictures of the others."""
    number = number_of_process()
    if number:
        raise ElvisError(
            f"a Session draws the whole domain in one process, but this is rank {number}: "
            "gather mesh and arrays on rank 0, and create the Session only there"
        )


def _values_missing(data: Dataset) -> Iterator[str]:
    """A sentence for each field with values that are not finite: the solver has diverged, or an array is unset."""
    for field in data.fields:
        bad = sum(int((~np.isfinite(block.coefficients).all(axis=1)).sum()) for block in field.blocks)
        if bad:
            yield f"field {field.name!r}: expected finite numbers, found NaN or infinity in {bad} elements"


def _number(time: Any) -> float:
    """A time; SceneError for an invalid one."""
    try:
        return float(time)
    except (TypeError, ValueError) as error:
        raise SceneError(f"time: expected a number, found {time!r:.60}") from error


def _check(scene: Scene, is_from_file: bool) -> None:
    """SceneError if later steps can't be drawn or written."""
    if scene.data:
        raise SceneError("data: expected none in the scene, as the running solver provides them")
    for name in first_outputs(scene):
        check_place(Path(name))
        if is_from_file:
            check_own([name])
