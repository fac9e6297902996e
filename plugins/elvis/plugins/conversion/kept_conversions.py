"""Conversions in memory, cached until the files, the options or the code that made them change.

The cache contains the native files that `elvis convert --format hdf5` would write, which are read and written faster
than packed ones, and results always come from these files: so a picture is the same whether the data were converted
now, earlier, or by hand.  Long files are separate files of the cache, which are mapped without a copy.

The first conversion for certain quantities only has their fields.  If other fields are requested afterwards, all are
converted.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from hashlib import file_digest, sha256
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

from elvis.core.base.errors import ElvisError
from elvis.core.base.memory import release_free_memory, settle_free_memory
from elvis.core.base.ranks import Ranks, agreed
from elvis.core.data.dataset import Dataset, Field
from elvis.core.files.keeping import Store, cache_folder
from elvis.core.portions import Portion
from elvis.formats.nektar.geometry.output import place
from elvis.formats.nektar.hdf5_heaps import own_files
from elvis.formats.nektar.mapped_files import mapped
from elvis.formats.reading import read, read_part
from elvis.formats.writing import write
from elvis.plugins.conversion.converting import Conversion, Settings, convert
from elvis.plugins.conversion.plugin import Converter

#: maximum size of cached conversions in bytes: the least recently used ones are removed
MOST_BYTES = 2 << 30
#: packages that every conversion goes through
_PACKAGES = ("elvis.core", "elvis.formats", "elvis.plugins")
#: bytes of a file that are read at once
_PART = 1 << 20
#: the native files by the name under which they are stored
_MESH, _LENGTH = "converted.xml", 8
#: what distinguishes the key of a conversion of some fields
_SOME_FIELDS = b"some fields"
#: bytes of files from which on they are mapped
_MAPPED = 1 << 26


@dataclass(frozen=True)
class Work:
    """Inputs of a conversion: a converter, its files, the keywords of its constructor, and names of fields.

    fields  to convert, None for all
    choose  gives the names of those fields of a dataset that are requested, None for all
    """

    name: str
    converter: type[Converter]
    paths: tuple[Path, ...]
    keywords: Mapping[str, Any]
    fields: tuple[str, ...] | None = None
    choose: Callable[[Dataset], Collection[str]] | None = None


@dataclass(frozen=True)
class _Result:
    """A conversion in the cache.

    files   native files
    keys    of the metadata, in their order
    further_files  digests of further files that were read, by paths relative to the folder of the first given file
    remarks  on the errors, and on skipped contents
    names   of all fields that could be converted, in the source's order
    is_whole  whether all of these were
    """

    files: Sequence[Path]
    keys: Sequence[str]
    further_files: Mapping[str, str]
    remarks: Sequence[str]
    names: Sequence[str]
    is_whole: bool

    @property
    def size(self) -> int:
        """Bytes of the files."""
        return sum(path.stat().st_size for path in self.files)

    def keep(self, store: Store, key: bytes) -> None:
        """Store all of it: the length of a head, the head, which is JSON, and the short files one after another.

        Each long file becomes a separate file of the cache.  Raises OSError if something can't be written.
        """
        sizes = {path: path.stat().st_size for path in self.files}
        short = [path for path in self.files if sizes[path] <= _MAPPED]
        about = {
            "files": {path.name: sizes[path] for path in short},
            "beside": {path.name: store.write_beside(key, path) for path in self.files if path not in short},
            "keys": list(self.keys),
            "further_files": dict(self.further_files),
            "remarks": list(self.remarks),
            "names": list(self.names),
            "is_whole": self.is_whole,
        }
        head = json.dumps(about).encode()
        store.write(key, len(head).to_bytes(_LENGTH, "little"), head, *short)

    def dataset(self) -> Dataset:
        """The dataset in the files; large files are mapped, so that only the parts in use take memory."""
        # they have just been written, or their checksums were right
        with own_files(), mapped(if_so=os.name == "posix" and self.size > _MAPPED):
            return replace(_ordered(read(*self.files), self.keys), remarks=tuple(self.remarks))


@dataclass(frozen=True)
class _Head:
    """The header of a conversion in the cache; its short files follow.

    sizes   bytes of the short files by name
    beside  checksums of the long files by name; all else as in `_Result`
    """

    sizes: Mapping[str, int]
    beside: Mapping[str, str]
    keys: Sequence[str]
    further_files: Mapping[str, str]
    remarks: Sequence[str]
    names: Sequence[str]
    is_whole: bool

    @classmethod
    def read(cls, file: BinaryIO) -> _Head:
        """The head of packed content, and the file at the first of its files."""
        head = json.loads(file.read(int.from_bytes(file.read(_LENGTH), "little")))
        listed = (head[name] for name in ("keys", "further_files", "remarks", "names", "is_whole"))
        return cls(head["files"], head["beside"], *listed)

    def unpacked(self, file: BinaryIO, folder: Path, long: Mapping[str, Path]) -> _Result:
        """The result with its short files in a folder, and with links there to the long ones."""
        paths = []
        for name, size in self.sizes.items():
            path = folder / Path(name).name
            with path.open("wb") as copy:
                for first in range(0, size, _PART):
                    copy.write(file.read(min(_PART, size - first)))
            paths.append(path)
        for name, target in long.items():
            path = folder / Path(name).name
            try:
                path.symlink_to(target)
            except OSError:
                # not every system allows links
                copyfile(target, path)
            paths.append(path)
        return _Result(paths, self.keys, self.further_files, self.remarks, self.names, self.is_whole)


def load_or_convert(work: Work, is_kept: bool = True) -> Dataset:
    """The dataset of a conversion, from the cache if it is there, else converted and cached.

    is_kept  False disables the cache

    The remarks of the dataset report its errors, and faults of the cache, which never stop the work.
    """
    folder = cache_folder("conversions") if is_kept else None
    if folder is None:
        return _convert(work)
    store, remarks = Store(folder, "conversion", MOST_BYTES), list[str]()
    before = _digests(work.paths)
    key = None if before is None else _key(work, before)
    # of conversions of all fields, and of some
    keys = () if key is None else (key, sha256(key + _SOME_FIELDS).digest())
    found = _find_any(store, keys, work, remarks)
    if found is not None:
        return replace(found, remarks=(*found.remarks, *remarks))
    if any(store.place(each).exists() for each in keys):
        work = replace(work, choose=None)

    def keep(result: _Result) -> None:
        if not keys or _digests(work.paths) != before:
            return
        whole, partial = keys
        _keep(store, whole if result.is_whole else partial, result, remarks)
        if result.is_whole:
            store.remove(partial)

    dataset = _convert(work, keep)
    return replace(dataset, remarks=(*dataset.remarks, *remarks))


def part_of_conversion(work: Work, is_kept: bool, ranks: Ranks) -> Portion:
    """A rank's part of a conversion, which the first rank makes or finds, and all read.

    If its native files don't reach all ranks, or can't represent the data, each converts.
    """
    task = f"converting {', '.join(str(path) for path in work.paths)}"
    with TemporaryDirectory(prefix="elvis-") as folder:
        # what the first one can't convert is the same for all of them
        own = agreed(ranks, lambda: None if ranks.rank else _written(work, is_kept, Path(folder)), task)
        made, *_ = ranks.exchange(own, task)
        if not all(ranks.exchange(made is not None and all(path.exists() for path in made.paths), task)):
            return Portion.of_whole(load_or_convert(work, is_kept), ranks.rank, ranks.size)
        assert made is not None
        with mapped():
            # when all have read their parts the files may go
            portion = agreed(ranks, lambda: read_part(ranks.rank, ranks.size, *made.paths), task)
    dataset = replace(_ordered(portion.dataset, made.keys), remarks=made.remarks)
    rows = {kind: portion.rows[kind] for kind in (*dataset.mesh.entities, None)}
    return replace(portion, dataset=dataset, rows=rows)


@dataclass(frozen=True)
class _Written:
    """Native files of a dataset, the keys of its metadata in their order, and its remarks."""

    paths: tuple[Path, ...]
    keys: tuple[str, ...]
    remarks: tuple[str, ...]


def _written(work: Work, is_kept: bool, folder: Path) -> _Written | None:
    """A conversion as files in a folder; None without room for them, or the format can't represent the data."""
    dataset = load_or_convert(work, is_kept)
    try:
        paths = _write(dataset, folder / _MESH)
    except (OSError, ElvisError):
        return None
    return _Written(paths, tuple(dataset.metadata), dataset.remarks)


