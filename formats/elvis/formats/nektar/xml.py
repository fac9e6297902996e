"""XML as the format's own tools write it: elements are spans of the file's bytes, nothing large becomes a tree.

Real files break rules of strict XML (blank lines before the declaration, ``--`` in comments, stray control characters,
bare ampersands).  Most of their bytes are in a few payloads and in millions of similar entries.  Children are therefore
found on demand, only by their tags, and contents are returned as bytes.  Document type declarations are rejected, so no
entity is ever expanded; the five predefined entities of XML and character references are expanded.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content, leading, unpacked_limit
from elvis.formats.nektar.mapped_files import MappedBytes, is_mapped
from elvis.formats.nektar.payload import ENCODING, encode

Buffer: TypeAlias = bytes | bytearray | MappedBytes

_NAME = re.compile(rb"[A-Za-z_:][\w:.\-]*")
_ATTRIBUTE = re.compile(rb"""([A-Za-z_:][\w:.\-]*)\s*=\s*("[^"]*"|'[^']*')""")
_MARK = re.compile(rb"""[<>"']""")
_DECLARATION = re.compile(rb"<!(?!--|\[CDATA\[)")
#: declarations of XML's own
_REFUSED = re.compile(rb"<!(?:DOCTYPE|ENTITY|ELEMENT|ATTLIST|NOTATION)\b")
#: a tag that is disabled by an exclamation mark, which the solver's parser skips
_UNKNOWN = re.compile(rb"<!(?!--|\[CDATA\[)[^>]*>")
#: bytes of a tag that a message shows
_SHOWN = 60
_AFTER_NAME = (b" ", b"\t", b"\r", b"\n", b"/", b">")
#: tags examined one by one before the file is searched for a name
_NEAR = 32
_BEGINNING = re.compile(rb"(\xef\xbb\xbf)?[\x01-\x20]*<")
_SPECIAL = re.compile(rb"<!--|<!\[CDATA\[")
_BLANKS = re.compile(rb"\s*")
_REFERENCE = re.compile(r"&(lt|gt|amp|quot|apos|#[0-9]{1,7}|#x[0-9a-fA-F]{1,6});")
_NAMED = {"lt": "<", "gt": ">", "amp": "&", "quot": '"', "apos": "'"}


@dataclass(frozen=True, eq=False)
class Element:
    """An element of a document; its content is ``data[start:stop]`` and holds no comments."""

    tag: str
    data: Buffer
    opening: slice  # position of the attributes in data
    start: int
    stop: int
    file: str

    @cached_property
    def attributes(self) -> dict[str, str]:
        """Attributes by name, references resolved."""
        body = bytes(self.data[self.opening])
        return {_decode(name): unescape(_decode(value[1:-1])) for name, value in _ATTRIBUTE.findall(body)}

    @property
    def content(self) -> memoryview:
        """Everything between the tags, without a copy."""
        return memoryview(self.data)[self.start : self.stop]

    @property
    def text(self) -> str:
        """The content as text, stripped, references resolved."""
        return unescape(_decode(self.data[self.start : self.stop])).strip()

    @property
    def source(self) -> str:
        """The element as it stands in the document, tags included, without comments."""
        attributes, inner = _decode(self.data[self.opening]), _decode(self.data[self.start : self.stop])
        return f"<{self.tag}{attributes.rstrip('/')}>{inner}</{self.tag}>"

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing but blanks between the tags."""
        return _BLANKS.fullmatch(self.data, self.start, self.stop) is not None

    @property
    def place(self) -> str:
        """The position of the element, for messages."""
        return f"line {_line(self.data, self.opening.start)}, <{self.tag}>"

    def children(self) -> Iterator[Element]:
        """The elements directly inside, in file order; raises FormatError if their tags don't match."""
        return _elements(self.data, self.start, self.stop, self.file)

    def find(self, tag: str) -> Element | None:
        """The first child of this tag, None if there is none."""
        return next((child for child in self.children() if child.tag == tag), None)

    def error(self, message: str) -> FormatError:
        """An error at this element."""
        return FormatError(message, file=self.file, place=self.place)

    def require(self, name: str) -> str:
        """An attribute that must be there."""
        if name not in self.attributes:
            raise self.error(f"expected an attribute {name}, found none")
        return self.attributes[name]


