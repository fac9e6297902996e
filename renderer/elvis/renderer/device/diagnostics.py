"""Messages of the Slang compiler, without repetitions and framing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from elvis.renderer.device.errors import DeviceError

#: a diagnostic starts with its kind; the next line says where it is meant
_START = re.compile(r"^(?=(?:fatal )?(?:error|warning|note)\[E\d+\]|(?:fatal )?error \d+)", re.M)
_PLACE = re.compile(r"^\s*--> (.*?):(\d+):(\d+)\s*$", re.M)


@contextmanager
def errors_alone() -> Iterator[None]:
    """Keep slangpy's warnings off the terminal."""
    import slangpy

    logger = slangpy.Logger.get()
    level, logger.level = logger.level, slangpy.LogLevel.error
    try:
        yield
    finally:
        logger.level = level


@contextmanager
def compiling() -> Iterator[None]:
    """Converts errors of the compiler into a DeviceError with its own message."""
    import slangpy

    try:
        with errors_alone():
            yield
    except (RuntimeError, slangpy.SlangCompileError) as error:
        raise DeviceError(diagnostics(str(error))) from error


def diagnostics(text: str) -> str:
    """The errors of a compilation that lie in files, with file and line; all of the text where there is none."""
    blocks = [block.strip() for block in _START.split(text)]
    errors = [block for block in blocks if not block.startswith(("warning", "note")) and "import failed" not in block]
    placed = [block for block in errors if (found := _PLACE.search(block)) and Path(found[1]).is_file()]
    chosen = dict.fromkeys(re.sub(r"\n-+'?$", "", block) for block in placed)
    return "\n".join(chosen) or text.strip()
