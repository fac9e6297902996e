"""One HTML file with pictures and the record of each pixel: any browser opens it, without ElVis or a server.

The file contains its own code and requests nothing.  The security policy in its head permits only that code, by its
hash, so that no text from the data can act.
"""

from __future__ import annotations

import json
import os
import zlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from html import escape
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from elvis.core.base.terminal import visible
from elvis.core.base.version import __version__
from elvis.scene.figure.page import Layout
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import scene_text
from elvis.scene.model.ownership import HTML_GENERATOR
from elvis.scene.model.tables import with_files
from elvis.scene.record.frame import Frame

#: pixels of all pictures of a file: browsers take texts of about half a GiB
MAX_PIXELS = 1 << 24
#: pixels of the sides of a WebP image
LONGEST_WEBP = 16383
#: integers and floats of 4 bytes, and what takes their place if values lie outside their range
NARROW: dict[str, np.dtype[Any]] = {"i": np.dtype("<i4"), "f": np.dtype("<f4"), "u": np.dtype("<u1")}
WIDE = np.dtype("<f8")


def web_page(frames: Sequence[Frame], pictures: Sequence[tuple[bytes, Layout]], names: Sequence[str] = ()) -> str:
    """The text of an HTML file.

    frames    views of one scene, by times and then by directions
    pictures  file and layout of each one's picture
    names     of the directions; none for a single one

    Raises SceneError for too many pixels.
    """
    pixels = sum(frame.view.count for frame in frames)
    if pixels > MAX_PIXELS:
        raise SceneError(f"HTML: expected at most {MAX_PIXELS} pixels in all pictures, found {pixels}")
    first = frames[0]
    times = _times(frames, len(names))
    # titles of pictures of a series name their time
    title = escape(visible(_quantity(first) if times else _title(first)))
    shown = [_view(frame, layout) for frame, (_, layout) in zip(frames, pictures, strict=True)]
    facts = {
        "quantity": visible(_quantity(first)),
        "directions": list(names),
        "times": times,
        "views": shown,
    }
    parts = {
        "TITLE": title,
        "VERSION": escape(__version__),
        "GENERATOR": HTML_GENERATOR,
        "IMAGES": "\n".join(_image(file, title, k) for k, (file, _) in enumerate(pictures)),
        "SCENE": escape(_scene_text(first)),
        # no text may end the element that contains it
        "RECORD": json.dumps(facts).replace("<", "\\u003c"),
        "TYPES": " and ".join(sorted({view[key]["type"] for view in shown for key in ("value", "depth")})),
    }
    return _filled(parts)


def _filled(parts: dict[str, str]) -> str:
    """The template with its style, its code, their hashes, and other parts; each is inserted once."""
    folder = files("elvis.scene.web_page")
    template, style, code = ((folder / name).read_text("utf-8") for name in ("page.html", "page.css", "page.js"))
    every = {**parts, "STYLE": style, "CODE": code, "STYLE_HASH": _hash(style), "CODE_HASH": _hash(code)}
    # the pieces between marks alternate with names of parts, so that no part is searched for marks
    pieces = template.split("@@")
    return "".join(every[piece] if number % 2 else piece for number, piece in enumerate(pieces))


def _hash(text: str) -> str:
    """A source in a Content-Security-Policy that permits an inline element of that text."""
    return f"sha256-{b64encode(sha256(text.encode()).digest()).decode()}"


def _title(frame: Frame) -> str:
    """The title of the picture, else the names of its files."""
    return frame.title or ", ".join(map(os.path.basename, frame.scene.data)) or "ElVis"


def _times(frames: Sequence[Frame], directions: int) -> list[str]:
    """The times of the views; none if all have the same."""
    instants = [frame.instant for frame in frames[:: max(1, directions)]]
    return [f"{instant.time:.6g}" for instant in instants if instant is not None] if len(instants) > 1 else []


def _quantity(frame: Frame) -> str:
    """The quantity of the values in the record, ``value`` if objects have several."""
    titles = {legend.title for legend in frame.legends if legend.palette is not None}
    return titles.pop() if len(titles) == 1 else "value"


def _scene_text(frame: Frame) -> str:
    """The scene as TOML with the camera and size of the picture; folders of files are private."""
    size = frame.view.width, frame.view.height
    scene = replace(frame.scene, camera=frame.view.camera, size=size, outputs=(), stats=None)
    return scene_text(with_files(scene, os.path.basename), Path("scene.toml"))


def _image(file: bytes, title: str, number: int) -> str:
    """An img element with a lossless picture; all but the first are hidden."""
    kind = "png"
    with Image.open(BytesIO(file)) as image:
        if max(image.size) <= LONGEST_WEBP:
            stream = BytesIO()
            image.save(stream, "WEBP", lossless=True, exact=True, quality=75, method=3)
            file, kind = stream.getvalue(), "webp"
        width, height = image.size
    data = b64encode(file).decode()
    hidden = " hidden" if number else ""
    return f'<img src="data:image/{kind};base64,{data}" width="{width}" height="{height}" alt="{title}"{hidden}>'


def _view(frame: Frame, layout: Layout) -> dict[str, Any]:
    """The record of a picture as plain data: arrays by row, rays of the pixels, position of the image on its page."""
    view = frame.view
    vectors: dict[str, Any] = {
        "eye": view.camera.eye,
        "forward": view.camera.basis()[2],
        "corner": view.corner,
        "column": view.column,
        "row": view.row,
    }
    return {
        "size": [view.width, view.height],
        "page": list(layout.size),
        "corner": list(layout.corner),
        "rays": {"is_perspective": view.perspective, **{key: list(map(float, own)) for key, own in vectors.items()}},
        "value": _packed(frame.field),
        "depth": _packed(frame.depth),
        "element": _packed(frame.element),
        "status": _packed(frame.status),
        "proof": _packed(frame.line_status),
    }


def _packed(values: NDArray[Any]) -> dict[str, str]:
    """An array in few characters: narrow numbers, all first bytes before all second ones, deflated, as base64."""
    narrow = _narrow(values)
    planes = narrow.reshape(-1, 1).view(np.uint8).T
    return {"type": narrow.dtype.name, "data": b64encode(zlib.compress(planes.tobytes(), 9)).decode()}


def _narrow(values: NDArray[Any]) -> NDArray[Any]:
    """Numbers of few bytes, of 8 if some are too large or, but for zero, too small for normal numbers of 4 bytes."""
    kind = NARROW[values.dtype.kind]
    known = np.abs(values[np.isfinite(values)])
    if kind.kind == "f":
        limits = np.finfo(kind)
        fits = np.all((known == 0) | ((known >= limits.tiny) & (known <= limits.max)))
    else:
        fits = np.all(known <= np.iinfo(kind).max)
    return np.ascontiguousarray(values, kind if fits else WIDE)