#: advice for data that are not native
OTHERS = "elvis.plugins.read takes the files of other programs"


def check_root(root: Element, file: str) -> None:
    """Raise FormatError for a document of another format."""
    if root.tag != "NEKTAR":
        raise FormatError(f"expected a root <NEKTAR>, found <{root.tag}>; {OTHERS}", file=file)


def parse(data: Buffer, file: str) -> list[Element]:
    """The elements at the top of a document; several are legal in old files.

    Raises FormatError if the data are not XML, hold a document type or entity declaration, or end within an element.
    """
    if not begins_like_xml(data):
        raise FormatError("expected XML or HDF5, found " + _description(data), file=file)
    cleaned = data
    # payloads hold no exclamation mark: one quick search shows that there are neither comments nor declarations
    if b"!" in data:
        declaration = _DECLARATION.search(data)
        cleaned = _without_comments(data, file) if _SPECIAL.search(data) else data
        if declaration and (found := _REFUSED.search(cleaned)):
            line = _line(cleaned, found.start())
            raise FormatError(
                "declarations of document types and entities are not allowed", file=file, place=f"line {line}"
            )
        if declaration and _DECLARATION.search(cleaned):
            cleaned = _without_unknown(cleaned)
    return list(_elements(cleaned, 0, len(cleaned), file))


def begins_like_xml(data: Buffer) -> bool:
    """Whether the first character, after encoding marks and blanks, begins a tag."""
    return _BEGINNING.match(data) is not None


def unescape(text: str) -> str:
    """``text`` with the references of XML resolved; any other ampersand is unchanged."""
    return _REFERENCE.sub(_refer, text) if "&" in text else text


def _refer(match: re.Match[str]) -> str:
    name = match[1]
    if name in _NAMED:
        return _NAMED[name]
    code = int(name[2:], 16) if name[1] == "x" else int(name[1:])
    return chr(code) if code < 0xD800 or 0xDFFF < code < 0x110000 else match[0]


def _without_comments(data: Buffer, file: str) -> bytes:
    """The document with comments blanked (line ends stay) and CDATA sections turned into escaped text."""
    cleaned = bytearray()
    view, position = memoryview(data), 0
    while found := _SPECIAL.search(data, position):
        is_comment = found[0] == b"<!--"
        end = data.find(b"-->" if is_comment else b"]]>", found.end())
        if end < 0:
            raise FormatError(f"the file ends inside {_decode(found[0])}", file=file, place=f"byte {found.start()}")
        inner = bytes(view[found.end() : end])
        kept = b"\n" * inner.count(b"\n") if is_comment else inner.replace(b"&", b"&amp;").replace(b"<", b"&lt;")
        cleaned += view[position : found.start()]
        cleaned += kept
        position = end + 3
    cleaned += view[position:]
    return bytes(cleaned)


def _without_unknown(data: Buffer) -> bytes:
    """The document with tags that begin with an exclamation mark blanked, line ends stay."""
    return _UNKNOWN.sub(lambda found: b"\n" * found[0].count(b"\n"), bytes(data))


def _elements(data: Buffer, start: int, stop: int, file: str) -> Iterator[Element]:
    position = start
    while (opening := data.find(b"<", position, stop)) >= 0:
        if data[opening + 1 : opening + 2] == b"?":
            position = _after(data, b"?>", opening, stop, file)
            continue
        name = _NAME.match(data, opening + 1, stop)
        if name is None:
            is_end = data[opening + 1 : opening + 2] == b"/"
            found = (
                f"{_tag(data, opening)} without its beginning"
                if is_end
                else repr(_decode(data[opening : opening + 20]))
            )
            raise FormatError(f"expected an element, found {found}", file=file, place=_at(data, opening))

        # an element ends at its own tag, or at the closing tag that matches it
        tag, end = name[0], _tag_end(data, name.end(), stop, file)
        attributes, inner, position = slice(name.end(), end), end + 1, end + 1
        if data[end - 1 : end] == b"/":
            yield Element(_decode(tag), data, attributes, inner, inner, file)
        else:
            closing, position = _closing(data, tag, inner, stop, file)
            yield Element(_decode(tag), data, attributes, inner, closing, file)


