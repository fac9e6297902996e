"""Files of lines: tables, archives, and what ParaView opens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError

if TYPE_CHECKING:
    from elvis.core.streamlines.lines.point_lines import PointLines


def check_suffix(output: Path) -> None:
    """ElvisError where the suffix names no format that is written."""
    if output.suffix.lower() not in (".csv", ".npz", ".vtp"):
        found = output.suffix or "no suffix"
        raise ElvisError(f"{output}: expected a name that ends in .csv, .npz or .vtp, found {found}")


def write_lines(output: Path, found: PointLines, of_lines: Mapping[str, Any]) -> None:
    """Write lines, with the facts of each, in the format of the suffix."""
    from elvis.core.files.columns import write_columns
    from elvis.core.files.polydata import write_polylines

    suffix = output.suffix.lower()
    if suffix == ".vtp":
        write_polylines(output, found.points, found.offsets, found.at_points(), of_lines)
    else:
        write_columns(output, found.arrays() if suffix == ".npz" else found.columns())
