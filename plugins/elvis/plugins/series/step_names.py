"""Files of a series by their names: ``flow-0.10.vtu`` and ``flow-0.20.vtu`` differ in one number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from elvis.core.base.errors import ElvisError

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
#: marks of patterns of names
MARKS = re.compile(r"(\*|\?|\[[^\]]+\])")


def expanded(paths: Sequence[Path]) -> tuple[Path, ...]:
    """The files; names with *, ? or [0-3] are expanded in the order of their numbers.

    Raises ElvisError if none matches, and for empty folders.
    """
    found: list[Path] = []
    for path in paths:
        if path.is_dir() and not any(path.iterdir()):
            raise ElvisError(f"{path}: expected files in this folder, found none")
        if not MARKS.search(path.name) or path.exists():
            found.append(path)
            continue
        matching = sorted(path.parent.glob(path.name), key=lambda each: numbers_of(each.name))
        if not matching:
            raise ElvisError(f"{path}: expected files of such names, found none")
        found += matching
    return tuple(found)


def pattern_of(path: Path) -> tuple[Path, str]:
    """The folder and the name, with # for each number in it."""
    return path.parent, _NUMBER.sub("#", path.name)


def numbers_of(name: str) -> tuple[float, ...]:
    """The numbers in a name."""
    return tuple(map(float, _NUMBER.findall(name)))


def numbered(paths: Sequence[Path]) -> dict[float, Path]:
    """Files of one pattern by the last number in which they differ, ascending; none if no single number does."""
    found = [numbers_of(path.name) for path in paths]
    differing = [i for i, column in enumerate(zip(*found, strict=False)) if len(set(column)) > 1]
    if not differing:
        return {}
    by_number = {numbers[differing[-1]]: path for numbers, path in zip(found, paths, strict=True)}
    return dict(sorted(by_number.items())) if len(by_number) == len(paths) else {}


def groups(paths: Sequence[Path]) -> list[list[Path]]:
    """The files by pattern, in the order of the first of each."""
    found: dict[tuple[Path, str], list[Path]] = {}
    for path in paths:
        found.setdefault(pattern_of(path), []).append(path)
    return list(found.values())