def _tag_end(data: Buffer, start: int, stop: int, file: str) -> int:
    """Position of the ``>`` that ends the tag; quoted values may hold one."""
    position = start
    while mark := _MARK.search(data, position, stop):
        if mark[0] == b">":
            return mark.start()
        position = data.find(mark[0], mark.end(), stop) + 1
        if mark[0] == b"<" or position == 0:
            break
    raise FormatError("expected the end of a tag, found none", file=file, place=_at(data, start))


def _closing(data: Buffer, tag: bytes, start: int, stop: int, file: str) -> tuple[int, int]:
    """Positions of the end of the content and of the end of the closing tag.

    Elements of the same tag may be nested in between.
    """
    position, depth = start, 1
    closing = _next(data, b"</" + tag, start, stop)
    while closing >= 0:
        opening = _next(data, b"<" + tag, position, closing)
        position = _tag_end(data, (closing if opening < 0 else opening) + 1 + len(tag), stop, file) + 1
        if opening >= 0:
            depth += data[position - 2 : position - 1] != b"/"
            continue
        depth -= 1
        if depth == 0:
            return closing, position
        closing = _next(data, b"</" + tag, position, stop)
    found = "the end of the file" if stop == len(data) else f"{_tag(data, stop)} in line {_line(data, stop)}"
    expected = f"</{_decode(tag)}> for the <{_decode(tag)}> that begins here"
    raise FormatError(f"expected {expected}, found {found}", file=file, place=_at(data, start))


def _next(data: Buffer, mark: bytes, start: int, stop: int) -> int:
    """Position of the first tag that begins with ``mark``, -1 if there is none.

    The next few tags are examined one by one first: searching for one character skips a payload faster than searching
    for several.
    """
    found = data.find(b"<", start, stop)
    for _ in range(_NEAR):
        if found < 0 or (
            data.startswith(mark, found, stop) and data[found + len(mark) : found + len(mark) + 1] in _AFTER_NAME
        ):
            return found
        found = data.find(b"<", found + 1, stop)
    found = data.find(mark, found, stop) if found >= 0 else found
    while found >= 0 and data[found + len(mark) : found + len(mark) + 1] not in _AFTER_NAME:
        found = data.find(mark, found + 1, stop)
    return found


def _tag(data: Buffer, start: int) -> str:
    """The tag that begins at a position; its end may be cut off."""
    text = _decode(data[start : start + _SHOWN])
    return text.partition(">")[0] + ">" if ">" in text else repr(text)


def _after(data: Buffer, mark: bytes, start: int, stop: int, file: str) -> int:
    position = data.find(mark, start, stop)
    if position < 0:
        raise FormatError(f"expected {_decode(mark)}, found the end", file=file, place=_at(data, start))
    return position + len(mark)


def _at(data: Buffer, position: int) -> str:
    return f"line {_line(data, position)}"


def _line(data: Buffer, position: int) -> int:
    return data.count(b"\n", 0, position) + 1


def _decode(raw: bytes | bytearray) -> str:
    return raw.decode("utf-8", "replace")


def _description(data: Buffer) -> str:
    if not bytes(data).strip():
        return "an empty file"
    return f"{len(data)} bytes that begin {bytes(data[:8])!r}; {OTHERS}"


@contextmanager
def format_errors_at(element: Element) -> Iterator[None]:
    """Errors of the block name this element's file and place, where they name none themselves."""
    try:
        yield
    except FormatError as error:
        raise error.within(element.file, element.place) from error


GZIP_SIGNATURE = b"\x1f\x8b"

_STEP = 1 << 18


def head(path: Path, size: int) -> bytes:
    """The first bytes of a file, unpacked where it is gzipped and not damaged; raises OSError if it can't be read."""
    with path.open("rb") as file:
        raw = file.read(size)
    if not raw.startswith(GZIP_SIGNATURE):
        return raw
    try:
        return zlib.decompressobj(wbits=31).decompress(raw, size)
    except zlib.error:
        return b""


