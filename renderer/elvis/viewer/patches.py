"""Changes of a scene's table by dotted keys, such as ``objects[0].style.opacity``, and what a page may change."""

from __future__ import annotations

import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from elvis.scene.model.errors import SceneError
from elvis.scene.model.middle_planes import with_middles
from elvis.scene.model.permissions import check_texts
from elvis.scene.model.tables import Table, input_files, scene_of, steps_of, table_of
from elvis.scene.model.whole import Scene

#: keys of a scene that define inputs, code and outputs, or that have no meaning on a page
FIXED = {"data", "plugin", "reader", "others", "complex", "device", "outputs", "stats", "scenes", "panels", "timeout"}
#: the only key of a deformation that a page may change: displacements are data
SCALE = ["deform", "scale"]
#: keys of objects
_OBJECT = re.compile(r"plane|(objects|clip)\[(\d{1,9})\]")


def patched(table: Table, changes: Mapping[str, Any]) -> Table:
    """The table with values in other places; None takes a key away, in a list the item.

    A number one past the end of a list adds an item.  SceneError for places that a table hasn't.
    """
    result = deepcopy(table)
    for key, value in changes.items():
        steps = steps_of(key)
        if steps[0] in FIXED or (steps[0] == SCALE[0] and not _is_scale(table, steps, value)):
            raise SceneError(f"{key}: cannot be changed while the viewer runs; restart elvis view with another value")
        try:
            _set(result, steps, value)
        except (IndexError, KeyError, TypeError, AttributeError, ValueError) as error:
            raise SceneError(f"{key[:80]}: the scene has no such key") from error
    return result


def _is_scale(table: Table, steps: list[int | str], value: Any) -> bool:
    """Whether a change of a deformation is one of its scale: of that key, or of a table that is otherwise the same."""
    known = table.get(SCALE[0])
    if not isinstance(known, Mapping):
        return False
    if steps != SCALE[:1]:
        return steps == SCALE
    own, other = ({key: each for key, each in dict(some).items() if key != SCALE[1]} for some in (known, value or {}))
    return own == other


def _set(table: Any, steps: list[int | str], value: Any) -> None:
    """Set, add or take away what stands at the end of some steps."""
    place = table
    for step, following in pairwise(steps):
        if isinstance(step, int):
            place = place[step]
        else:
            place = place.setdefault(step, [] if isinstance(following, int) else {})
    last = steps[-1]
    if value is None:
        del place[last]
    elif isinstance(last, int) and last == len(place):
        place.append(value)
    else:
        place[last] = value


def placed(table: Table, scene: Scene, facts: Table | None) -> Table:
    """The table of a scene with planes instead of those through the middle of the data, which a page could not move.

    facts  about the data; None before they are known
    """
    box = facts.get("box") if facts else None
    shown = scene if box is None else with_middles(scene, lambda: np.array(box))
    return table if shown is scene else {**table, **table_of(Scene(objects=shown.objects, clip=shown.clip))}


def without(table: Table, key: str) -> tuple[Table, Table]:
    """The table without an object, and what `put_back` takes: its key and itself.

    key  ``plane``, ``objects[n]`` or ``clip[n]``; SceneError for another one
    """
    name, number = _place(key)
    result = deepcopy(table)
    try:
        item = result.pop(name) if number is None else result[name].pop(number)
    except (IndexError, KeyError) as error:
        raise SceneError(f"{key}: the scene has no such object") from error
    if number is not None and not result[name]:
        del result[name]
    return result, {"key": key, "item": item}


def put_back(table: Table, hidden: Table) -> Table:
    """The table with an object at its previous place, or at the end; a second plane becomes a cut."""
    name, number = _place(hidden["key"])
    result, item = deepcopy(table), deepcopy(hidden["item"])
    if number is None and name not in result:
        result[name] = item
    elif number is None:
        result.setdefault("objects", []).append({"kind": "cut", "surface": {"kind": "plane", **item}})
    else:
        result.setdefault(name, []).insert(number, item)
    return result


def _place(key: str) -> tuple[str, int | None]:
    """The key of a scene that holds an object, and its number where that is a list."""
    found = _OBJECT.fullmatch(key)
    if found is None:
        raise SceneError(f"{key[:80]}: expected plane, objects[n] or clip[n]")
    return ("plane", None) if key == "plane" else (found[1], int(found[2]))


def scene_of_page(table: Table, own: Scene) -> Scene:
    """The scene of a table that came from a page; SceneError where it isn't valid, or reads files that it may not.

    own  the scene that the viewer started with, whose files may be read, and others in the folders of its data
    """
    check_texts(table)
    scene = scene_of({key: value for key, value in table.items() if key not in FIXED})
    known = {path.resolve() for path in input_files(own)}
    folders = {path.parent for path in known}
    for path in input_files(scene):
        place = path.resolve()
        if place not in known and not any(folder in place.parents for folder in folders):
            raise SceneError(f"{path}: a page may only read files in the folder of the data")
    settled = {key: getattr(own, key) for key in ("data", "plugin", "reader", "others", "complex", "device")}
    deform = own.deform
    if deform is not None and scene.deform is not None:
        deform = replace(deform, scale=scene.deform.scale)
    return replace(scene, **settled, deform=deform)


def folder_of(own: Scene) -> Path:
    """Assumed folder of a saved scene: the data's folder."""
    return Path(own.data[0]).parent if own.data else Path()
