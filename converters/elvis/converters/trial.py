"""Trials: a library reads a file in a process of its own first, for damaged files crash some libraries or never end.

The process may take memory and processor time as the size of its files allows, far more than sound files need.  It
looks for modules where this one does, so that none of the folder it runs in is taken for a library.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

#: bytes of memory at most: so many, and so many for each byte of the files
MEMORY, MEMORY_PER_BYTE = 4 << 30, 200

#: seconds of the processor at most once the library is loaded: so many, and one for so many bytes of the files
SECONDS, BYTES_PER_SECOND = 4, 1 << 18

#: how much longer than its processor time a trial may last, on a busy machine or a slow disk
_PATIENCE = 30

#: what programs of trials begin with: `bound` starts the clock, `say` tells one sentence
_PROLOGUE = """
import sys
sys.path[:] = {places!r}
import os, time
from contextlib import suppress
answer = os.dup(1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
def say(text):
    os.write(answer, text.encode("utf-8", "replace")[:4000])
def limit(name, value):
    with suppress(ImportError, AttributeError, ValueError, OSError):  # not all systems have limits
        import resource
        kind = getattr(resource, name)
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (value if hard < 0 else min(value, hard), hard))
def bound():
    limit("RLIMIT_CPU", int(time.process_time()) + 1 + {seconds})
limit("RLIMIT_CORE", 0)
limit("RLIMIT_AS", {memory})
"""

_OUT_OF_TIME = -int(getattr(signal, "SIGXCPU", 24))


@dataclass(frozen=True)
class Outcome:
    """How a trial ended: ``status`` 0 where all went well, negative after a signal; ``said`` the sentence it told."""

    status: int
    said: str

    @property
    def reason(self) -> str:
        """What the files are, as what a sentence says was found."""
        if self.status == _OUT_OF_TIME:
            return "one on which the library takes too long"
        return self.said or "one on which the library fails"


def attempt(program: str, paths: Sequence[Path], size: int | None = None) -> Outcome:
    """Run a Python program with names of files as its arguments; see `_PROLOGUE` for what it may call.

    size  in bytes of all that is read, that of the files themselves by default
    """
    size = sum(path.stat().st_size for path in paths) if size is None else size
    seconds = SECONDS + size // BYTES_PER_SECOND
    places = [place for place in sys.path if place]
    prologue = _PROLOGUE.format(places=places, seconds=seconds, memory=MEMORY + MEMORY_PER_BYTE * size)
    command = [sys.executable, "-c", prologue + program, *map(str, paths)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_PATIENCE * (seconds + 1),
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Outcome(_OUT_OF_TIME, "")
    return Outcome(done.returncode, " ".join(done.stdout.decode("utf-8", "replace").split()))