def _find_any(store: Store, keys: Sequence[bytes], work: Work, remarks: list[str]) -> Dataset | None:
    """The first cached dataset of several keys that `_find` finds."""
    for key in keys:
        dataset = _find(store, key, work, remarks)
        if dataset is not None:
            return dataset
    return None


def _find(store: Store, key: bytes, work: Work, remarks: list[str]) -> Dataset | None:
    """The cached dataset, if it is valid, none of its inputs has changed, and it has the requested fields."""
    path, dataset = store.place(key), None
    try:
        with store.opened(path) as entry:
            dataset = _unpacked(entry[1], store, key, work) if entry and entry[0] == key else None
    except _DamagedError:
        entry = None
    except OSError:
        return None
    if entry is None:
        remarks.append(
            f"a cached conversion in {store.folder} is damaged: it was moved aside, and the conversion repeated"
        )
    elif dataset is not None:
        store.note_use(path)
    return dataset


class _DamagedError(Exception):
    """A file of a cached conversion isn't as it was written."""


def _unpacked(file: BinaryIO, store: Store, key: bytes, work: Work) -> Dataset | None:
    """The dataset in the packed content of a file; None if further files have changed, or it lacks requested fields."""
    head = _Head.read(file)
    source = work.paths[0].parent
    if _digests([source / name for name in head.further_files]) != list(head.further_files.values()):
        return None
    long = {}
    for name, checksum in head.beside.items():
        found = store.found_beside(key, name, checksum)
        if found is None:
            raise _DamagedError
        long[name] = found
    with TemporaryDirectory(prefix="elvis-") as folder:
        dataset = head.unpacked(file, Path(folder), long).dataset()
    for path in long.values():
        store.note_use(path)
    return dataset if head.is_whole or _has_requested(dataset, head.names, work) else None


