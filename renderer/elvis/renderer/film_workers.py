"""Frames drawn by several processes at once.

Each worker opens the data once and draws frames that follow one another, so that it reads the next step while it draws.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np

from elvis.plugins.workers import Workers, begun, results
from elvis.renderer.animation import Film, Shot
from elvis.scene import Scene

#: blocks of frames for each worker, so that all end at about one time
_BLOCKS = 4
#: seconds between looks at what is done
_LOOK = 0.1
#: what is left where a worker was ended
_KEPT = "frames that are drawn are kept, the same command goes on from there"
#: the film that a worker draws, by what it was opened with
_OPEN: dict[object, Film] = {}


def draw_by(workers: Workers, base: Scene, shots: Sequence[Shot], is_kept: bool, told: list[str]) -> Iterator[Path]:
    """Draw frames of a film; their files, as they come to be.

    base     the scene that the film was opened with
    is_kept  whether conversions are kept
    told     gets what the series tells of its steps

    Raises what drawing raises, and ElvisError where a worker was ended.
    """
    with workers.client() as client:
        blocks = np.array_split(np.arange(len(shots)), _BLOCKS * workers.number(client))
        works = [(base, [shots[number] for number in block.tolist()], is_kept) for block in blocks if len(block)]
        futures = begun(client, draw_block, works)
        yield from _written([path for _, path in shots], futures)
        told += [sentence for own in results(client, futures, _KEPT) for sentence in own]


def draw_block(base: Scene, shots: Sequence[Shot], is_kept: bool) -> tuple[str, ...]:
    """Draw frames in a worker; what the series tells."""
    key = repr(base), Path.cwd(), is_kept
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
