"""Frames drawn by several processes at once.

Each worker opens the data once and draws frames that follow one another, so that it reads the next step while it draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from time import sleep
from typing import Any, TypeVar

from elvis.plugins.command.workers import Workers, at_rest, begun, results
from elvis.renderer.device.kernels.cache import is_any_kept
from elvis.renderer.film.animation import Film, Shot
from elvis.scene import Camera, Scene

T = TypeVar("T")
#: seconds between checks for finished work
_LOOK = 0.1
#: advice after a worker was killed
_KEPT = "finished frames remain; run the same command to continue"
#: the animation that a worker draws, by its arguments
_OPEN: dict[object, Film] = {}


class Team:
    """Workers that draw an animation; they start when they are first needed, or on request.

    base     the scene with which the animation is opened
    is_kept  whether conversions are cached
    """

    def __init__(self, workers: Workers, base: Scene, is_kept: bool) -> None:
        self._workers, self._base, self._is_kept = workers, base, is_kept
        self._until_end, self._starter = ExitStack(), ThreadPoolExecutor(1, "elvis-workers")
        self._client: Future[Any] | None = None
        self._opening: list[Any] = []
        self._has_kernels = is_any_kept()

    def __enter__(self) -> Team:
        return self

    def __exit__(self, *_: Any) -> None:
        # Dask wants its clients closed where they were opened
        with self._starter:
            self._starter.submit(self._until_end.close).result()

    def begin(self) -> None:
        """Let workers start while something else goes on here; a scheduler's have started."""
        if not self._workers.scheduler:
            self._workers.prepare(__name__)
            self._start()

    def first_camera(self, scenes: Sequence[Scene]) -> Camera:
        """The camera of the first scene whose step can be read.

        All workers find it, since all need its inputs; only the first if kernels must be compiled.
        """
        camera: Camera = self._of_opening(camera_of_first, self._base, scenes, self._is_kept)
        return camera

    def open(self) -> None:
        """Let workers read the data, unless they have; raises what reading raises."""
        if not self._opening:
            self._of_opening(open_film, self._base, self._is_kept)

    def _of_opening(self, work: Callable[..., Any], *piece: Any) -> Any:
        """The first worker's result while all of them open the animation."""
        client = self._connected()
        count = self._workers.number(client) if self._has_kernels else 1
        self._opening = begun(client, work, [piece] * count)
        return results(client, self._opening[:1], _KEPT)[0]

    def write(self, shots: Sequence[Shot], told: list[str]) -> Iterator[Path]:
        """Draw frames; yields their files as they are finished.

        told  receives the remarks of the series

        Raises the errors of drawing, and ElvisError if a worker was killed.
        """
        client = self._connected()
        if not self._has_kernels:
            # kernels are compiled for the first frame, others find them
            yield from self._drawn(client, [shots[:1]], told)
            shots = shots[1:]
        yield from self._drawn(client, blocks(shots, self._workers.number(client)), told)
        client.run(at_rest, close_films)

    def _drawn(self, client: Any, blocks: Iterable[Sequence[Shot]], told: list[str]) -> Iterator[Path]:
        works = [(self._base, block, self._is_kept) for block in blocks]
        futures = begun(client, draw_block, works)
        yield from _written([path for _, block, _ in works for _, path in block], futures)
        told += [sentence for own in results(client, futures, _KEPT) for sentence in own]

    def _connected(self) -> Any:
        return self._start().result()

    def _start(self) -> Future[Any]:
        if self._client is None:
            self._client = self._starter.submit(self._until_end.enter_context, self._workers.client())
        return self._client


def blocks(shots: Sequence[T], workers: int) -> Iterator[Sequence[T]]:
    """Blocks of successive frames: each time a share of the remaining ones, so that all workers finish together.

    Polychronopoulos & Kuck, Guided self-scheduling, IEEE Transactions on Computers 36, 1987.
    """
    first = 0
    while first < len(shots):
        count = max(1, (len(shots) - first) // (2 * workers))
        yield shots[first : first + count]
        first += count


def draw_block(base: Scene, shots: Sequence[Shot], is_kept: bool) -> tuple[str, ...]:
    """Draw frames in a worker; returns the remarks of the series."""
    film = _film(base, is_kept)
    for _ in film.write(shots):
        pass
    return film.told


def camera_of_first(base: Scene, scenes: Sequence[Scene], is_kept: bool) -> Camera:
    """The camera of the first scene whose step can be read, found in a worker."""
    return _film(base, is_kept).first_camera(scenes)


def open_film(base: Scene, is_kept: bool) -> None:
    """Read the data of an animation in a worker."""
    _film(base, is_kept).open()


def _film(base: Scene, is_kept: bool) -> Film:
    """The animation of this worker, which is opened once."""
    key = repr(base), Path.cwd(), is_kept
    if key not in _OPEN:
        close_films()
        _OPEN[key] = Film(base, is_kept)
    return _OPEN[key]


def close_films() -> None:
    """Close the animations of this worker.

    A process that ends with an open device may leave its memory to a thread of Mesa's, which runs when all others rest.
    """
    while _OPEN:
        _OPEN.popitem()[1].close()


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
