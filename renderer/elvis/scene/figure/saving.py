"""Pictures and records as files: PNG, HTML, multi-channel EXR, NPZ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from elvis.core.data.moments import Instant
from elvis.core.files.output import Outputs, replacing
from elvis.scene.figure.figure import needs_figure, save_figure
from elvis.scene.figure.page import Layout
from elvis.scene.figure.png import write_png
from elvis.scene.model.errors import SceneError
from elvis.scene.model.ownership import JPEG_COMMENT, SOFTWARE
from elvis.scene.model.permissions import HTML, JPEG, PICTURES, PIXELS
from elvis.scene.model.whole import VECTORS
from elvis.scene.record.frame import Frame, Status

#: pixels beyond which a picture is made and compressed some rows at a time, which takes longer but no memory
LARGE = 1 << 24
#: of the sides of a JPEG file
LONGEST_JPEG = 65500


def check_suffix(path: Path) -> None:
    """Raise SceneError if the file's suffix belongs to no output format."""
    if path.suffix.lower() not in PICTURES:
        raise SceneError(
            f"{path}: expected a name that ends in {', '.join(PICTURES)}, found {path.suffix or 'no suffix'}"
        )


def save_panels(frames: Sequence[Frame], path: Path, *, plain: bool = False, outputs: Outputs | None = None) -> None:
    """Write one figure of several pictures, which stand in rows and columns as the first one's scene says."""
    suffix = path.suffix.lower()
    if suffix not in (*VECTORS, *PIXELS):
        known = ", ".join((*PIXELS, *VECTORS))
        raise SceneError(f"{path}: expected a name that ends in {known} for panels, found {path.suffix}")
    with replacing(path, outputs) as temporary:
        if suffix in JPEG:
            _save_jpeg(frames[0], temporary, lambda stream: save_figure(frames, stream, ".png", plain=plain))
        else:
            save_figure(frames, temporary, suffix, plain=plain)


def save(frame: Frame, path: Path, *, plain: bool = False, outputs: Outputs | None = None) -> None:
    """Write the frame in the format of the file's suffix; nothing is left under the name where writing fails.

    outputs  with which the file takes its place, where it is one of several
    """
    check_suffix(path)
    with replacing(path, outputs) as temporary:
        match path.suffix.lower():
            case suffix if suffix in VECTORS or (suffix == ".png" and needs_figure(frame, suffix)):
                save_figure([frame], temporary, suffix, plain=plain)
            case ".png":
                with temporary.open("wb") as stream:
                    save_png(frame, stream, plain=plain)
            case suffix if suffix in JPEG:
                _save_jpeg(frame, temporary, lambda stream: save_pixels(frame, stream, plain=plain))
            case suffix if suffix == HTML:
                save_web_page([frame], temporary, plain=plain)
            case ".exr":
                _save_exr(frame, temporary)
            case _:
                with temporary.open("wb") as stream:
                    np.savez_compressed(stream, **arrays(frame))


def save_pixels(frame: Frame, stream: BinaryIO, *, plain: bool) -> Layout:
    """Write the picture as PNG, with a figure around it where the scene asks for one; where things lie on it."""
    if needs_figure(frame, ".png"):
        return save_figure([frame], stream, ".png", plain=plain)
    return save_png(frame, stream, plain=plain)


def save_views(
    frames: Sequence[Frame],
    directions: Sequence[str],
    path: Path,
    *,
    plain: bool = False,
    outputs: Outputs | None = None,
) -> None:
    """Write one HTML file of a scene, by times and then by directions, which have names."""
    with replacing(path, outputs) as temporary:
        save_web_page(frames, temporary, directions, plain=plain)


def save_web_page(frames: Sequence[Frame], path: Path, names: Sequence[str] = (), *, plain: bool = False) -> None:
    """Write one HTML file of a scene, at one or several times from one or several directions, which have names."""
    from elvis.scene.web_page import web_page

    pictures = []
    for frame in frames:
        stream = BytesIO()
        layout = save_pixels(frame, stream, plain=plain)
        pictures.append((stream.getvalue(), layout))
    path.write_text(web_page(frames, pictures, names), encoding="utf-8", newline="\n")


