"""Read the native format: any number of files and folders, recognised by their content."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os.path import isfile
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np

from elvis.core.base.arrays import Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import Dataset, Field
from elvis.core.data.mesh import Mesh
from elvis.core.files.plain import leading
from elvis.core.portions.portion import Portion, carriers
from elvis.core.quantities.reference_values import noted_values
from elvis.formats.nektar import expansions, fields_input, hdf5, xml
from elvis.formats.nektar.assembly import RawGeometry, assemble, mesh_of_ids, unite, unknown_members
from elvis.formats.nektar.dataset_parts import DatasetParts
from elvis.formats.nektar.fields_input import time_of
from elvis.formats.nektar.geometry import hdf5 as geometry_hdf5
from elvis.formats.nektar.geometry import xml as geometry_xml
from elvis.formats.nektar.hdf5 import HDF5_SIGNATURE
from elvis.formats.nektar.mapped_files import mapped
from elvis.formats.nektar.remarks import Remark, read_remarks, with_remarks
from elvis.formats.nektar.sections import Section, lacking
from elvis.formats.nektar.session import region_names, session_of
from elvis.formats.nektar.xml import GZIP_SIGNATURE, Element, head, load

_MESH_PIECE = re.compile(r"P\d+\.xml(\.gz)?")
_FIELD_PIECE = re.compile(r"P\d+\.fld")
_ROOT = re.compile(rb"<NEKTAR[\s>/]")
_HDF5_NAME = re.compile(rb"""HDF5FILE\s*=\s*["']([^"'<>]+)["']""")
#: bytes at the beginning of a file that state its kind and name another file
_HEAD = 1 << 20
_PARTITIONS = ("Partition", "MultipleFldFiles")

T = TypeVar("T")

#: function that chooses the fields to read, given the names in a dataset
Choice: TypeAlias = Callable[[Dataset], Collection[str]]


def read(*paths: str | Path) -> Dataset:
    """The dataset in ``paths``: files and folders of a mesh and, where given, of its fields, in any order.

    Meshes: XML with text or compressed sections, gzipped or not, split over several files or partitioned; HDF5 with or
    without its XML.  Fields: XML, HDF5, folders of parallel runs; several field files are united.  The content of a
    file decides its kind, not its name.

    Raises FormatError if a file can't be read or contradicts itself or another, and ElvisError if no mesh is given.
    """
    return _read(paths, lambda reader, names: reader.dataset(names))


def _read(paths: Iterable[str | Path], make: Callable[[_Reader, list[str]], T], reader: _Reader | None = None) -> T:
    """The result of ``make`` for a reader of all files; there must be at least one file."""
    names = [str(path) for path in paths]
    if not names:
        raise ElvisError("expected files to read, found none")
    try:
        reader = reader or _Reader()
        for name in names:
            reader.add(Path(name))
        return make(reader, names)
    except MemoryError as error:
        raise ElvisError(f"{names[0]}: not enough memory to read the data") from error
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", file=error.filename or names[0]) from error


def read_data(paths: Iterable[str | Path], choose: Choice | None = None) -> Dataset:
    """The dataset in these files, read with a progress message on the terminal; ``choose`` as in `with_fields`."""
    return _staged(paths, lambda reader, names: reader.dataset(names), _Reader(choose))


def read_part(number: int, count: int, *paths: str | Path) -> Portion:
    """One of ``count`` parts of the dataset that `read` finds in ``paths``, a range of elements along a curve.

    For HDF5 that is mapped (`elvis.formats.nektar.mapped_files`), memory holds little more than this part at any time.
    For packed XML, it also holds the tables of the mesh.  Raises as `read`; errors in other parts are not always
    detected.
    """
    return read_parts(*paths).part(number, count)


def read_parts(*paths: str | Path, choose: Choice | None = None) -> DatasetParts:
    """`read`, one part after another; ``choose`` as in `with_fields`.  Raises as `read`."""
    return _staged(paths, lambda reader, names: reader.parts(names), _Reader(choose, is_of_parts=True))


def _staged(paths: Iterable[str | Path], make: Callable[[_Reader, list[str]], T], reader: _Reader) -> T:
    """`_read` with a progress message on the terminal."""
    from elvis.core.base.terminal import stage

    files = tuple(map(Path, paths))
    with stage(f"reading {', '.join(file.name for file in files)}"):
        return _read(files, make, reader)


def with_fields(dataset: Dataset, *paths: str | Path, choose: Choice | None = None) -> tuple[Dataset, int]:
    """The dataset with the fields, time and metadata of other field files, and the number of elements the mesh lacks.

    Its mesh is used unchanged and not read again, so the steps of a series share it.  Field data on elements that the
    mesh lacks are dropped; the number of these elements is the second result.  Raises as `read`.

    choose  selects the fields to read, given a dataset whose fields have no blocks yet; others are skipped, and errors
            in them are not detected
    """
    return _reader_of_fields(paths, choose).on_mesh_of(dataset)


class StatesByPart:
    """Field files, state after state, on a mesh in others: one of ``count`` parts of each is read.

    mesh  the files that hold it; it is read once, unless fields of another state have other elements
    """

    def __init__(self, number: int, count: int, *mesh: Path) -> None:
        self._number, self._count, self._files = number, count, mesh
        self._mesh: DatasetParts | None = None  # only the ids of all elements
        self._last: Portion | None = None
        self._carriers: Ints | None = None

    def read(self, *paths: Path, choose: Choice | None = None) -> tuple[Portion, int]:
        """The part of a state, and how many elements of all its fields the mesh lacks; all else as `with_fields`."""
        with mapped():
            state, lacking = self._state(paths, choose)
            carried = carriers(state.whole)
            if self._last is None or not _is_same(carried, self._carriers):
                if state.raw is None:
                    # the pairs of elements whose common sides are inner ones have changed: cut the mesh again
                    self._mesh = None
                    state, _ = self._state(paths, choose)
                found = state.part(self._number, self._count)
            else:
                found = state.on(self._last)
        self._last, self._carriers = replace(found, dataset=replace(found.dataset, fields=())), carried
        return found, lacking

    def lacking(self, *paths: Path, choose: Choice | None = None) -> int:
        """Number of elements of all fields that the mesh lacks; the second result of `read`."""
        with mapped():
            return self._state(paths, choose)[1]

    def _state(self, paths: Sequence[Path], choose: Choice | None) -> tuple[DatasetParts, int]:
        """The fields of a state, on the mesh; this is forgotten as soon as a part is made, but for ids."""
        reader, mesh = _reader_of_fields(paths, choose, is_of_parts=True), self._mesh
        if mesh is None:
            mesh = read_parts(*self._files)
            self._mesh = replace(mesh, raw=None, sections=())
        return reader.on_parts_of(mesh)


def _is_same(one: Ints | None, other: Ints | None) -> bool:
    """Whether two lists of ids hold the same."""
    return one is other or (one is not None and other is not None and np.array_equal(one, other))


def _reader_of_fields(paths: Sequence[str | Path], choose: Choice | None, *, is_of_parts: bool = False) -> _Reader:
    """A reader to which the field files were added; raises FormatError if one can't be read."""
    reader = _Reader(choose, is_of_parts=is_of_parts)
    try:
        for path in paths:
            reader.add(Path(path))
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", file=error.filename or paths[0]) from error
    return reader


