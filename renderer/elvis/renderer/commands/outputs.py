"""Checks of the files that commands write."""

from __future__ import annotations

from pathlib import Path

from elvis.core.base.errors import ElvisError


def check_outputs(
    output: Path | None, plot: Path | None, read: list[Path], overwrite: bool, is_grid: bool = False
) -> None:
    """ElvisError where the files can't be written, before any long work."""
    from elvis.core.files.columns import check_suffix
    from elvis.core.files.output import check_places

    if output is not None and not is_grid:
        check_suffix(output)
    elif output is not None and output.suffix.lower() != ".nrrd":
        raise ElvisError(f"{output}: expected a name that ends in .nrrd for a grid, found {output.suffix or 'none'}")
    if plot is not None:
        from elvis.scene.figure.time_plot import check_plot

        check_plot(plot)
    check_places([path for path in (output, plot) if path is not None], read, overwrite)
