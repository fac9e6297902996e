"""Frames and animations on disk: valid frames are reused, and animations are made from all of them.

A folder of frames has a record, ``film.json``, of the contents of each.  A frame is reused if the record matches and
the frame is newer than the data, so an interrupted run continues where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module
from elvis.core.base.terminal import note
from elvis.core.files.output import Outputs, write_text

RECORD = "film.json"
#: how animations end
FILMS = (".webp", ".mp4", ".gif")
#: settings of WebP: lossless, as lossy animations keep traces of earlier frames where colours change little; a higher
#: effort makes files a tenth smaller at twice the time
_WEBP = {"lossless": True, "method": 3, "quality": 75}

#: maximum frames per second of GIF: browsers show delays below two hundredths of a second as a tenth
_FASTEST_GIF = 50


def check_film(path: Path) -> None:
    """ElvisError where an animation can't be written, before any long work."""
    if path.suffix.lower() == ".mp4":
        require_module("av", "MP4", "video")


class FrameFolder:
    """The frames of an animation in a folder, by number.

    scenes    plain data of the scene of each frame
    coloured  the range over all steps and its dependencies, as in `known_range`; None for another range
    """

    def __init__(
        self, folder: Path, scenes: Sequence[Any], inputs: Sequence[Path], coloured: Mapping[str, Any] | None = None
    ) -> None:
        self.folder, self.scenes = folder, json.loads(json.dumps(list(scenes)))
        self._coloured, self._newest = coloured, _newest(inputs)

    def path(self, number: int) -> Path:
        """The file of a frame."""
        return self.folder / f"frame-{number:05d}.png"

    def paths(self) -> list[Path]:
        """The files of the existing frames, in order; frames of unreadable steps are missing."""
        return [path for path in map(self.path, range(len(self.scenes))) if path.exists()]

    def begin(self) -> list[int]:
        """The numbers of the frames that are to be drawn; others that are there and can't be retained are removed."""
        self.folder.mkdir(parents=True, exist_ok=True)
        known = self._known()
        there = sorted(self.folder.glob("frame-*.png"))
        if there and known is None:
            raise ElvisError(
                f"{self.folder}: expected frames of an animation, found {there[0].name} without a complete {RECORD}"
            )
        kept = [number for number, scene in enumerate(self.scenes) if self._is_good(number, scene, known or [])]
        names = {self.path(number) for number in kept}
        for path in there:
            if path not in names:
                path.unlink()
        with Outputs() as outputs:
            record = {"frames": self.scenes, **({"series": self._coloured} if self._coloured else {})}
            write_text(self.folder / RECORD, json.dumps(record, indent=1) + "\n", outputs)
        return [number for number in range(len(self.scenes)) if number not in kept]

    def drop_empty(self) -> None:
        """Remove the record if no frame was drawn, and the folder if nothing else is in it."""
        if self.folder.is_dir() and not self.paths():
            (self.folder / RECORD).unlink(missing_ok=True)
            with suppress(OSError):
                self.folder.rmdir()

    def _known(self) -> list[Any] | None:
        """The frames in the record; None if there is none."""
        found = _record(self.folder).get("frames")
        return found if isinstance(found, list) else None

    def _is_good(self, number: int, scene: Any, known: Sequence[Any]) -> bool:
        path = self.path(number)
        is_same = number < len(known) and known[number] == scene
        return is_same and path.exists() and path.stat().st_mtime_ns > self._newest

    def images(self) -> Iterator[Image.Image]:
        """The frames in order, all of one size, over white: some are larger where numbers on their bars are longer."""
        paths = self.paths()
        sizes = []
        for path in paths:
            with Image.open(path) as image:
                sizes.append(image.size)
        width, height = np.max(sizes, axis=0).tolist()
        for path in paths:
            with Image.open(path) as image:
                page = Image.new("RGB", (width, height), "white")
                page.paste(image, (0, 0), image if image.mode == "RGBA" else None)
            yield page


def known_range(folder: Path, of: Mapping[str, Any], inputs: Sequence[Path]) -> tuple[float, float] | None:
    """The stored range over all steps of an animation in a folder, if its dependencies and the data are unchanged.

    of  its dependencies, as plain data
    """
    record = folder / RECORD
    if not record.is_file() or record.stat().st_mtime_ns <= _newest(inputs):
        return None
    match _record(folder).get("series"):
        case {"of": found, "range": [float(low), float(high)]} if found == of:
            return low, high
    return None


def _record(folder: Path) -> dict[str, Any]:
    """The contents of the record in a folder; empty if there is none."""
    try:
        found = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _newest(inputs: Sequence[Path]) -> int:
    """When the last of the files that are there was changed, in ns."""
    return max((path.stat().st_mtime_ns for path in inputs if path.exists()), default=0)


def write_film(frames: FrameFolder, path: Path, rate: float) -> None:
    """All frames as one animation, by the suffix of its name.

    rate  frames a second
    """
    with Outputs() as outputs, outputs.file(path) as new:
        if path.suffix.lower() == ".mp4":
            _write_mp4(frames, new, rate)
        elif path.suffix.lower() == ".gif":
            _write_gif(frames, new, rate)
        else:
            first, *rest = list(frames.images())
            duration = max(1, round(1000 / rate))
            first.save(new, "WEBP", save_all=True, append_images=rest, duration=duration, loop=0, **_WEBP)


def _write_mp4(frames: FrameFolder, path: Path, rate: float) -> None:
    """H.264 with half the resolution of colours, which every player shows; sides must be even then."""
    av = require_module("av", "MP4", "video")
    with av.open(str(path), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=Fraction(rate).limit_denominator(1001), options={"crf": "16"})
        stream.pix_fmt = "yuv420p"
        for number, image in enumerate(frames.images()):
            if number == 0:
                stream.width, stream.height = (side + side % 2 for side in image.size)
            page = Image.new("RGB", (stream.width, stream.height), "white")
            page.paste(image)
            film.mux(stream.encode(av.VideoFrame.from_image(page)))
        film.mux(stream.encode())


def _write_gif(frames: FrameFolder, path: Path, rate: float) -> None:
    """Frames of 256 colours each, shown for whole hundredths of a second, whose sum is right to half of one."""
    if rate > _FASTEST_GIF:
        note(f"{path.suffix}: it shows at most {_FASTEST_GIF} frames per second, slower than {rate:g}")
    images = [image.quantize(256, dither=Image.Dither.NONE) for image in frames.images()]
    ends = np.rint(100.0 * np.arange(len(images) + 1) / rate)
    durations = [10 * max(2, int(own)) for own in np.diff(ends)]
    first, *rest = images
    first.save(path, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, disposal=1)
