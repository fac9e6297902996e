"""Processes that do one thing after another at once: workers of Dask, on this machine unless a scheduler is given."""

from __future__ import annotations

import logging
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import check_module, require_module

T = TypeVar("T")
#: how processes begin: where a system can, as copies of one that has loaded modules and holds no device
_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
#: of Dask: the work of a worker that was ended is not given to another, none has work that waits for it while others
#: are idle, and none is watched by threads of its own
_CONFIGURATION = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.multiprocessing-method": _METHOD,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "1m",
    "distributed.admin.system-monitor.gil.enabled": False,
}
#: held by the thread of a worker that works
_ONE_AT_ONCE = Lock()
#: the scheduler's status page is only for this machine, on a free port
_STATUS = {"dashboard_address": "localhost:0"}


@dataclass(frozen=True)
class Workers:
    """Processes that work for this one.

    count      on this machine
    scheduler  address of a Dask scheduler, whose workers are used instead; they see the same files
    """

    count: int = 2
    scheduler: str = ""

    @staticmethod
    def of(count: int, scheduler: str) -> Workers | None:
        """The workers for the options, None for this process; MissingPackageError if a package is missing."""
        if count < 2 and not scheduler:
            return None
        for module in ("distributed", *(() if scheduler else ("cryptography",))):
            check_module(module, "--workers", "parallel")
        return Workers(count, scheduler)

    def prepare(self, module: str) -> None:
        """Start to load the modules that all workers of this machine need, once, while the data are read."""
        if self.scheduler or _METHOD != "forkserver":
            return
        from multiprocessing.forkserver import ensure_running

        multiprocessing.set_forkserver_preload(["distributed", module])
        ensure_running()

    @contextmanager
    def client(self) -> Iterator[Any]:
        """A client of the scheduler, or of workers of its own."""
        distributed = require_module("distributed", "--workers", "parallel")
        if self.scheduler:
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors are reported in sentences
            try:
                own = distributed.Client(self.scheduler)
            except (OSError, ValueError) as error:
                raise ElvisError(f"expected a Dask scheduler at {self.scheduler}, found none: {error}") from error
            with own as client:
                yield client
            return
        dask = require_module("dask", "--workers", "parallel")
        # access to a scheduler allows running code: its own certificates keep other users out
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        threads = os.environ.get("LP_NUM_THREADS", str(max(1, cores // self.count)))
        with dask.config.set(_CONFIGURATION), ExitStack() as until_end:
            cluster = distributed.LocalCluster(
                n_workers=self.count,
                threads_per_worker=1,
                memory_limit=None,
                dashboard_address=None,
                scheduler_kwargs=_STATUS,
                security=True,
                protocol="tls",
                silence_logs=logging.CRITICAL,
                env={"LP_NUM_THREADS": threads},
            )
            until_end.callback(_close, cluster)
            yield until_end.enter_context(distributed.Client(cluster))

    def number(self, client: Any) -> int:
        """How many there are now."""
        return max(1, len(client.scheduler_info()["workers"])) if self.scheduler else self.count


def _close(cluster: Any) -> None:
    """End workers; workers that are busy for longer than Dask waits end with this process, and hide no other error."""
    with suppress(TimeoutError):
        cluster.close()


def begun(client: Any, work: Callable[..., T], pieces: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Futures of work at pieces, which are its arguments; names of files begin in the folder of this process."""
    return [client.submit(_in_folder, Path.cwd(), work, *own, pure=False) for own in pieces]


def results(client: Any, futures: Sequence[Any], kept: str) -> list[Any]:
    """The results of all work; raises its exceptions, and ElvisError if a worker was killed.

    kept  results that remain, and how to continue
    """
    scheduling = require_module("distributed.scheduler", "--workers", "parallel")
    try:
        found: list[Any] = client.gather(futures)
    except scheduling.KilledWorker as error:
        raise ElvisError(f"a worker was killed, possibly for lack of memory: {kept}") from error
    except CancelledError as error:
        raise ElvisError(f"the Dask scheduler is gone: {kept}") from error
    return found


def at_rest(work: Callable[[], object]) -> None:
    """Do something in a worker that has no other work, such as another command's."""
    if _ONE_AT_ONCE.acquire(blocking=False):
        try:
            work()
        finally:
            _ONE_AT_ONCE.release()


def _in_folder(folder: Path, work: Callable[..., T], *piece: Any) -> T:
    # workers of a scheduler may have several threads, but a process has one folder and one device
    with _ONE_AT_ONCE:
        os.chdir(folder)
        return work(*piece)
