"""Files that a page may write: with names in the folder of the data or below, if the viewer allows it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from elvis.core.base.errors import ElvisError
from elvis.core.files.output import check_inputs, check_place
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import SUFFIXES
from elvis.scene.model.permissions import PICTURES, check_texts, fault_of


class TakenError(ElvisError):
    """A file of that name exists, and replacing it was not confirmed."""


def place_of(name: str, folder: Path, inputs: Iterable[Path], is_confirmed: bool) -> Path:
    """The place of a file that a page wants to have written, in ``folder`` or below.

    inputs  which it can't be, nor lie in
    is_confirmed  whether it may take the place of another file; TakenError where it has to, else

    Raises SceneError for names that lead elsewhere or are none of a picture, record or scene, ElvisError where it is
    an input or nothing can be written.
    """
    check_texts({"name": name})
    fault = fault_of(name, (*PICTURES, *SUFFIXES), folder)
    if fault:
        raise SceneError(f"expected {fault}, found {name!r:.200}")
    place = folder / name
    check_inputs([place], inputs, advice="name another file")
    check_place(place)
    if os.path.lexists(place) and not is_confirmed:
        raise TakenError(f"{name} already exists")
    return place
