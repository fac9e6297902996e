"""The request of a call of `render`: data, a scene, and output files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from elvis.core.data.dataset import Dataset
from elvis.core.files.output import Outputs, check_places
from elvis.plugins.data.data import Reading, pairs
from elvis.plugins.runtime.opening import PluginData
from elvis.scene import Scene
from elvis.scene.model.errors import SceneError
from elvis.scene.model.quantities import quantities, vector_components
from elvis.scene.model.tables import input_files
from elvis.scene.record.frame import Frame

#: how names of files end, and texts of quantities don't
_SUFFIX = re.compile(r"\.[A-Za-z][A-Za-z0-9_]*$")


def reading_of(scene: Scene, is_kept: bool = True) -> Reading:
    """How a scene wants its files read, and which moment of a series.

    is_kept  whether conversions are cached
    """
    own = Reading(scene.plugin, pairs(scene.reader), is_kept, scene.moment, scene.others)
    deformation = None if scene.deform is None else scene.deform.deformation
    reference, complexes = scene.reference.values, scene.complexes
    own = replace(own, reference=reference, deformation=deformation, complexes=complexes)
    return replace(own, is_copied=scene.copies is not None)


def reading_for(scenes: Sequence[Scene], is_kept: bool = True) -> Reading:
    """Options for reading files that are only used for pictures of scenes, all of the moment of the first."""
    is_copied = any(scene.copies is not None for scene in scenes)
    return replace(reading_of(scenes[0], is_kept), quantities=asked_by(scenes), is_copied=is_copied)


def asked_by(scenes: Sequence[Scene]) -> tuple[str, ...]:
    """All that pictures of scenes evaluate, each once; an empty text is the first field of the data."""
    texts = (text for scene in scenes for text in (*quantities(scene), *vector_components(scene)))
    return tuple(dict.fromkeys(texts))


@dataclass(frozen=True)
class Request:
    """Data at hand, None where they are the files of the scene; the scene; the files that are to be written."""

    data: Dataset | PluginData | None
    scene: Scene
    outputs: tuple[str, ...] = ()

    @staticmethod
    def of(given: Sequence[Any], scene: Scene | None, keywords: Mapping[str, Any]) -> Request:
        """The request of positional values, a scene and keywords; SceneError for contradictions."""
        data, files, rest = _sort_arguments(given)
        for each in rest:
            if isinstance(each, Scene):
                scene = _only(scene, each, "scene")
        texts = [each for each in rest if isinstance(each, str)]
        for text in texts:
            keywords = {**keywords, "field": _only(keywords.get("field"), text, "quantity")}
        if not keywords and not files:
            return Request(data, scene or Scene())
        from elvis.scene.commandline.keywords import scene_of_keywords

        found = scene_of_keywords(keywords, scene, files)
        if not {"output", "outputs"} & keywords.keys():
            return Request(data, found)
        check_places(found.outputs, input_files(found), False)
        return Request(data, found, found.outputs)

    def write(self, frame: Frame) -> None:
        """Write the files, all or none."""
        if not self.outputs:
            return
        with Outputs() as together:
            for name in self.outputs:
                frame.save(name, plain=self.scene.plain, outputs=together)


def _sort_arguments(given: Sequence[Any]) -> tuple[Dataset | PluginData | None, list[Path], list[Any]]:
    """Data, files, and what else there is: a scene, a quantity."""
    items = list(_flat(given))
    if items and isinstance(items[0], (Dataset, PluginData)):
        return items[0], [], [_check(each, False) for each in items[1:]]
    files, rest = list[Path](), list[Any]()
    for each in items:
        is_first = not files
        if isinstance(each, Path) or (isinstance(each, str) and (is_first or _is_file(each))):
            files.append(Path(each))
        else:
            rest.append(_check(each, is_first))
    return None, files, rest


def _flat(given: Sequence[Any]) -> Iterator[Any]:
    """The values, those in lists of files one by one."""
    for each in given:
        if isinstance(each, (list, tuple)):
            yield from each
        else:
            yield each


def _is_file(text: str) -> bool:
    """Whether a text names a file, which need not be there, rather than a quantity."""
    return os.path.exists(text) or _SUFFIX.search(text) is not None


def _check(value: Any, is_first: bool) -> Any:
    """A scene or the text of a quantity; SceneError for anything else."""
    if isinstance(value, (Scene, str)):
        return value
    expected = "data (what read returns, or names of files)" if is_first else "a quantity or a Scene after the data"
    raise SceneError(f"expected {expected}, found {value!r:.60}")


def _only(one: Any, other: Any, what: str) -> Any:
    """Whichever of two is there; SceneError where both are."""
    if one is not None:
        raise SceneError(f"expected one {what}, found {one!r:.60} and {other!r:.60}")
    return other
