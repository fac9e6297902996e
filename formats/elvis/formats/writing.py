"""Writing the native format: mesh and fields, as XML or HDF5, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.files.output import Outputs, check_places
from elvis.formats.nektar import fields_output
from elvis.formats.nektar.composites import with_domain
from elvis.formats.nektar.expansions import completed_rules, write_rules
from elvis.formats.nektar.fields_input import time_of
from elvis.formats.nektar.fields_output import OutputSection, output_sections
from elvis.formats.nektar.geometry import hdf5 as geometry_hdf5
from elvis.formats.nektar.geometry import output as geometry_output
from elvis.formats.nektar.session import write_session
from elvis.formats.nektar.xml import document, write_metadata

MeshFormat = Literal["compressed", "text", "hdf5"]
FieldFormat = Literal["xml", "hdf5"]


def write(
    dataset: Dataset,
    mesh_path: str | Path | None = None,
    field_path: str | Path | None = None,
    *,
    mesh_format: MeshFormat = "compressed",
    field_format: FieldFormat = "xml",
    outputs: Outputs | None = None,
) -> tuple[Path, ...]:
    """Write a dataset; return the written files.  Either all files are written completely, or none is touched.

    mesh_path   XML file of the mesh; with ``hdf5``, the data go to a file of the same name with the suffix .nekg.  XML
                is gzipped if the name ends in .gz.  Without it, only the fields are written.
    field_path  file of the fields; if only ``mesh_path`` is given, the same name with the suffix .fld.
    outputs     commits these files together with others, if given

    The mesh gets a domain if it names none, and expansions that fit every field.  Raises ElvisError if a file can't be
    written, or if a format can't represent the dataset.
    """
    mesh_file = None if mesh_path is None else Path(mesh_path)
    field_file = _field_file(dataset, mesh_file, field_path)
    hdf5_file = _hdf5_file(mesh_file) if mesh_file and mesh_format == "hdf5" else None
    _check(mesh_format, field_format, mesh_file, field_file)
    written = tuple(file for file in (mesh_file, hdf5_file, field_file) if file)
    check_places(written)

    # the coordinates before a deformation are known from the mesh
    before = () if dataset.deformation is None else dataset.deformation.coordinates
    fields = tuple(own for own in dataset.fields if own.name not in before)
    dataset = replace(dataset, mesh=with_domain(dataset.mesh), fields=fields, metadata=_metadata(dataset))
    sections = output_sections(dataset)
    if field_file and not sections:
        raise ElvisError(f"{field_file}: expected fields on elements of the domain, found none")
    with nullcontext(outputs) if outputs else Outputs() as files:
        # they take their names in this order, so the mesh's XML, which names the others, comes last
        if field_file:
            with files.file(field_file) as temporary:
                _write_fields(temporary, sections, dataset.metadata, field_file, field_format)
        if hdf5_file:
            with files.file(hdf5_file) as temporary:
                geometry_hdf5.write_geometry(temporary, dataset.mesh)
        if mesh_file:
            with files.file(mesh_file) as temporary:
                _write_mesh_xml(temporary, dataset, sections, mesh_file, mesh_format, field_file is None)
    return written


def companions(mesh_path: Path) -> tuple[Path, Path]:
    """The files that may stand next to a mesh's XML under its name: of the fields, and of the mesh's data in HDF5."""
    plain = _without_gz(mesh_path)
    return plain.with_suffix(".fld"), plain.with_suffix(".nekg")


def _check(mesh_format: str, field_format: str, mesh_file: Path | None, field_file: Path | None) -> None:
    if mesh_format not in get_args(MeshFormat) or field_format not in get_args(FieldFormat):
        known = f"{', '.join(get_args(MeshFormat))} for meshes and {', '.join(get_args(FieldFormat))} for fields"
        raise ElvisError(f"expected one of the formats {known}, found {mesh_format} and {field_format}")
    if mesh_file is None and field_file is None:
        raise ElvisError("expected the name of a file to write, found none")
    if mesh_file == field_file:
        raise ElvisError(f"{mesh_file}: expected two names for mesh and fields, found one")
    if mesh_format == "hdf5" and mesh_file:
        _check_text(mesh_file)
    if field_format == "hdf5" and field_file and field_file.suffix == ".gz":
        raise ElvisError(f"{field_file}: expected a name without .gz, for HDF5 packs its data itself")


def _check_text(path: Path) -> None:
    """Raise ElvisError if the name of a file is not text, so that the XML can't name the one next to it."""
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        raise ElvisError(
            f"{path}: expected a name that is UTF-8, for the XML names the HDF5 file next to it"
        ) from error


def _field_file(dataset: Dataset, mesh_file: Path | None, field_path: str | Path | None) -> Path | None:
    """The file of the fields, None if there are none to write."""
    if field_path is not None:
        if not dataset.fields:
            raise ElvisError(f"{field_path}: expected fields to write, found none")
        return Path(field_path)
    return companions(mesh_file)[0] if mesh_file and dataset.fields else None


def _hdf5_file(mesh_file: Path) -> Path:
    """The file of the mesh's data next to its XML."""
    if mesh_file.suffix == ".nekg":
        raise ElvisError(f"{mesh_file}: expected the name of the XML file, which names the .nekg file next to it")
    return companions(mesh_file)[1]


def _without_gz(path: Path) -> Path:
    return path.with_suffix("") if path.suffix == ".gz" else path


def _metadata(dataset: Dataset) -> dict[str, str]:
    """The metadata with the dataset's time."""
    metadata = dict(dataset.metadata)
    if dataset.time is not None and time_of(metadata) != dataset.time:
        metadata["Time"] = repr(float(dataset.time))
    return metadata


def _write_mesh_xml(
    path: Path, dataset: Dataset, sections: list[OutputSection], name: Path, mesh_format: MeshFormat, is_alone: bool
) -> None:
    """The XML of the mesh, or the stub that names its HDF5 file; metadata only where no field file holds them."""
    mesh = dataset.mesh
    with document(path, name.suffix == ".gz") as writer:
        if is_alone:
            write_metadata(writer, dataset.metadata)
        if mesh_format == "hdf5":
            attributes = {"DIM": mesh.dimension, "SPACE": mesh.space, "HDF5FILE": _hdf5_file(name).name}
            writer.leaf("GEOMETRY", attributes)
        else:
            geometry_output.write_geometry(writer, mesh, mesh_format == "compressed")
        rules = completed_rules(dataset, sections)
        write_rules(writer, rules)
        write_session(writer, dataset.session, dict.fromkeys(name for rule in rules for name in rule.fields))


def _write_fields(
    path: Path, sections: list[OutputSection], metadata: Mapping[str, str], name: Path, field_format: FieldFormat
) -> None:
    if field_format == "hdf5":
        fields_output.write_hdf5(path, sections, metadata)
        return
    with document(path, name.suffix == ".gz") as writer:
        write_metadata(writer, metadata)
        fields_output.write_sections(writer, sections)