def _save_jpeg(frame: Frame, path: Path, make: Callable[[BinaryIO], object]) -> None:
    """Write as JPEG a picture made as PNG; SceneError for a transparent background and for sides that are too long."""
    if frame.scene.is_clear:
        raise SceneError("background: JPEG has no transparency: expected three numbers, or a .png")
    pixels = BytesIO()
    make(pixels)
    with Image.open(pixels) as image:
        if max(image.size) > LONGEST_JPEG:
            raise SceneError(f"JPEG: expected sides of {LONGEST_JPEG} pixels at most, found {max(image.size)}")
        # no subsampling of colours, which blurs lines
        image.convert("RGB").save(path, "JPEG", quality=95, subsampling=0, comment=JPEG_COMMENT)


def save_png(frame: Frame, stream: BinaryIO, *, plain: bool) -> Layout:
    """Write the picture, a large one row by row; where things lie on it."""
    from elvis.scene.figure.picture import page

    if frame.scene.is_clear:
        Image.fromarray(frame.rgba, "RGBA").save(stream, format="PNG", pnginfo=_software())
        return page(frame, plain=True).layout
    whole = page(frame, plain=plain)
    if frame.view.count <= LARGE:
        Image.fromarray(whole.rows(0, whole.height), "RGB").save(stream, format="PNG", pnginfo=_software())
    else:
        write_png(stream, whole.width, whole.height, whole.strips(), SOFTWARE)
    return whole.layout


def _software() -> PngInfo:
    """The text of a PNG file that names the program."""
    texts = PngInfo()
    texts.add_text("Software", SOFTWARE)
    return texts


def arrays(frame: Frame) -> dict[str, Any]:
    """The record by name: (height, width[, 3]) arrays of float64 or int64.

    Raises SceneError if the frame was drawn without reference coordinates.
    """
    if frame.reference is None:
        raise SceneError("an exact record needs reference coordinates: draw with references=True")
    return {
        "color": frame.color,
        "depth": frame.depth,
        "field": frame.field,
        "element": frame.element,
        "position": frame.position,
        "reference": frame.reference,
        "normal": frame.normal,
        "status": frame.status.astype(np.int64),
        "uncertainty": frame.uncertainty,
        **({} if frame.copy is None else {"copy": frame.copy.astype(np.int64)}),
        **({} if frame.instant is None else _of_series(frame.instant)),
        **_of_deformation(frame),
    }


def _of_deformation(frame: Frame) -> dict[str, Any]:
    """Sentences (n,) on the deformation of the data, which name it and where gradients are taken."""
    known = frame.stats.get("deformation")
    return {} if known is None else {"deformation": np.array(known["remarks"])}


def _of_series(instant: Instant) -> dict[str, Any]:
    """Which moment of a series a record is of."""
    return {
        "time": np.float64(instant.time),
        "steps": np.array(instant.steps, np.int64),
        "between": np.array(instant.between or ""),
    }


def _save_exr(frame: Frame, path: Path) -> None:
    """Channels R G B A, Z, field, uncertainty, element, status, and the vectors by component, as 32-bit numbers."""
    import OpenEXR

    def single(values: Any) -> Any:
        return np.ascontiguousarray(values, dtype=np.float32)

    record = arrays(frame)
    channels = {name: single(record["color"][..., i]) for i, name in enumerate("RGB")}
    shown = frame.seen | (frame.status == Status.CERTAIN)
    channels |= {"A": single(shown), "Z": single(record["depth"]), "field": single(record["field"])}
    channels["uncertainty"] = single(record["uncertainty"])
    for name in ("position", "reference", "normal"):
        channels |= {f"{name}.{axis}": single(record[name][..., i]) for i, axis in enumerate("XYZ")}

    # -1 has no place among unsigned numbers: the greatest one stands for nothing
    channels["element"] = np.ascontiguousarray(frame.element.astype(np.uint32))
    channels["status"] = np.ascontiguousarray(frame.status.astype(np.uint32))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "software": SOFTWARE}
    # by way of memory: the library says nothing where the end of a file does not fit on a disk
    content = BytesIO()
    with OpenEXR.File(header, channels) as file:
        file.write(content)
    path.write_bytes(content.getvalue())
