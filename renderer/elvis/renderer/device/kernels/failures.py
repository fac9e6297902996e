"""Errors of a device's own compiler, as messages about objects that can't be drawn."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from elvis.renderer.device.adapters import Adapter
from elvis.renderer.device.errors import DeviceError

#: folder of a kernel's module -> what its kernels draw
DRAWN = {
    "plane": "cut planes",
    "solids": "cut surfaces and clips",
    "faces": "element faces",
    "isosurface": "isosurfaces",
    "volume": "volume rendering",
    "lines": "contour lines and mesh lines",
    "streams": "streamlines and vortex cores",
    "tubes": "tubes",
    "ribbons": "ribbons",
    "glyphs": "arrows",
    "lic": "line integral convolution",
}
#: what kernels outside these folders draw
ANYTHING = "any object"
#: an error of g++, clang or Slang: the file's name and the line
_ERROR_PLACE = re.compile(r"([\w.-]+\.slang)\((\d+)\)\s*:\s*(?:fatal )?error")


@contextmanager
def naming_what_fails(stage: str, folders: list[Path], adapter: Adapter) -> Iterator[None]:
    """Raise a DeviceError that names the kind of object where a device can't compile the kernel of a stage.

    The compiler's output stays off the terminal; the error's cause keeps it for --debug.
    """
    import slangpy

    logger = slangpy.Logger.get()
    level, logger.level = logger.level, slangpy.LogLevel.fatal
    try:
        yield
    except RuntimeError as error:
        raise DeviceError(failure(stage, drawn_by(stage, folders), adapter, str(error))) from error
    finally:
        logger.level = level


def drawn_by(stage: str, folders: list[Path]) -> str:
    """Objects drawn by the kernel of a stage, by the folder of its module."""
    homes = [folder.name for folder in folders if (folder / f"{stage}.slang").is_file()]
    return DRAWN.get(homes[0], ANYTHING) if homes else ANYTHING


def failure(stage: str, drawn: str, adapter: Adapter, output: str) -> str:
    """Message about a kernel that doesn't compile, with the place of the first error in a compiler's output."""
    found = _ERROR_PLACE.search(output)
    place = f" at {found[1]}:{found[2]}" if found else ""
    problem = f"the device {adapter.name} ({adapter.label}) can't draw {drawn} of these data"
    return f"{problem}: it fails to make the kernel {stage}{place}; choose another device"
