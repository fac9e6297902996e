"""Pictures as files: those at rest as ``elvis render`` writes them, drafts in as little time as possible."""

from __future__ import annotations

import tempfile
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from elvis.scene.figure.page import Layout
    from elvis.scene.record.frame import Frame

#: quality of lean pictures, of 100
LEAN_QUALITY = 85
#: colours of pixels by status, over the picture: ambiguous, failed
PROOF_COLORS = {2: (255, 0, 200), 3: (255, 60, 0)}


def file_of(frame: Frame, suffix: str) -> bytes:
    """Contents that `save` writes."""
    with tempfile.TemporaryDirectory(prefix="elvis-") as folder:
        path = Path(folder, f"picture{suffix}")
        frame.save(path, plain=frame.scene.plain)
        return path.read_bytes()


def lossless(frame: Frame) -> tuple[bytes, Layout]:
    """The PNG file that ``elvis render`` writes, and where things lie on it."""
    from elvis.scene.figure.saving import save_pixels

    stream = BytesIO()
    layout = save_pixels(frame, stream, plain=frame.scene.plain)
    return stream.getvalue(), layout


def bare(frame: Frame, is_lean: bool = False) -> tuple[bytes, Layout]:
    """The bare image, which WebP writes faster than PNG: without loss, as its pixels are seen enlarged.

    is_lean  fewer bytes, with loss
    """
    from PIL import Image

    from elvis.scene.figure.page import Layout

    stream = BytesIO()
    quality: dict[str, Any] = {"quality": LEAN_QUALITY} if is_lean else {"lossless": True, "quality": 0}
    Image.fromarray(frame.rgb, "RGB").save(stream, "WEBP", method=0, **quality)
    height, width = frame.element.shape
    return stream.getvalue(), Layout((width, height), (0, 0))


def png(pixels: NDArray[np.uint8]) -> bytes:
    """The file of colours (h, w, 3) in [0, 255]."""
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(pixels, "RGB").save(stream, "PNG", compress_level=1)
    return stream.getvalue()


def with_proof(file: bytes, frame: Frame, corner: tuple[int, int]) -> bytes:
    """The picture in grey, with uncertain pixels in colours."""
    import numpy as np
    from PIL import Image

    with Image.open(BytesIO(file)) as image:
        grey = np.asarray(image.convert("L").convert("RGB")).copy()
    status = frame.line_status
    rows = slice(corner[1], corner[1] + status.shape[0])
    columns = slice(corner[0], corner[0] + status.shape[1])
    part: NDArray[np.uint8] = grey[rows, columns]
    for value, color in PROOF_COLORS.items():
        part[status[: part.shape[0], : part.shape[1]] == value] = color
    stream = BytesIO()
    Image.fromarray(grey, "RGB").save(stream, "PNG")
    return stream.getvalue()
