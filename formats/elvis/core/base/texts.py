"""Limits of texts that come from outside: files, scenes, pages, live objects."""

from __future__ import annotations

from elvis.core.base.errors import FormatError

#: characters of a name: of fields, boundaries, regions
LONGEST_NAME = 1_000
#: characters of any other text of a scene: titles, expressions, names of files
LONGEST_TEXT = 10_000


def check_name(name: str, what: str) -> None:
    """Raise FormatError for a name of more than `LONGEST_NAME` characters; ``what`` has it, such as ``"a field"``."""
    if len(name) > LONGEST_NAME:
        start = name[:20]
        raise FormatError(
            f"expected a name of at most {LONGEST_NAME} characters for {what}, found {len(name)}: {start!r}…"
        )