def is_native(path: Path) -> bool:
    """Whether a file or folder has the native format, judged by its beginning and its members; never raises."""
    try:
        if path.is_dir():
            return any(_is_piece(entry.name) for entry in path.iterdir())
        start = leading(path, _HEAD)
        if start.startswith(HDF5_SIGNATURE):
            with hdf5.reading(path) as file, hdf5.format_errors():
                return "NEKTAR" in file
        if start.startswith(GZIP_SIGNATURE):
            start = zlib.decompressobj(wbits=31).decompress(start, _HEAD)
        return bool(_ROOT.search(start))
    except (OSError, zlib.error, FormatError):
        return False


def _is_piece(name: str) -> bool:
    """Whether a file of this name is one of a parallel run, or names these."""
    return name == "Info.xml" or bool(_MESH_PIECE.fullmatch(name) or _FIELD_PIECE.fullmatch(name))


def named_files(paths: Iterable[str | Path]) -> list[Path]:
    """The HDF5 files of meshes that XML files among ``paths`` name; for names that several folders hold, each file."""
    found = []
    for path in filter(Path.is_file, map(Path, paths)):
        names = _HDF5_NAME.findall(head(path, _HEAD))
        folders = (path.parent, Path())
        found += [folder / os.fsdecode(name) for name in names for folder in folders]
    return [path for path in found if path.is_file()]