def load(path: Path) -> Buffer:
    """All bytes of a file, mapped where that is allowed (see `mapped_files`), unpacked where it is gzipped."""
    start = leading(path, len(GZIP_SIGNATURE))
    if is_mapped() and start and start != GZIP_SIGNATURE:
        return MappedBytes.of(path)
    raw = content(path)
    return _unpack(raw, path) if raw.startswith(GZIP_SIGNATURE) else raw


def _unpack(raw: bytes, path: Path) -> bytearray:
    """The content of all members of a gzip file, one after another."""
    out, limit = bytearray(), unpacked_limit(len(raw))
    try:
        while raw:
            raw = _member(raw, out, limit, path).lstrip(b"\0")
    except zlib.error as error:
        raise FormatError(f"the gzip data are damaged ({error})", file=path) from error
    return out


def _member(raw: bytes, out: bytearray, limit: int, path: Path) -> bytes:
    """Append one member to ``out``; the bytes after it."""
    decompressor, rest, start = zlib.decompressobj(wbits=31), b"", 0
    while not decompressor.eof:
        if not rest:
            rest, start = raw[start : start + _STEP], start + _STEP
        piece = decompressor.decompress(rest, _STEP)
        rest = decompressor.unconsumed_tail
        is_first = not out
        out += piece
        if is_first and out and not begins_like_xml(out):
            raise FormatError(f"expected XML in the gzip data, found {bytes(out[:8])!r}", file=path)
        if len(out) > limit:
            raise FormatError(f"expected at most {limit} bytes in the gzip data, found more", file=path)
        if not (piece or rest or start < len(raw)):
            raise FormatError("the gzip data end early", file=path)
    return decompressor.unused_data + raw[start:]


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
            # this import also loads code that fetches documents from the network: 2 MB that readers do without
            from xml.sax.saxutils import escape

            self._line(f"<{tag}{_attributes(attributes)}>{escape(_UNWRITABLE.sub(' ', text))}</{tag}>")

    def source(self, text: str) -> None:
        """An element as `Element.source` gives it."""
        self._line(text)

    def payload(self, tag: str, attributes: Mapping[str, object], arrays: Iterable[NDArray[np.generic]]) -> None:
        """An element with the arrays as its payload, on one line."""
        self._stream.write(f"{self._indent}<{tag}{_attributes(attributes)}>".encode())
        for piece in encode(arrays):
            self._stream.write(piece)
        self._stream.write(f"</{tag}>\n".encode())

    def lines(self, lines: Iterable[str]) -> None:
        """Lines, complete, at this level."""
        indent = self._indent
        self._stream.write("".join(f"{indent}{line}\n" for line in lines).encode())

    @property
    def _indent(self) -> str:
        return "    " * self._level

    def _line(self, text: str) -> None:
        self._stream.write(f"{self._indent}{text}\n".encode())


@contextmanager
def document(path: Path, is_gzipped: bool) -> Iterator[Writer]:
    """A document with the root NEKTAR in a file, gzipped (without names and times) on request."""
    with path.open("wb") as file:
        stream = gzip.GzipFile(filename="", fileobj=file, mode="wb", mtime=0) if is_gzipped else file
        stream.write(b'<?xml version="1.0" encoding="utf-8" ?>\n')
        writer = Writer(stream)  # type: ignore[arg-type]
        with writer.element("NEKTAR"):
            yield writer
        if is_gzipped:
            stream.close()


def write_metadata(writer: Writer, metadata: Mapping[str, str]) -> None:
    """The section Metadata, none if there are no metadata; invalid characters of keys become underscores."""
    if metadata:
        with writer.element("Metadata"):
            for key, text in metadata.items():
                name = _NOT_IN_NAMES.sub("_", key) or "_"
                writer.leaf(name if name[0].isalpha() or name[0] == "_" else f"_{name}", None, text)


def _attributes(attributes: Mapping[str, object] | None) -> str:
    pairs = (attributes or {}).items()
    return "".join(f" {name}={_quote(str(value))}" for name, value in pairs)


def _quote(value: str) -> str:
    from xml.sax.saxutils import quoteattr

    return quoteattr(_UNWRITABLE.sub(" ", value), {'"': "&quot;"})
