"""The processes that run one command together: alone, or the ranks of a run under mpiexec.

Four operations are enough: who am I, what have all found, for the first one (`gather`) or for all (`exchange`), how
did it end (`end`).  Waiting takes no processor time, which those that are not done yet may need.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterable, Iterator, Mapping
from time import sleep
from typing import Any, Protocol, TypeVar

from elvis.core.errors import ElvisError
from elvis.core.needing import require_module

T = TypeVar("T")
#: variables in which starters of processes say their number: of MPICH and Intel MPI, Open MPI, SLURM; what stands
#: beside it where the processes know of each other, as SLURM counts others, too
_SIZES = {"PMI_SIZE": "", "OMPI_COMM_WORLD_SIZE": "", "SLURM_STEP_NUM_TASKS": "PMIX_RANK"}
#: those in which they say which one of them a process is, and how all begin by which one takes itself for a rank
_NUMBERS, _NAMES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "PMIX_RANK"), ("PMI_", "PMIX_", "OMPI_COMM_WORLD_")
#: seconds between two looks at whether a message is there
_PAUSE = 0.002
#: tags of messages: what a rank has found; its last word; what all have found; how the run ended
_FOUND, _LAST, _ALL, _END = 1, 2, 3, 4
#: what is wrong with a rank that has another task
_OTHER = (
    "expected the data and the task of part 1, found others: what mpiexec or srun starts together runs one command, "
    "so start processes with their own one by one, or with srun --mpi=none"
)


class Ranks(Protocol):
    """Processes of one run."""

    @property
    def rank(self) -> int:
        """The number of this one; 0 writes."""

    @property
    def size(self) -> int:
        """How many there are."""

    def gather(self, value: T, task: str) -> list[T]:
        """What all have found, in order, for rank 0; to be called by each.  Elsewhere it is empty.

        task  what they work at
        ElvisError that names the part and the reason where a rank has failed, or works at something else.
        """

    def exchange(self, value: T, task: str) -> list[T]:
        """The same for all of them; ElvisError where rank 0 has failed, too."""


class Alone:
    """One process."""

    rank, size = 0, 1

    def gather(self, value: T, task: str) -> list[T]:
        """Its own."""
        return [value]

    def exchange(self, value: T, task: str) -> list[T]:
        """Its own."""
        return [value]

    def end(self, status: int, reason: str) -> int:
        """Its own status."""
        return status

    def abort(self, status: int) -> None:
        """Nothing, as there are no others."""


ALONE = Alone()


class Turns:
    """Pieces of work that ranks take in turn, by their numbers in the order in which one process would do them."""

    def __init__(self, ranks: Ranks) -> None:
        self._ranks, self._count = ranks, 0

    def of(self, pieces: Iterable[T]) -> Iterator[tuple[int, T]]:
        """Those of this rank among the next pieces, with their numbers."""
        for piece in pieces:
            number, self._count = self._count, self._count + 1
            if number % self._ranks.size == self._ranks.rank:
                yield number, piece


class MpiRanks:
    """The ranks of COMM_WORLD."""

    def __init__(self, communicator: Any) -> None:
        self._world = communicator
        self.rank, self.size = communicator.Get_rank(), communicator.Get_size()
        self._ended: set[int] = set()  # ranks that have said their last word
        self._status: int | None = None  # how the run ended, where that is known

    def gather(self, value: T, task: str) -> list[T]:
        """See Ranks."""
        if self.rank:
            self._send((value, task, None), 0, _FOUND)
            return []
        every = [(value, task, None), *(self._found(rank) for rank in range(1, self.size))]
        reasons = [reason if reason or own == task else _OTHER for _, own, reason in every]
        failed = [number for number, reason in enumerate(reasons) if reason]
        if failed:
            others = f" ({len(failed)} parts failed)" if len(failed) > 1 else ""
            raise ElvisError(f"part {failed[0] + 1} of {self.size}: {reasons[failed[0]]}{others}")
        return [found for found, _, _ in every]

    def exchange(self, value: T, task: str) -> list[T]:
        """See Ranks."""
        found = self.gather(value, task)
        for rank in range(1, self.size if not self.rank else 0):
            self._send(found, rank, _ALL)
        if not self.rank:
            return found
        tag, every = self._receive(0, _ALL, _END)
        if tag == _END:
            self._status = int(every)
            raise ElvisError(f"part 1 of {self.size} has ended")
        return list(every)

    def end(self, status: int, reason: str) -> int:
        """How the run ended: told by rank 0, and waited for by all others.

        status, reason  how the work of this one ended; elsewhere than at rank 0 the reason counts
        """
        if self.rank:
            self._send((None, None, reason), 0, _LAST)
            return int(self._receive(0, _END)[1]) if self._status is None else self._status
        for rank in range(1, self.size):
            self._send(status, rank, _END)
        for rank in range(1, self.size):
            while rank not in self._ended:
                self._found(rank)
        return status

    def abort(self, status: int) -> None:
        """End all at once."""
        self._world.Abort(status)

    def _found(self, rank: int) -> Any:
        """What a rank has found, or its last word: a value, its task, and a reason where it has failed."""
        tag, found = self._receive(rank, _FOUND, _LAST) if rank not in self._ended else (_LAST, (None, None, ""))
        if tag == _LAST:
            self._ended.add(rank)
        return found

    def _send(self, value: object, to: int, tag: int) -> None:
        request = self._world.isend(value, dest=to, tag=tag)
        while not request.test()[0]:
            sleep(_PAUSE)

    def _receive(self, source: int, *tags: int) -> tuple[int, Any]:
        """The next message with one of the tags, and its tag."""
        while True:
            for tag in tags:
                message = self._world.improbe(source=source, tag=tag)
                if message is not None:
                    return tag, message.recv()
            sleep(_PAUSE)


def started_together(environment: Mapping[str, str] = os.environ) -> int:
    """How many processes mpiexec or srun has started with this one; 1 without, and for what one of these starts."""
    channel = environment.get("PMI_FD", "")
    if channel.isdigit() and not _is_open(int(channel)):
        return 1
    known = (name for name, beside in _SIZES.items() if not beside or beside in environment)
    sizes = [environment[name] for name in known if environment.get(name, "").isdigit()]
    return int(sizes[0]) if sizes else 1


def _is_open(number: int) -> bool:
    """Whether a file is open under a number: the channel to MPICH's starter is not, in processes that a rank starts."""
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def is_idle(ranks: Ranks) -> bool:
    """Whether a rank has nothing to do, as the first one does all; ElvisError where one has another command line."""
    ranks.gather(None, shlex.join(sys.argv[1:]))
    return ranks.rank > 0


def ranks_of_run() -> Alone | MpiRanks:
    """The ranks that this process is one of, which are to `end` together; all but the first are silent from now on.

    What they start themselves is no rank: the variables that make one are taken out of their environment.
    """
    count = started_together()
    if count < 2:
        return ALONE
    if any(os.environ.get(name, "0") != "0" for name in _NUMBERS):
        _be_silent()
    mpi = require_module("mpi4py.MPI", "one command by several processes", "mpi")
    ranks = MpiRanks(mpi.COMM_WORLD)
    if ranks.size < count:
        raise ElvisError(f"expected {count} ranks, found {ranks.size}: mpi4py uses another MPI than what started them")
    for name in [name for name in os.environ if name.startswith(_NAMES)]:
        del os.environ[name]
    return ranks


def _be_silent() -> None:
    """Let messages of this process go nowhere."""
    sys.stdout = sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
