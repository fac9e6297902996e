"""Ranks of one process, in threads that work one at a time: what one has, others get as a message would bring it."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, BrokenBarrierError, Lock
from typing import Any, TypeVar

T = TypeVar("T")


class PlayedRanks:
    """One of them; see `Ranks`.

    sent  bytes that this one has sent to each rank, and how many messages these were
    """

    def __init__(self, rank: int, run: _Run) -> None:
        self.rank, self.size, self._run = rank, run.size, run
        self.sent = [0] * self.size
        self.messages = 0

    def gather(self, value: T, task: str) -> list[T]:
        """See Ranks."""
        every = self._run.meet(self.rank, pickle.dumps(value), task)
        if self.rank:
            self._count(0, every[self.rank])
        return [] if self.rank else [pickle.loads(own) for own in every]

    def exchange(self, value: T, task: str) -> list[T]:
        """See Ranks."""
        every = self._run.meet(self.rank, pickle.dumps(value), task)
        found = [pickle.loads(own) for own in every]
        if self.rank:
            self._count(0, every[self.rank])
        for to in range(1, self.size if not self.rank else 0):
            self._count(to, pickle.dumps(found))
        return found

    def alltoall(self, values: Sequence[T | None], task: str) -> list[T | None]:
        """See Ranks."""
        self.exchange([value is not None for value in values], task)
        packed = [None if value is None else pickle.dumps(value) for value in values]
        for to, own in enumerate(packed):
            if own is not None and to != self.rank:
                self._count(to, own)
        every = self._run.meet(self.rank, packed, task)
        found = [own[self.rank] for own in every]
        return [None if own is None else pickle.loads(own) for own in found]

    def _count(self, to: int, message: bytes) -> None:
        self.sent[to] += len(message)
        self.messages += 1


class _Run:
    """State that the ranks share."""

    def __init__(self, size: int) -> None:
        self.size, self.turn, self._barrier = size, Lock(), Barrier(size)
        self._found: list[Any] = [None] * size

    def meet(self, rank: int, value: Any, task: str) -> list[Any]:
        """The values of all ranks, once they have arrived here with the same task."""
        self._found[rank] = value, task
        self._wait()
        every = list(self._found)
        self._wait()
        assert {own for _, own in every} == {task}
        return [found for found, _ in every]

    def do(self, rank: int, work: Callable[[PlayedRanks], T]) -> T:
        """Its work, in its turn."""
        with self.turn:
            try:
                return work(PlayedRanks(rank, self))
            except BaseException:
                self._barrier.abort()
                raise

    def _wait(self) -> None:
        self.turn.release()
        try:
            self._barrier.wait()
        finally:
            self.turn.acquire()


def played(size: int, work: Callable[[PlayedRanks], T]) -> list[T]:
    """The results of several ranks that work together; raises the error of the first rank that fails."""
    run = _Run(size)
    with ThreadPoolExecutor(size) as threads:
        futures = [threads.submit(run.do, rank, work) for rank in range(size)]
    errors = [future.exception() for future in futures]
    for error in errors:
        if error is not None and not isinstance(error, BrokenBarrierError):
            raise error
    return [future.result() for future in futures]
