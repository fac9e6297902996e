"""XML as this project writes it: indented, one-line payloads, in a form that the format's own parser accepts."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from elvis.formats.nektar.payload import ENCODING, encode

_UNWRITABLE = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_NOT_IN_NAMES = re.compile(r"[^\w.\-]")
COMPRESSED = {"COMPRESSED": ENCODING, "BITSIZE": "64"}


class Writer:
    """Writes elements to a binary stream, indented by four blanks a level."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._level = stream, 0

    @contextmanager
    def element(self, tag: str, attributes: Mapping[str, object] | None = None) -> Iterator[None]:
        """An element around what the block writes."""
        self._line(f"<{tag}{_attributes(attributes)}>")
        self._level += 1
        yield
        self._level -= 1
        self._line(f"</{tag}>")

    def leaf(self, tag: str, attributes: Mapping[str, object] | None = None, text: str | None = None) -> None:
        """An element with text, or an empty one."""
        if text is None:
            self._line(f"<{tag}{_attributes(attributes)} />")
        else:
            self._line(f"<{tag}{_attributes(attributes)}>{escape(_UNWRITABLE.sub(' ', text))}</{tag}>")

    def payload(self, tag: str, attributes: Mapping[str, object], arrays: Iterable[NDArray[np.generic]]) -> None:
        """An element with the arrays as its payload, on one line."""
        self._stream.write(f"{self._indent}<{tag}{_attributes(attributes)}>".encode())
        for piece in encode(arrays):
            self._stream.write(piece)
        self._stream.write(f"</{tag}>\n".encode())

    def lines(self, lines: Iterable[str]) -> None:
        """Ready-made lines at this level."""
        indent = self._indent
        self._stream.write("".join(f"{indent}{line}\n" for line in lines).encode())

    @property
    def _indent(self) -> str:
        return "    " * self._level

    def _line(self, text: str) -> None:
        self._stream.write(f"{self._indent}{text}\n".encode())


@contextmanager
def document(path: Path, is_gzipped: bool) -> Iterator[Writer]:
    """A document with the root NEKTAR in a file, gzipped (without names and times) where asked."""
    with path.open("wb") as file:
        stream = gzip.GzipFile(filename="", fileobj=file, mode="wb", mtime=0) if is_gzipped else file
        stream.write(b'<?xml version="1.0" encoding="utf-8" ?>\n')
        writer = Writer(stream)  # type: ignore[arg-type]
        with writer.element("NEKTAR"):
            yield writer
        if is_gzipped:
            stream.close()


def write_metadata(writer: Writer, metadata: Mapping[str, str]) -> None:
    """The section Metadata, none for none; keys that can't name an element get underscores for what is wrong."""
    if metadata:
        with writer.element("Metadata"):
            for key, text in metadata.items():
                name = _NOT_IN_NAMES.sub("_", key) or "_"
                writer.leaf(name if name[0].isalpha() or name[0] == "_" else f"_{name}", None, text)


def _attributes(attributes: Mapping[str, object] | None) -> str:
    pairs = (attributes or {}).items()
    return "".join(f" {name}={_quoted(str(value))}" for name, value in pairs)


def _quoted(value: str) -> str:
    return quoteattr(_UNWRITABLE.sub(" ", value), {'"': "&quot;"})
