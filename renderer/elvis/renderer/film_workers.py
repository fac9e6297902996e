"""Frames drawn by several processes at once: workers of Dask, on this machine unless a scheduler is given.

Each worker opens the data once and draws frames that follow one another, so that it reads the next step while it draws.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np

from elvis.core.errors import ElvisError
from elvis.core.needing import require_module
from elvis.renderer.animation import Film, Shot
from elvis.scene import Scene

#: blocks of frames for each worker, so that all end at about one time
_BLOCKS = 4
#: how processes begin: where a system can, as copies of one that has loaded these modules and holds no device
_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
_PRELOADED = ["distributed", "elvis.renderer.film_workers"]
#: of Dask: the work of a worker that was ended is not given to another, and none is watched by threads of its own
_CONFIGURATION = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.worker.multiprocessing-method": _METHOD,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "1m",
    "distributed.admin.system-monitor.gil.enabled": False,
}
#: of the scheduler: its page of status is for this machine alone, at a port that is free
_STATUS = {"dashboard_address": "localhost:0"}
#: seconds between looks at what is done
_LOOK = 0.1
#: the film that a worker draws, by what it was opened with
_OPEN: dict[object, Film] = {}


@dataclass(frozen=True)
class Workers:
    """Processes that draw.

    count      of them on this machine
    scheduler  address of a Dask scheduler, whose workers draw in place of these; they see the same files
    """

    count: int = 2
    scheduler: str = ""

    def draw(self, base: Scene, shots: Sequence[Shot], is_kept: bool, told: list[str]) -> Iterator[Path]:
        """Draw frames of a film; their files, as they come to be.

        base     the scene that the film was opened with
        is_kept  whether conversions are kept
        told     gets what the series tells of its steps

        Raises what drawing raises, and ElvisError where a worker was ended.
        """
        with self._client() as client:
            count = self.count if not self.scheduler else max(1, len(client.scheduler_info()["workers"]))
            blocks = np.array_split(np.arange(len(shots)), _BLOCKS * count)
            folder = Path.cwd()
            works = [([shots[number] for number in block.tolist()], folder) for block in blocks if len(block)]
            futures = [client.submit(draw_block, base, *work, is_kept, pure=False) for work in works]
            yield from _written([path for _, path in shots], futures)
            told += [sentence for own in _results(client, futures) for sentence in own]

    def check(self) -> None:
        """MissingPackageError where what they need is not installed."""
        for module in ("distributed", *(() if self.scheduler else ("cryptography",))):
            require_module(module, "--workers", "parallel")

    def prepare(self) -> None:
        """Begin to load the modules that all workers of this machine need, once, while the data are looked at."""
        if self.scheduler or _METHOD != "forkserver":
            return
        from multiprocessing.forkserver import ensure_running

        multiprocessing.set_forkserver_preload(_PRELOADED)
        ensure_running()

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """A client of the scheduler, or of workers of its own."""
        distributed = require_module("distributed", "--workers", "parallel")
        if self.scheduler:
            try:
                own = distributed.Client(self.scheduler)
            except (OSError, ValueError) as error:
                raise ElvisError(f"expected a Dask scheduler at {self.scheduler}, found none: {error}") from error
            with own as client:
                yield client
            return
        dask = require_module("dask", "--workers", "parallel")
        # whoever may talk to a scheduler may run code: its own certificates keep other users out
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        threads = os.environ.get("LP_NUM_THREADS", str(max(1, cores // self.count)))
        with (
            dask.config.set(_CONFIGURATION),
            distributed.LocalCluster(
                n_workers=self.count,
                threads_per_worker=1,
                memory_limit=None,
                dashboard_address=None,
                scheduler_kwargs=_STATUS,
                security=True,
                protocol="tls",
                silence_logs=logging.CRITICAL,
                env={"LP_NUM_THREADS": threads},
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client


def draw_block(base: Scene, shots: Sequence[Shot], folder: Path, is_kept: bool) -> tuple[str, ...]:
    """Draw frames in a worker; what the series tells.

    folder  in which names of files begin
    """
    os.chdir(folder)
    key = repr(base), folder, is_kept
    if key not in _OPEN:
        while _OPEN:
            _OPEN.popitem()[1].close()
        _OPEN[key] = Film(base, is_kept)
    film = _OPEN[key]
    for _ in film.write(shots):
        pass
    return film.told


def _written(paths: Sequence[Path], futures: Sequence[Any]) -> Iterator[Path]:
    """Files as they come to be, until all work is done or some of it failed."""
    waiting = list(paths)
    while True:
        is_over = all(future.done() for future in futures) or any(future.status == "error" for future in futures)
        there = {path for path in waiting if path.exists()}
        yield from sorted(there)
        waiting = [path for path in waiting if path not in there]
        if is_over:
            return
        sleep(_LOOK)


def _results(client: Any, futures: Sequence[Any]) -> list[tuple[str, ...]]:
    """What each work gave; ElvisError where a worker was ended."""
    scheduling = require_module("distributed.scheduler", "--workers", "parallel")
    try:
        found: list[tuple[str, ...]] = client.gather(futures)
    except scheduling.KilledWorker as error:
        words = "a worker that drew frames was ended from outside, or for want of memory"
        raise ElvisError(f"{words}: frames that are drawn are kept, the same command goes on from there") from error
    return found