def _has_requested(dataset: Dataset, names: Sequence[str], work: Work) -> bool:
    """Whether a dataset with some of the fields ``names`` has all that are requested."""
    if work.choose is None:
        return False
    every = tuple(Field(name, ()) for name in names)
    requested = work.choose(replace(dataset, fields=every))
    return {*dataset}.issuperset(requested)


def _convert(work: Work, keep: Callable[[_Result], None] | None = None) -> Dataset:
    """The dataset of a conversion; ``keep`` receives it with its native files if they can be cached."""
    settle_free_memory()
    source = work.converter(work.paths, **work.keywords)
    settings = Settings(fields=work.fields, choose=work.choose)
    conversion: Conversion | None = convert(source, settings, work.paths)
    assert conversion is not None
    remarks, keys = conversion.report.remarks(), list(conversion.dataset.metadata)
    try:
        with TemporaryDirectory(prefix="elvis-") as folder:
            written = _write(conversion.dataset, Path(folder, _MESH))
            further_files = _further_files(source, work.paths)
            result = _Result(written, keys, further_files or {}, remarks, conversion.names, conversion.is_whole)
            # their arrays take more memory than those that are read
            del source
            conversion = None
            release_free_memory()
            dataset = result.dataset()
            if keep is not None and further_files is not None:
                keep(result)
            return dataset
    except (OSError, ElvisError):
        # no room for files, or the format can't represent the data: they are available nonetheless
        conversion = conversion or convert(work.converter(work.paths, **work.keywords), settings, work.paths)
        return replace(conversion.dataset, remarks=remarks)


def _further_files(source: Converter, paths: Sequence[Path]) -> dict[str, str] | None:
    """Digests of the further files that a source has read; None if they are unknown or can't be read."""
    if source.further_files is None:
        return None
    named = set(paths)
    others = [path for path in source.further_files if path not in named]
    digests = _digests(others)
    if digests is None:
        return None
    return dict(zip((os.path.relpath(path, paths[0].parent) for path in others), digests, strict=True))


def _write(dataset: Dataset, path: Path) -> tuple[Path, ...]:
    """The native files of a dataset, not packed; packed ones where ids are too great for HDF5."""
    try:
        return write(dataset, path, mesh_format="hdf5", field_format="hdf5")
    except ElvisError:
        return write(dataset, path)


def _ordered(dataset: Dataset, keys: Sequence[str]) -> Dataset:
    """The dataset with its shapes in the order of packed files, and its metadata in the order of ``keys``."""
    entities = dict(sorted(dataset.mesh.entities.items(), key=lambda item: place(item[0])))
    names = [*(key for key in keys if key in dataset.metadata), *dataset.metadata]
    metadata = {key: dataset.metadata[key] for key in dict.fromkeys(names)}
    return replace(dataset, mesh=replace(dataset.mesh, entities=entities), metadata=metadata)


def _keep(store: Store, key: bytes, result: _Result, remarks: list[str]) -> None:
    """Write a conversion to the cache, where there is room for it."""
    try:
        if result.size > store.most:
            return
        result.keep(store, key)
    except OSError as error:
        remarks.append(f"conversions can't be cached in {store.folder}: {error.strerror or error}")
        return
    store.files()


def _key(work: Work, digests: Sequence[str]) -> bytes | None:
    """Digest of everything on which a conversion depends; None if its code can't be read."""
    kind = work.converter
    # a converter in a package may use all of that
    package, _, module = kind.__module__.rpartition(".")
    code = [_code(name) for name in (*_PACKAGES, package or module)]
    libraries = [_version(name) for name in ("elvis-viz", "numpy", "h5py", *kind.needs)]
    named = [work.name, kind.__module__, kind.__qualname__, sorted(work.keywords.items()), work.fields]
    parts = [code, libraries, named, [path.name for path in work.paths], list(digests)]
    return sha256(json.dumps(parts).encode()).digest() if all(code) else None


def _digests(paths: Sequence[Path]) -> list[str] | None:
    """SHA-256 of each file's content; None where one is a folder or can't be read."""
    found = []
    for path in paths:
        try:
            with path.open("rb") as file:
                found.append(file_digest(file, "sha256").hexdigest())
        except OSError:
            return None
    return found


@cache
def _code(name: str) -> str:
    """A digest of the code of a package or a module; empty where it can't be read."""
    module = import_module(name)
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    own = getattr(module, "__file__", None)
    paths = [path for folder in folders for path in folder.rglob("*.py")] or ([Path(own)] if own else [])
    digests = _digests(sorted(paths))
    return sha256("".join(digests).encode()).hexdigest() if digests else ""


@cache
def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""
