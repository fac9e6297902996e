"""Files for the pictures of later steps, each of which may have its own name: ``u_{step:04}.png``."""

from __future__ import annotations

from pathlib import Path

from elvis.core.files.output import Outputs
from elvis.scene.figure.saving import check_suffix
from elvis.scene.model.errors import SceneError
from elvis.scene.model.ownership import check_own
from elvis.scene.model.whole import Scene
from elvis.scene.record.frame import Frame


def outputs_of(scene: Scene, step: int, time: float) -> list[str]:
    """A scene's outputs for a step, its number and time in their names; SceneError for braces that mean nothing."""
    return [_filled(name, step, time) for name in scene.outputs]


def save_step(frame: Frame, step: int, time: float, is_from_file: bool) -> list[str]:
    """Write the picture of a step to its scene's outputs, all or none, and return their names.

    is_from_file  whether a scene file names them: SceneError if one of them is there and was not written by ElVis
    """
    names = outputs_of(frame.scene, step, time)
    if is_from_file:
        check_own(names)
    with Outputs() as together:
        for name in names:
            frame.save(name, plain=frame.scene.plain, outputs=together)
    return names


def first_outputs(scene: Scene) -> list[str]:
    """Outputs of the first step; SceneError if later steps can't be drawn, or if an output can't be written."""
    if scene.range == "series":
        raise SceneError("range: later steps are not known: expected visible, all or two values")
    outputs = outputs_of(scene, 0, 0.0)
    for name in outputs:
        check_suffix(Path(name))
    return outputs


def _filled(name: str, step: int, time: float) -> str:
    """The name of a step's file."""
    try:
        return name.format(step=step, time=time)
    except (LookupError, ValueError, AttributeError, TypeError) as error:
        expected = "a name with {step} or {time}, as u_{step:04}.png"
        raise SceneError(f"outputs: expected {expected}, found {name!r}") from error
