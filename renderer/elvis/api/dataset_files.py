"""Files of datasets, by the suffix of their name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.formats.writing import write as write_native
from elvis.plugins.command.registry import plugins
from elvis.plugins.conversion.exporting import GROUP, exporter
from elvis.plugins.fourier.planes import has_waves
from elvis.plugins.fourier.slabs import in_slabs

#: suffixes of files that are no datasets, and what writes such files
_OTHER_FILES = {
    **dict.fromkeys(
        (".png", ".jpg", ".svg", ".pdf", ".exr", ".html", ".webp", ".gif", ".mp4"),
        "dataset.plot().save(name) writes pictures",
    ),
    **dict.fromkeys((".stl", ".ply", ".obj", ".glb", ".vtp"), "elvis extract writes surfaces"),
    **dict.fromkeys((".csv", ".npz"), "elvis probe writes tables"),
}


def write(
    dataset: Dataset, path: str | Path | None = None, field_path: str | Path | None = None, **options: Any
) -> tuple[Path, ...]:
    """Write a dataset; returns the files written.  Either all files are written completely, or none is changed.

    path        ``.fld`` for only the fields; ``.vtu``, ``.msh``, ``.dat`` and ``.plt`` for VTK's, Gmsh's or Tecplot's
                cells; ``.csv`` and ``.pts`` for points; any other name is the XML file of the mesh, next to which the
                fields go under the suffix ``.fld``
    field_path  another name for the file of the fields; without ``path`` only these are written
    options     ``mesh_format``, "compressed", "text" or "hdf5"; ``field_format``, "xml" or "hdf5"; ``order`` of the
                cells of other programs, by default the lowest that contains map and fields

    Raises ElvisError if a file can't be written, or a format can't represent the dataset, and for suffixes of pictures,
    surfaces and tables.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.write(ds, "copy.xml")
    (PosixPath('copy.xml'), PosixPath('copy.fld'))
    """
    suffix = "" if path is None else Path(path).suffix
    if suffix[1:] in plugins(GROUP):
        return _export(dataset, Path(str(path)), field_path, **options)
    if suffix.lower() in _OTHER_FILES:
        known = ", ".join(f".{name}" for name in sorted(plugins(GROUP)))
        raise ElvisError(f"{path}: expected a name that ends in .xml, .fld, {known}; {_OTHER_FILES[suffix.lower()]}")
    if suffix == ".fld" and field_path is None:
        return write_native(dataset, field_path=path, **options)
    return write_native(dataset, path, field_path, **options)


def _export(dataset: Dataset, path: Path, field_path: object, order: int | None = None, **rest: object) -> tuple[Path]:
    """Write the cells of another program."""
    if field_path is not None or rest:
        raise ElvisError(f"{path}: expected no other file and no format, found {', '.join(rest) or field_path}")
    if has_waves(dataset):
        dataset = in_slabs(dataset).dataset
    exporter(path.suffix[1:])(dataset, None, order, path, lambda losses: None)
    return (path,)
