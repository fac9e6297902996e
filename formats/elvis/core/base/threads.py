"""Work that threads share, where NumPy lets them: what comes of it is the same in any number of threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from itertools import chain, islice
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

T = TypeVar("T")
#: jobs that are at work at once
_AT_ONCE = 2


def results(jobs: Iterable[Callable[[], T]]) -> Iterator[T]:
    """The results of jobs, in their order; the next jobs run meanwhile, and the calling thread creates them.

    The first exception of a job, in their order, is raised here.  A single job runs in the calling thread.
    """
    remaining = iter(jobs)
    first = list(islice(remaining, 2))
    if len(first) < 2:
        yield from (copy_context().run(job) for job in first)
        return
    from concurrent.futures import ThreadPoolExecutor

    waiting: deque[Future[T]] = deque()
    with ThreadPoolExecutor(_AT_ONCE, "elvis-work") as pool:
        for job in chain(first, remaining):
            waiting.append(pool.submit(copy_context().run, job))
            if len(waiting) > _AT_ONCE:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


class Once(Generic[T]):
    """The result of a job that runs once, in parallel to the first caller."""

    def __init__(self) -> None:
        self._found: tuple[T, ...] = ()

    @contextmanager
    def started(self, job: Callable[[], T]) -> Iterator[Callable[[], T]]:
        """A function that waits for the result of a job, which runs in the block.

        No thread is started if the job has already run.

        The function raises the job's exception.
        """
        if self._found:
            yield lambda: self._found[0]
            return
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(1, "elvis-work") as pool:
            waiting = pool.submit(copy_context().run, job)
            yield waiting.result
            if waiting.exception() is None:
                self._found = (waiting.result(),)
