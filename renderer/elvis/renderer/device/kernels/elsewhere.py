"""Kernels compiled by another process, for programs whose threads must run meanwhile.

Slang holds the interpreter while it compiles, for more than a second for the largest kernels.  A program that calls
`compile_elsewhere` lets a second process compile each kernel that was never compiled before.  That process works on the
database of this one, from which this one loads the kernel in about a tenth of the time.  The second process ends when
it has had nothing to do for some seconds, and returns its memory.

Slang's CPU target has no cached kernels, and is compiled here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING

from elvis.core.base.errors import ElvisError
from elvis.renderer.device.adapters import Adapter

if TYPE_CHECKING:
    from elvis.renderer.device.device import Device

#: seconds without a request after which the second process ends
IDLE = 10.0
#: kinds of devices whose kernels slangpy caches
CACHED = ("vulkan", "cuda")


@dataclass(frozen=True)
class Request:
    """A kernel to compile.

    database  folder of the database that receives it
    device    name of the device
    folders   folders of Slang modules
    stage     module of the kernel
    source    Slang text of its element type
    """

    database: str
    device: str
    folders: tuple[str, ...]
    stage: str
    source: str


class Compiler:
    """The second process, which is started on the first request and after each idle end."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def make(self, request: Request) -> bool:
        """Compile a kernel; False if the process ended, and nothing is known of the kernel."""
        # an idle process may end between a look at it and the request: then a new one is tried
        return any(self._answers(request) for _ in range(2))

    def _answers(self, request: Request) -> bool:
        """Whether the process answers a request."""
        with suppress(OSError):
            process = self._started()
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(json.dumps(asdict(request)).encode() + b"\n")
            process.stdin.flush()
            if process.stdout.readline():
                return True
        self.close()
        return False

    def _started(self) -> subprocess.Popen[bytes]:
        """The process."""
        if self._process is None:
            command = [sys.executable, "-c", f"from {__name__} import serve; serve()"]
            pipe, void = subprocess.PIPE, subprocess.DEVNULL
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=void, env=_environment())
        return self._process

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with suppress(OSError):  # what it was to receive can't be sent
                process.communicate()


def _environment() -> dict[str, str]:
    """The environment of the process, which imports the same modules."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


_compilers: list[Compiler] = []


def compile_elsewhere() -> None:
    """Let another process compile the kernels of this one from now on."""
    if not _compilers:
        _compilers.append(Compiler())


class Elsewhere:
    """The kernels of one device that another process compiles.

    made  how many there were so far
    """

    def __init__(self, adapter: Adapter, database: Path | None) -> None:
        self._device = adapter.name
        self._database = database if adapter.kind in CACHED else None
        self.made = 0

    def make(self, folders: Sequence[Path], stage: str, source: str) -> None:
        """Compile a kernel if this process lets another one do so; else, and if that fails, nothing happens."""
        if _compilers and self._database is not None:
            places = tuple(map(str, folders))
            request = Request(str(self._database), self._device, places, stage, source)
            self.made += _compilers[0].make(request)


def serve() -> None:
    """Compile the kernels that lines of the standard input request, and answer each by a line."""
    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    # drivers and compilers may print
    os.dup2(2, 1)
    for request in _requests():
        # the program that requested a kernel finds its error itself
        with suppress(ElvisError, RuntimeError):
            _compile(request)
        with suppress(BrokenPipeError):
            print(file=answers, flush=True)


def _requests() -> Iterator[Request]:
    """Requests until the standard input ends; without any for some seconds, this process ends."""
    while True:
        end = Timer(IDLE, os._exit, (0,))
        end.daemon = True
        end.start()
        line = sys.stdin.readline()
        end.cancel()
        if not line:
            return
        yield Request(**json.loads(line))


def _compile(request: Request) -> None:
    """Compile one kernel into the database of the program that requested it."""
    device = _opened(request.device, Path(request.database))
    device.find_modules_in([Path(folder) for folder in request.folders])
    device.link(request.stage, request.source)
    device.finish_writing()


@cache
def _opened(name: str, database: Path) -> Device:
    """A device that writes its kernels to a database."""
    from elvis.renderer.device.device import Device
    from elvis.renderer.device.kernels.cache import work_on

    work_on(database)
    return Device(name)