class _Reader:
    """Collects the content of files; fields are decoded immediately, a mesh once it is known which of several applies.

    choose       see `with_fields`: then fields wait until all their names are known
    is_of_parts  whether parts are requested: they wait until a mesh is known, and each part unpacks its own
    """

    def __init__(self, choose: Choice | None = None, *, is_of_parts: bool = False) -> None:
        self._choose, self._is_of_parts = choose, is_of_parts
        self._waiting: list[Element] = []
        self._tags: dict[str, Element] = {}
        self._parameters: dict[str, float] = {}
        self._geometries: dict[str | None, Element] = {}  # pieces by number or file, a whole mesh under None
        self._bare: list[Path] = []
        self._sections: list[Section] = []
        self._mesh_metadata: dict[str, str] = {}
        self._field_metadata: dict[str, str] = {}
        self._is_in_parts = False
        self._remarks: list[Remark] = []

    def add(self, path: Path) -> None:
        """Take in a file or a folder."""
        if path.is_dir():
            self._add_folder(path)
        elif leading(path, len(HDF5_SIGNATURE)) == HDF5_SIGNATURE:
            self._add_hdf5(path)
        else:
            self._add_xml(path)

    def dataset(self, names: list[str]) -> Dataset:
        """The dataset from all files added so far; raises FormatError without a mesh."""
        rules, session = self._take_session()
        mesh, unknown = self._mesh(names)
        metadata = {**self._mesh_metadata, **self._field_metadata}
        bare = Dataset(mesh, (), time_of(metadata), metadata, expansions.resolve(rules, mesh), session)
        bare = replace(bare, reference=self._reference(metadata))
        self._decode(bare)
        remarks = (*unknown, *self._told(mesh, metadata))
        return replace(bare, fields=fields_input.assemble(self._sections, mesh), remarks=remarks)

    def parts(self, names: list[str]) -> DatasetParts:
        """The parts of the dataset from all files added so far; raises FormatError without a mesh."""
        rules, session = self._take_session()
        raw = self._raw_geometry(names)
        metadata = {**self._mesh_metadata, **self._field_metadata}
        whole = Dataset(mesh_of_ids(raw), (), time_of(metadata), metadata, session=session)
        whole = replace(whole, reference=self._reference(metadata))
        self._decode(whole)
        fields = fields_input.without_values(self._sections, whole.mesh)
        whole = replace(whole, fields=fields, remarks=self._told(whole.mesh, metadata))
        return DatasetParts(raw, whole, self._sections, rules, self._remarks)

    def _take_session(self) -> tuple[list[expansions.RawRule], dict[str, str]]:
        """The rules of EXPANSIONS, and the other sections except the mesh.

        Names of regions are added to those from comments.
        """
        conditions = self._tags.get("CONDITIONS")
        self._remarks = [*region_names(conditions), *self._remarks]
        self._parameters = expansions.read_parameters(conditions)
        return expansions.read_rules(self._tags.get("EXPANSIONS"), conditions), session_of(self._tags)

    def _reference(self, metadata: Mapping[str, str]) -> dict[str, float]:
        """Reference values among the session's parameters; field files know better which a run had."""
        found = noted_values({name: repr(float(value)) for name, value in self._parameters.items()})
        return {name: value for name, value in found.items() if name not in noted_values(metadata)}

    def _told(self, mesh: Mesh, metadata: Mapping[str, str]) -> tuple[str, ...]:
        """Remarks about the data: fields on elements that the mesh lacks, errors of an earlier conversion."""
        errors = ConversionErrors.of(metadata)
        lost = (f"the data were converted with {errors.sentence()}",) if errors else ()
        return (*self._left_out(mesh), *lost)

    def _left_out(self, mesh: Mesh) -> tuple[str, ...]:
        """A remark if fields are on elements that the mesh lacks."""
        count = lacking(self._sections, mesh)
        return (f"fields are on {count} elements that are not in the mesh; they are ignored",) if count else ()

    def on_mesh_of(self, dataset: Dataset) -> tuple[Dataset, int]:
        """All fields that were taken in, on the mesh of a dataset; the number of elements that the mesh lacks."""
        found = replace(dataset, time=time_of(self._field_metadata), metadata=self._field_metadata)
        self._decode(found)
        fields = fields_input.assemble(self._sections, dataset.mesh)
        return replace(found, fields=fields), lacking(self._sections, dataset.mesh)

    def on_parts_of(self, parts: DatasetParts) -> tuple[DatasetParts, int]:
        """The dataset that is read by parts, with fields and metadata."""
        mesh, metadata = parts.whole.mesh, self._field_metadata
        whole = replace(parts.whole, time=time_of(metadata), metadata=metadata)
        self._decode(whole)
        whole = replace(whole, fields=fields_input.without_values(self._sections, mesh))
        return replace(parts, whole=whole, sections=self._sections), lacking(self._sections, mesh)

    def _decode(self, dataset: Dataset) -> None:
        """Restrict the data to the chosen fields of a dataset, which has none yet, and decode the waiting sections."""
        own = [section.space.names for section in self._sections]
        own += [fields_input.field_names(element) for element in self._waiting]
        fields = tuple(Field(name, ()) for name in dict.fromkeys(name for names in own for name in names))
        every = {field.name for field in fields}
        wanted = every if self._choose is None else every.intersection(self._choose(replace(dataset, fields=fields)))
        kept = [section.of(wanted) for section in self._sections if wanted.intersection(section.space.names)]
        chosen = [element for element in self._waiting if wanted.intersection(fields_input.field_names(element))]
        late = (fields_input.read_section(each, wanted, stays_packed=self._is_of_parts) for each in chosen)
        self._sections = [*kept, *late]
        self._waiting.clear()

    def _add_folder(self, folder: Path) -> None:
        names = sorted(entry.name for entry in folder.iterdir())
        mesh_pieces = [name for name in names if _MESH_PIECE.fullmatch(name)]
        field_pieces = [name for name in names if _FIELD_PIECE.fullmatch(name)]
        if not mesh_pieces and not field_pieces and "Info.xml" not in names:
            raise FormatError("expected P0000000.xml, or Info.xml and P0000000.fld, found neither", file=folder)
        _check_numbers(folder, mesh_pieces)
        for name in mesh_pieces:
            self._add_xml(folder / name, is_mesh_piece=True)
        if "Info.xml" in names:
            self._add_xml(folder / "Info.xml")
        else:
            for name in field_pieces:
                self.add(folder / name)

    def _add_hdf5(self, path: Path) -> None:
        with hdf5.reading(path) as file, hdf5.format_errors():
            if "NEKTAR" not in file:
                raise FormatError(f"expected a group NEKTAR, found none; {xml.OTHERS}", file=path)
            is_geometry = geometry_hdf5.is_geometry(file)
        if is_geometry:
            self._bare.append(path)
            return
        sections, metadata = fields_input.read_hdf5(path)
        self._sections += sections
        self._field_metadata.update(metadata)

    def _add_xml(self, path: Path, is_mesh_piece: bool = False) -> None:
        data = load(path)
        self._remarks += read_remarks(data)
        for root in xml.parse(data, str(path)):
            xml.check_root(root, str(path))
            metadata: dict[str, str] = {}
            parts: list[str] = []
            is_field = False
            for child in root.children():
                is_field |= child.tag in ("ELEMENTS", *_PARTITIONS)
                if child.tag == "ELEMENTS" and (self._is_of_parts or self._choose is not None):
                    self._waiting.append(child)
                elif child.tag == "ELEMENTS":
                    self._sections.append(fields_input.read_section(child))
                elif child.tag == "Metadata":
                    metadata.update(fields_input.read_metadata(child))
                elif child.tag in _PARTITIONS:
                    parts.append(_file_name(child))
                else:
                    self._merge(child, is_mesh_piece)
            self._add_parts(path, parts)
            (self._field_metadata if is_field else self._mesh_metadata).update(metadata)

    def _add_parts(self, info: Path, names: list[str]) -> None:
        """The pieces of the fields of a parallel run, which its Info.xml names; their own metadata don't count."""
        for name in dict.fromkeys(names):
            if info.name == name or self._is_in_parts:
                raise FormatError(f"expected the name of a piece, found {name}, which names others", file=info)
            kept, self._is_in_parts = dict(self._field_metadata), True
            self.add(info.parent / name)
            self._field_metadata, self._is_in_parts = kept, False

    def _merge(self, child: Element, is_piece: bool) -> None:
        """A section of the session: it replaces an earlier one, unless it is empty; pieces of a mesh are collected."""
        if child.tag != "GEOMETRY":
            if child.tag not in self._tags or not child.is_empty:
                self._tags[child.tag] = child
            return
        if child.is_empty and "HDF5FILE" not in child.attributes and self._geometries:
            return
        piece = child.attributes.get("PARTITION", child.file if is_piece else None)
        if piece is None or None in self._geometries:
            self._geometries.clear()
        self._geometries[piece] = child

    def _mesh(self, names: list[str]) -> tuple[Mesh, list[str]]:
        """The mesh, and sentences on what its composites name in vain."""
        raw = self._raw_geometry(names)
        mesh = assemble(raw)
        return with_remarks(mesh, self._remarks), unknown_members(raw, mesh)

    def _raw_geometry(self, names: list[str]) -> RawGeometry:
        """The mesh as files hold it; nothing else holds it then."""
        pieces = list(self._raw_geometries())
        if not pieces:
            raise FormatError(
                f"no geometry among {', '.join(names)}{self._describe_content()}; {_advice(Path(names[0]))}"
            )
        self._geometries.clear()
        self._tags.clear()
        return unite(pieces)

    def _describe_content(self) -> str:
        """The content that was found instead of a mesh."""
        kinds = [("fields", bool(self._sections)), ("conditions", "CONDITIONS" in self._tags)]
        held = [name for name, is_held in kinds if is_held]
        return f", where only {' and '.join(held)} are" if held else ""

    def _raw_geometries(self) -> Iterator[RawGeometry]:
        if not self._geometries and len(self._bare) > 1:
            raise FormatError(f"expected one mesh, found {self._bare[0]} and {self._bare[1]}")
        if not self._geometries:
            yield from (geometry_hdf5.read_geometry(path) for path in self._bare)
        for element in self._geometries.values():
            if "HDF5FILE" in element.attributes:
                yield geometry_hdf5.read_geometry(self._hdf5_file(element), *geometry_xml.dimensions(element))
            else:
                yield geometry_xml.read_geometry(element)

    def _hdf5_file(self, element: Element) -> Path:
        """The HDF5 file that a mesh names: next to the XML, in the working folder, or among the files given."""
        name = element.attributes["HDF5FILE"]
        given = [path for path in self._bare if path.name == Path(name).name] or self._bare
        for path in (Path(element.file).parent / name, Path(name), *given):
            if isfile(path):  # also where the name is longer than names can be
                return path
        raise element.error(f"expected the file {name} next to it or in the working folder, found none")


def _check_numbers(folder: Path, pieces: Iterable[str]) -> None:
    """Raise FormatError if pieces of a mesh, one per process from 0, are missing, and with them their elements."""
    numbers = {int(re.sub(r"\D", "", name.partition(".")[0])) for name in pieces}
    missing = min(set(range(len(numbers))) - numbers, default=None)
    if missing is not None:
        name = f"P{missing:07}.xml"
        raise FormatError(f"expected the pieces of a mesh from P0000000.xml on, found none named {name}", file=folder)


def _advice(path: Path) -> str:
    """Advice for data whose mesh is missing; it names a mesh file of the same name in the same folder."""
    with suppress(OSError):
        for other in sorted(path.parent.glob("*.xml*")):
            stem = other.name.partition(".xml")[0]
            if path.name.startswith(stem) and not other.samefile(path) and is_native(other):
                return f"also give the mesh file, perhaps {other}"
    return "also give the mesh file"


def _file_name(entry: Element) -> str:
    """The name of a piece of a parallel run; raises FormatError if it leads out of the folder."""
    name = entry.require("FileName")
    if name in (".", "..") or Path(name).name != name:
        raise entry.error(f"expected the name of a file in the same folder, found {name!r}")
    return name
