"""Run libraries in a separate process, since damaged files crash some libraries or never end.

The results come back through a pipe, as plain numbers, texts and arrays; this process never lets the library read such
a file.  The other process may use memory and processor time in proportion to the size of its files, far more than valid
files need.  It searches modules in the same places as this one, so no file of the folder it runs in is mistaken for a
library.  If the system permits, it is a copy of a process that has already loaded the library
(`elvis.converters.shared.copies`).

A message is the length of a text, the text, and the bytes of arrays.  The text is JSON, in which ``{"array": [type,
shape]}`` represents the next of the arrays, and ``{"items": [[key, value], ...]}`` a dictionary.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import traceback
import weakref
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from threading import Timer
from typing import IO, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from elvis.converters.shared.copies import IS_POSSIBLE, Copy, copied
from elvis.core.base.errors import ElvisError, FormatError

#: bytes of memory at most, beyond what the process has with its library: this many, and this many for each byte of the
#: files, which may be compressed
MEMORY, MEMORY_PER_BYTE = 192 << 20, 200
#: bytes of the stack of a thread; libraries may start one for each processor
STACK = 16 << 20

#: seconds of the processor at most for one question: this many, and one for this many bytes of the files or the reply
SECONDS, BYTES_PER_SECOND = 4, 1 << 18

#: seconds beyond its processor time that a reply may take, on a busy machine or a slow disk
_PATIENCE = 30

#: seconds beyond that, in which the library is loaded
_LOADING = 60

_PROGRAM = """
import sys
sys.path[:] = {places!r}
from elvis.converters.shared.apart import alone
alone({worker!r}, {memory!r})
"""

#: by what a process ends that takes longer than it may
_OUT_OF_TIME = -int(getattr(signal, "SIGPROF", 27))

#: types of numbers and texts, the only ones of arrays in messages
_TYPES = "biufcU"


class LibraryError(Exception):
    """The library gave no reply: the text is the traceback of the other process, where there is one."""

    def __init__(self, is_out_of_time: bool = False, trace: str = "") -> None:
        super().__init__(trace)
        self.is_out_of_time = is_out_of_time

    @property
    def reason(self) -> str:
        """The reason for the "found" part of a message."""
        if self.is_out_of_time:
            return "one on which the library takes too long"
        return "one on which the library fails"


class Apart:
    """An object in a process of its own, which ends with the context, or with this object.

    worker  ``module:class`` of the object, which is made without arguments and loads its library then
    size    in bytes of all files that it reads
    """

    def __init__(self, worker: str, size: int) -> None:
        self._memory = limit_for(size)
        self._process = launched(worker, self._memory)
        self._end = weakref.finalize(self, _ended, self._process)
        self._patience = _LOADING

    def __enter__(self) -> Apart:
        return self

    def __exit__(self, *unused: object) -> None:
        self._end()

    def ask(self, method: str, *given: Any, size: int) -> Any:
        """The result of a method of the object; raises FormatError and ElvisError as the method does.

        given  numbers, texts, None, arrays, and lists and dictionaries of these
        size   size in bytes of the files that it reads, or of its result
        Raises LibraryError if the process ends, takes too long, or meets any other exception.
        """
        seconds = SECONDS + size // BYTES_PER_SECOND
        late: list[bool] = []
        timer = Timer(self._patience + _PATIENCE * (seconds + 1), _give_up, (self._process, late))
        timer.start()
        ignore_closed_pipes()
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            send(self._process.stdin, [method, seconds, *given])
            kind, *found = receive(self._process.stdout, self._memory)
        except (OSError, EOFError):  # it has ended, or is about to
            status = self._process.wait()
            raise LibraryError(bool(late) or status == _OUT_OF_TIME) from None
        except ValueError:
            self._process.kill()
            raise LibraryError from None
        finally:
            timer.cancel()
        self._patience = 0
        if kind == "format":
            message, file, place = found
            raise FormatError(message, file=file, place=place)
        if kind == "error":
            raise ElvisError(*found)
        if kind == "failed":
            raise LibraryError(False, *found)
        return found[0]


def limit_for(size: int) -> int:
    """Bytes of memory that a library may take for files of this size in bytes."""
    return MEMORY + STACK * (os.cpu_count() or 1) + MEMORY_PER_BYTE * size


def ignore_closed_pipes() -> None:
    """Make writing to a closed pipe an exception again, as Python does.

    When Gmsh's library starts, it sets this signal to end the process silently, without Python's knowledge.
    """
    ours = getattr(signal, "SIGPIPE", None)
    if ours is not None and signal.getsignal(ours) is signal.SIG_IGN:
        with suppress(ValueError):  # threads other than the main one can't say
            signal.signal(ours, signal.SIG_IGN)


def launched(worker: str, memory: int) -> subprocess.Popen[bytes] | Copy:
    """A process that serves a worker: it receives requests on its input and answers on its output."""
    if IS_POSSIBLE:
        with suppress(OSError):  # the library can't be loaded; the next process will report it
            return copied(worker, memory, _LOADING)
    places = [place for place in sys.path if place]
    program = _PROGRAM.format(places=places, worker=worker, memory=memory)
    return subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def make(worker: str) -> Any:
    """The object that serves, its library loaded."""
    module, _, name = worker.partition(":")
    return getattr(import_module(module), name)()


def alone(worker: str, memory: int) -> NoReturn:
    """Load a library, then reply to requests; main function of a process that is not a copy."""
    requests, replies = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)  # the library's own input and output are not messages
    os.dup2(nothing, 1)
    serve(make(worker), requests, replies, memory)


def serve(made: Any, requests: int, replies: int, memory: int) -> NoReturn:
    """Reply to the requests of a worker until none are left."""
    _limit("RLIMIT_CORE", 0)
    if taken := _data():
        _limit("RLIMIT_DATA", taken + memory)
    with suppress(EOFError, OSError), os.fdopen(requests, "rb") as asked, os.fdopen(replies, "wb") as answers:
        while True:  # until the other process has ended
            method, seconds, *given = receive(asked, memory)
            with suppress(AttributeError):  # not all systems have this clock, which ends the process
                signal.setitimer(signal.ITIMER_PROF, seconds)
            send(answers, _reply(made, method, given))
    os._exit(0)  # after damaged files, libraries leave objects behind that cause complaints at the end


def _reply(made: object, method: str, given: Sequence[Any]) -> list[Any]:
    """The kind of a reply, and what belongs to it."""
    try:
        return ["found", getattr(made, method)(*given)]
    except FormatError as error:
        file = None if error.file is None else str(error.file)
        return ["format", error.message, file, error.place]
    except ElvisError as error:
        return ["error", str(error)]
    except Exception as error:  # noqa: BLE001 - of libraries: the other process gets the traceback
        return ["failed", "".join(traceback.format_exception(error))]


def send(stream: IO[bytes], value: Any) -> None:
    """Write a message; raises TypeError for values of types that `Apart.ask` does not list."""
    arrays: list[NDArray[Any]] = []
    text = json.dumps(_plain(value, arrays)).encode("ascii")
    stream.write(len(text).to_bytes(8, "little") + text)
    for array in arrays:
        stream.write(array.reshape(-1).view(np.uint8).data)
    stream.flush()


def receive(stream: IO[bytes], limit: int) -> Any:
    """Read a message of at most this many bytes; raises EOFError if it ends early, ValueError if it is invalid."""
    length = int.from_bytes(_filled(stream, np.empty(8, np.uint8)).tobytes(), "little")
    if length > limit:
        raise ValueError(f"expected at most {limit} bytes, found {length}")
    text = _filled(stream, np.empty(length, np.uint8)).tobytes()
    try:
        return _Reader(stream, limit - length).value(json.loads(text))
    except TypeError as error:
        raise ValueError(str(error)) from error


class _Reader:
    """Values of a message from its JSON, with the arrays that follow in a stream; ``left`` bytes of these at most."""

    def __init__(self, stream: IO[bytes], left: int) -> None:
        self._stream, self._left = stream, left

    def value(self, plain: Any) -> Any:
        """The value of a part of the text."""
        if isinstance(plain, list):
            return [self.value(each) for each in plain]
        if not isinstance(plain, dict):
            return plain
        ((kind, found),) = plain.items()
        if kind == "items":
            return {key: self.value(each) for key, each in found}
        return self._array(*found)

    def _array(self, name: str, shape: Sequence[int]) -> NDArray[Any]:
        dtype, count = np.dtype(name), math.prod(shape)
        if dtype.kind not in _TYPES or min(shape, default=0) < 0 or count * dtype.itemsize > self._left:
            raise ValueError(f"expected an array of {self._left} bytes at most, found {shape} of {dtype}")
        self._left -= count * dtype.itemsize
        array = np.empty(shape, dtype)
        _filled(self._stream, array.reshape(-1).view(np.uint8))
        return array


def _plain(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """A value as JSON knows it, its arrays appended to a list."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in _TYPES:
            raise TypeError(f"expected numbers or texts, found {value.dtype}")
        arrays.append(np.ascontiguousarray(value))
        return {"array": [value.dtype.str, list(value.shape)]}
    if isinstance(value, dict):
        return {"items": [[key, _plain(each, arrays)] for key, each in value.items()]}
    if isinstance(value, (list, tuple)):
        return [_plain(each, arrays) for each in value]
    return value


def _filled(stream: IO[bytes], array: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An array of bytes, filled from a stream."""
    at = 0
    while at < len(array):
        count = stream.readinto(array.data[at:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        at += count
    return array


def _data() -> int:
    """Bytes of this process that `RLIMIT_DATA` counts; 0 where the system does not report them."""
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as status:
            return next((1024 * int(line.split()[1]) for line in status if line.startswith("VmData")), 0)
    except OSError:
        return 0


def _limit(name: str, value: int) -> None:
    """Set a limit of this process, on systems that have it."""
    with suppress(ImportError, AttributeError, ValueError, OSError):
        import resource

        kind = getattr(resource, name)
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (value if hard < 0 else min(value, hard), hard))


def _give_up(process: subprocess.Popen[bytes] | Copy, late: list[bool]) -> None:
    late.append(True)
    process.kill()


def _ended(process: subprocess.Popen[bytes] | Copy) -> None:
    """End a process, which holds nothing that would be missed."""
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(OSError):
                stream.close()
    if isinstance(process, Copy):
        process.forget()
    else:
        process.wait()
