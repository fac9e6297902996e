"""Fields with a Fourier direction on another plane mesh: each plane of coefficients is projected like a field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field, Homogeneous
from elvis.core.mapping.patch import patches
from elvis.plugins.conversion.report import Measure
from elvis.plugins.data.added_quantities import with_errors
from elvis.plugins.fourier.planes import fourier_coefficients, has_waves, only_waves, stacked_planes
from elvis.plugins.fourier.quantities import joined_measure
from elvis.plugins.fourier.slabs import in_slabs
from elvis.plugins.transfers.onto_mesh import Integral, Transfer, onto_mesh


def onto_any_mesh(
    source: Dataset, target: Dataset, order: int | None, outside: str, fields: Sequence[str] | None = None
) -> Transfer:
    """The fields on another mesh as by `onto_mesh`, also with a Fourier direction.

    On a plane mesh the waves stay; on a mesh of volume elements the data are cut into slabs first (`in_slabs`).
    ``outside`` is then one of ``error``, ``nan``, ``nearest`` and 0.
    """
    if not has_waves(source):
        return onto_mesh(source, target, order, outside, fields)
    if target.mesh.dimension == source.mesh.dimension + 1:
        return _by_slabs(source, target, order, outside, fields)
    if outside not in ("error", "nan", "nearest", "0"):
        raise ElvisError(f"--outside: expected error, nan, nearest or 0 for Fourier data, found {outside}")
    return _by_planes(source, target, order, outside, fields)


def _by_slabs(
    source: Dataset, target: Dataset, order: int | None, outside: str, fields: Sequence[str] | None
) -> Transfer:
    """The projection of slabs; its errors include the errors of the slabs."""
    slabs = in_slabs(source)
    found = onto_mesh(slabs.dataset, target, order, outside, fields)
    before = {own.name: own for own in slabs.report.fields}
    measures = tuple(
        replace(
            own,
            max=own.max + before[own.name].max,
            l2=own.l2 + before[own.name].l2,
            is_exact=own.is_exact and before[own.name].is_exact,
        )
        for own in found.measures
    )
    metadata = with_errors(replace(found.dataset, metadata=target.metadata), measures)
    return replace(found, dataset=replace(found.dataset, metadata=metadata), measures=measures)


def _by_planes(
    source: Dataset, target: Dataset, order: int | None, outside: str, fields: Sequence[str] | None
) -> Transfer:
    """The projection of all planes of all fields, as fields of one projection."""
    names = [own.name for own in source.solution if fields is None or own.name in fields]
    waves = only_waves(patches(source, names), "--onto")
    planes = [fourier_coefficients(source, number) for number in waves.z_ids]
    parts = [replace(own.field(name), name=f"{name} {k}") for name in names for k, own in enumerate(planes)]
    found = onto_mesh(replace(planes[0], fields=(*planes[0].map_fields, *parts)), target, order, outside)

    solution = [_joined_planes(found, name, waves) for name in names]
    measures = tuple(_joined_errors(found, name) for name in names)
    held = tuple(own for own in target.fields if own.name in target.map_names)
    bare = replace(found.dataset, fields=(*held, *solution), metadata=target.metadata, time=source.time)
    dataset = replace(bare, metadata=with_errors(bare, measures))
    # only the first plane has a mean
    means = {own.name.rpartition(" ")[0]: own for own in found.integrals if own.name.endswith(" 0")}
    length = waves.lengths[0]
    integrals = tuple(Integral(name, length * own.before, length * own.after) for name, own in means.items())
    return replace(found, dataset=dataset, measures=measures, integrals=integrals)


def _joined_planes(found: Transfer, name: str, waves: Homogeneous) -> Field:
    """The field that consists of projected planes."""
    planes = [found.dataset.field(f"{name} {k}") for k in range(len(waves.z_ids))]
    return Field(name, stacked_planes([own.blocks for own in planes], waves), False)


def _joined_errors(found: Transfer, name: str) -> Measure:
    """The error of a field from the errors of its planes."""
    errors = [own for own in found.measures if own.name.rpartition(" ")[0] == name]
    most = sum(own.magnitude for own in errors)
    return joined_measure(name, errors, 0.0, (-most, most))
