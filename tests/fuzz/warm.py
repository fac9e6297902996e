"""Commands in forked processes that have imported everything: they work at once, a thousand take minutes."""

from __future__ import annotations

import atexit
import json
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from elvis.plugins.command.command import main

#: packages of modules that forked processes inherit; slangpy and what starts threads is left out
INHERITED = ("elvis", "numpy", "h5py", "PIL", "pydantic", "click", "rich", "yaml", "OpenEXR", "cmap", "aiohttp")


class Warm:
    """A command in a forked process, with the methods of `subprocess.Popen` that the harness uses."""

    def __init__(self, words: Sequence[str], folder: Path, modules: int | None = None) -> None:
        """Start it in a folder; ``modules`` is a file that receives the names of the modules that it imports."""
        read_end, write_end = os.pipe()
        self.pid, self.returncode = os.fork(), None
        if not self.pid:
            os.close(read_end)
            _work(words, folder, write_end, modules)
        os.close(write_end)
        self._messages = read_end

    def send_signal(self, number: int) -> None:
        """Send a signal to the process, which nobody has waited for yet."""
        os.kill(self.pid, number)

    def communicate(self) -> tuple[None, str]:
        """Wait for the end; what the process wrote to standard error."""
        with os.fdopen(self._messages, "rb") as stream:
            text = stream.read().decode(errors="replace")
        self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return None, text


def inherit(words: Sequence[str], folder: Path) -> None:
    """Import here what a command imports, which a forked process tells."""
    read_end, write_end = os.pipe()
    process = Warm(words, folder, write_end)
    os.close(write_end)
    with os.fdopen(read_end, "rb") as stream:
        names = stream.read()
    _, text = process.communicate()
    if process.returncode or not names:
        raise SystemExit(f"{' '.join(words)} ends with status {process.returncode}: {text}")
    for name in json.loads(names):
        if name.partition(".")[0] in INHERITED and name not in sys.modules:
            import_module(name)


def _work(words: Sequence[str], folder: Path, messages: int, modules: int | None) -> None:
    """Run the command as a process does, and end."""
    status: object = 1
    # exit functions of the parent process would delete its folders
    atexit._clear()
    try:
        _prepare(words, folder, messages)
        main()
    except SystemExit as end:
        status = end.code or 0
    except BaseException:
        traceback.print_exc()
    if modules is not None:
        with os.fdopen(modules, "wb") as stream:
            stream.write(json.dumps(list(sys.modules)).encode())
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status if isinstance(status, int) else 1)


def _prepare(words: Sequence[str], folder: Path, messages: int) -> None:
    """Let this process have the streams, the folder and the words of a command; then interrupts are exceptions."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for number, own in ((0, nothing), (1, nothing), (2, messages)):
        os.dup2(own, number)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    os.chdir(folder)
    sys.argv = ["elvis", *words]
    signal.signal(signal.SIGINT, signal.default_int_handler)
