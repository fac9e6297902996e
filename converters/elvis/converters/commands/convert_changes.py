"""Changes that ``elvis convert`` makes to all data before it writes them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from elvis.core.base.errors import ElvisError

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.plugins.conversion.report import Report


def in_other_waves(
    dataset: Dataset,
    plane: int | None,
    mean_mode: bool,
    zero_plane: int | None,
    stretch: int | None,
    full: bool,
    sine: str | None,
) -> Dataset:
    """The data with a changed Fourier direction, or one of its planes."""
    if sine is not None and not full:
        raise ElvisError("--sine: expected with --full")
    if plane is None and zero_plane is None and stretch is None and not (full or mean_mode):
        return dataset
    from elvis.plugins.fourier.planes import fourier_coefficients, fourier_mean, in_full_waves, without_plane

    if mean_mode and plane is not None:
        raise ElvisError("expected one of --plane and --mean-mode, found both")
    if zero_plane is not None:
        dataset = without_plane(dataset, zero_plane)
    if full or stretch is not None:
        names = [] if sine is None else [name.strip() for name in sine.split(",")]
        dataset = in_full_waves(dataset, stretch or 1, names)
    if mean_mode:
        return fourier_mean(dataset, "xyz"[min(dataset.mesh.dimension, 2)], "--mean-mode")
    return dataset if plane is None else fourier_coefficients(dataset, plane)


def extruded(dataset: Dataset, slabs: int, order: int | None, files: tuple[Path, ...]) -> tuple[Dataset, Report]:
    """The data in slabs of volume elements, and the errors of these."""
    from elvis.core.base.terminal import stage
    from elvis.plugins.fourier.slabs import in_slabs

    with stage("writing waves as polynomials"):
        found = in_slabs(dataset, slabs, order)
    return found.dataset, replace(found.report, files=tuple(file.name for file in files))


def with_stream_function(dataset: Dataset, report: Report) -> tuple[Dataset, Report]:
    """The data with the stream function, and the distance of its velocity from the flow's."""
    from elvis.core.base.terminal import stage
    from elvis.core.resolution.stream_functions import with_stream_function

    with stage("computing the stream function"):
        found = with_stream_function(dataset)
    return found, replace(report, notes=(*report.notes, found.remarks[-1]))


def made_continuous(dataset: Dataset, report: Report, length: float) -> tuple[Dataset, Report]:
    """The data with continuous fields, and the change of each as its error."""
    from elvis.core.base.terminal import stage
    from elvis.plugins.transfers.continuous_fields import continuous_fields

    with stage("making fields continuous"):
        found = continuous_fields(dataset, length)
    made = "continuous and smoothed" if length else "continuous"
    sentence = f"fields are {made}; their errors are the changes that this made, measured at points"
    return found.dataset, replace(report, fields=found.measures, notes=(*report.notes, sentence))
