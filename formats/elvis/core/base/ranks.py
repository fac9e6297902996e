"""The processes that run one command together: a single process, or the ranks of a run under mpiexec.

Five operations are enough: the rank, all results for the first rank (`gather`) or for all ranks (`exchange`), a message
from each rank to each (`alltoall`), and the common exit status (`end`).  Waiting uses no processor time, which ranks
that are still working may need.
"""

from __future__ import annotations

import os
import pickle
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from socket import gethostname
from time import monotonic, sleep
from typing import Any, Protocol, TypeVar

from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.needing import require_module
from elvis.core.base.terminal import remember_told, tell, told_lines

T = TypeVar("T")
#: variables in which launchers give the number of processes: MPICH and Intel MPI, Open MPI, SLURM; with the variable
#: that must also be set if the processes know of each other, since SLURM counts others as well
_SIZES = {"PMI_SIZE": "", "OMPI_COMM_WORLD_SIZE": "", "SLURM_STEP_NUM_TASKS": "PMIX_RANK"}
#: variables that give the number of a process among these, and prefixes of all variables that mark a rank
_NUMBERS, _NAMES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "PMIX_RANK"), ("PMI_", "PMIX_", "OMPI_COMM_WORLD_")
#: seconds between two looks at whether a message is there
_PAUSE = 0.002
#: seconds that rank 0 of a run that fails waits for processes of other ranks, on this machine and on others
_PATIENCE_HERE = 60.0
_PATIENCE_ELSEWHERE = 0.5
#: seconds that other ranks leave to rank 0 to abort a run: all get a Ctrl-C at the same time
_PATIENCE_FIRST = 1.0
#: tags of messages: a rank's result; its last message; the results of all; how rank 0 ended; direct messages; end of
#: messages
_FOUND, _LAST, _ALL, _END, _DIRECT, _CLOSED = 1, 2, 3, 4, 5, 6
#: message for a rank with another task
_OTHER = (
    "expected the data and the task of part 1, found others: processes started together by mpiexec or srun run one "
    "command, so start different commands one by one, or with srun --mpi=none"
)


class Ranks(Protocol):
    """Processes of one run."""

    @property
    def rank(self) -> int:
        """The number of this one; 0 writes."""

    @property
    def size(self) -> int:
        """Number of processes."""

    def gather(self, value: T, task: str) -> list[T]:
        """The results of all ranks, in order, for rank 0; every rank must call this.  Empty on the other ranks.

        task  description of their work
        Raises ElvisError with the part and the reason if a rank has failed, or works on something else.
        """

    def exchange(self, value: T, task: str) -> list[T]:
        """The results of all ranks, in order, for all of them; raises ElvisError also if rank 0 has failed."""

    def alltoall(self, values: Sequence[T | None], task: str) -> list[T | None]:
        """The messages of all ranks to this one, in order; every rank must call this.  None sends no message.

        values  messages of this rank to each rank
        Raises ElvisError as `exchange`.
        """


class Alone:
    """One process."""

    rank, size = 0, 1

    def gather(self, value: T, task: str) -> list[T]:
        """Its own."""
        return [value]

    def exchange(self, value: T, task: str) -> list[T]:
        """Its own."""
        return [value]

    def alltoall(self, values: Sequence[T | None], task: str) -> list[T | None]:
        """Its own."""
        return list(values)

    def end(self, status: int, reason: str) -> int:
        """Its own status."""
        return status

    def abort(self, status: int) -> None:
        """Nothing, as there are no others."""


ALONE = Alone()


def agreed(ranks: Ranks, work: Callable[[], T], task: str) -> T:
    """The result of a rank's own work; raises FormatError on all ranks if the work fails with one on any.

    The error is the first rank's, as with one process; an error of another rank names its part.
    """
    if ranks.size == 1:
        return work()
    error: FormatError | None = None
    try:
        found = work()
    except FormatError as own:
        error = own
    for number, other in enumerate(ranks.exchange(error, task)):
        if other is not None:
            raise FormatError(f"part {number + 1} of {ranks.size}: {other}") if number else other
    return found


def of_first(ranks: Ranks, work: Callable[[], T], task: str) -> T:
    """The result of the first rank's work, for all ranks."""
    made = [] if ranks.rank else [work()]
    return ranks.exchange(made, task)[0][0]


class Turns:
    """Pieces of work that ranks take in turn, in the order in which one process would do them."""

    def __init__(self, ranks: Ranks) -> None:
        self._ranks, self._count = ranks, 0

    def of(self, pieces: Iterable[T]) -> Iterator[T]:
        """The pieces that this rank has to process."""
        for piece in pieces:
            number, self._count = self._count, self._count + 1
            if number % self._ranks.size == self._ranks.rank:
                yield piece


class MpiRanks:
    """The ranks of COMM_WORLD."""

    def __init__(self, communicator: Any) -> None:
        self._world = communicator
        self.rank, self.size = communicator.Get_rank(), communicator.Get_size()
        self._ended: set[int] = set()  # ranks that have sent their last message
        self._status: int | None = None  # how the run ended, where that is known
        self._notes: dict[int, list[tuple[str, str]]] = {}  # what other ranks noted, for rank 0
        self._processes: list[tuple[str, int]] = []  # hosts and numbers of processes of other ranks, for rank 0
        self._sent: list[Any] = []  # messages to others that are on their way

    def gather(self, value: T, task: str) -> list[T]:
        """See Ranks."""
        if self.rank:
            self._send((value, task), 0, _FOUND)
            return []
        every = [(value, task), *(self._received(rank, _FOUND) for rank in range(1, self.size))]
        others = [number for number, (_, own) in enumerate(every) if own != task]
        if others:
            raise ElvisError(f"part {others[0] + 1} of {self.size}: {_OTHER}")
        return [found for found, _ in every]

    def exchange(self, value: T, task: str) -> list[T]:
        """See Ranks."""
        found = self.gather(value, task)
        for rank in range(1, self.size if not self.rank else 0):
            self._send(found, rank, _ALL)
        return list(self._received(0, _ALL)) if self.rank else found

    def alltoall(self, values: Sequence[T | None], task: str) -> list[T | None]:
        """See Ranks.

        All messages are pickled before the ranks exchange which of them exist, so none waits for a rank that fails to
        pickle.
        """
        packed = [None if value is None else pickle.dumps(value, pickle.HIGHEST_PROTOCOL) for value in values]
        has_any = self.exchange([own is not None for own in packed], task)
        for shift in range(1, self.size):
            to = (self.rank + shift) % self.size
            if packed[to] is not None:
                self._sent.append(self._world.isend(packed[to], dest=to, tag=_DIRECT))
                packed[to] = None
        for source in range(self.size):
            if source != self.rank and has_any[source][self.rank]:
                packed[source] = self._received(source, _DIRECT)
        while self._sent:
            if not self._sent[-1].test()[0]:
                self._wait()
                continue
            self._sent.pop()
        return [None if own is None else pickle.loads(own) for own in packed]

    def end(self, status: int, reason: str) -> int:
        """The exit status of this process: the status of the run at rank 0, 0 elsewhere.

        Rank 0 prints what the others noted, and fails if any rank has failed.  A launcher kills the remaining processes
        once one fails, so rank 0 fails after all others have ended.

        status, reason  result of this rank's work; except at rank 0, only the reason counts
        """
        if self.rank:
            self._send((reason, told_lines(), (gethostname(), os.getpid())), 0, _LAST)
            while self._status is None:
                with suppress(ElvisError):
                    self._wait()
        else:
            self._status = self._end_of_others(status)
        self._close()
        if self.rank:
            return 0
        if self._status:
            self._outlive_others()
        return self._status

    def _end_of_others(self, status: int) -> int:
        """Report to the other ranks how this one ended, wait for their last messages and print them.

        Return the status of the run.
        """
        failures: list[str] = []
        for rank in range(1, self.size):
            self._send(status, rank, _END)
        while len(self._ended) < self.size - 1:
            # results that they sent meanwhile are no longer needed
            for rank in range(1, self.size):
                self._next(rank, _FOUND)
            try:
                self._wait()
            except ElvisError as error:
                failures.append(str(error))
        self._tell_notes()
        if status or not failures:
            return status
        tell("error", failures[0])
        return 1

    def _close(self) -> None:
        """Receive the unclaimed messages: if one is left, MPI_Finalize fails, and MPICH's launcher kills all.

        Messages of one rank to another are matched in the order in which they were sent (MPI 4.1, section 3.5), so
        none comes after the last.
        """
        from mpi4py import MPI

        status = MPI.Status()
        others = [rank for rank in range(self.size) if rank != self.rank]
        self._sent.extend(self._world.isend(None, dest=rank, tag=_CLOSED) for rank in others)
        while others or self._sent:
            for rank in list(others):
                message = self._world.improbe(source=rank, status=status)
                if message is None:
                    continue
                message.recv()
                if status.Get_tag() == _CLOSED:
                    others.remove(rank)
            self._sent = [request for request in self._sent if not request.test()[0]]
            sleep(_PAUSE)

    def _tell_notes(self) -> None:
        """Print what other ranks noted and this one did not, each sentence once."""
        known = {sentence for _, sentence in told_lines()}
        for rank, lines in sorted(self._notes.items()):
            for kind, sentence in lines:
                if sentence not in known:
                    known.add(sentence)
                    tell(kind, f"part {rank + 1} of {self.size}: {sentence}")

    def _outlive_others(self) -> None:
        """Wait a few seconds until the visible processes of the other ranks have ended."""
        from mpi4py import MPI

        with suppress(MPI.Exception):  # for messages that no one receives
            MPI.Finalize()  # the others wait for this one there
        own = [process for host, process in self._processes if host == gethostname() and os.name == "posix"]
        sleep(_PATIENCE_ELSEWHERE if len(own) < len(self._processes) else 0)
        until = monotonic() + _PATIENCE_HERE
        while any(map(_is_running, own)) and monotonic() < until:
            sleep(_PAUSE)

    def abort(self, status: int) -> None:
        """End all at once; rank 0 first, if it also does, as it alone prints why."""
        sleep(_PATIENCE_FIRST if self.rank else 0)
        self._world.Abort(status)

    def _send(self, value: object, to: int, tag: int) -> None:
        request = self._world.isend(value, dest=to, tag=tag)
        while not request.test()[0]:
            sleep(_PAUSE)

    def _next(self, source: int, tag: int) -> Any:
        """The next message with the tag, or None."""
        message = self._world.improbe(source=source, tag=tag)
        return None if message is None else message.recv()

    def _received(self, source: int, tag: int) -> Any:
        """The next message with the tag."""
        while (found := self._next(source, tag)) is None:
            if source in self._ended:
                raise ElvisError(f"part {source + 1} of {self.size}: {_OTHER}")
            self._wait()
        return found

    def _wait(self) -> None:
        """Wait a little; raises ElvisError if the run has ended, or, for rank 0, if another one has failed."""
        if self.rank and (status := self._next(0, _END)) is not None:
            self._status = int(status)
            raise ElvisError(f"part 1 of {self.size} has ended")
        for rank in range(1, self.size if not self.rank else 0):
            last = None if rank in self._ended else self._next(rank, _LAST)
            if last is None:
                continue
            reason, self._notes[rank], process = last
            self._ended.add(rank)
            self._processes.append(process)
            if reason:
                raise ElvisError(f"part {rank + 1} of {self.size}: {reason}")
        sleep(_PAUSE)


def started_together(environment: Mapping[str, str] = os.environ) -> int:
    """Number of processes that mpiexec or srun has started together with this one.

    1 without, and for what one of these starts.
    """
    channel = environment.get("PMI_FD", "")
    if channel.isdigit() and not _is_open(int(channel)):
        return 1
    known = (name for name, beside in _SIZES.items() if not beside or beside in environment)
    sizes = [environment[name] for name in known if environment.get(name, "").isdigit()]
    return int(sizes[0]) if sizes else 1


def number_of_process(environment: Mapping[str, str] = os.environ) -> int:
    """The number of this process among those `started_together`, from the environment.

    0 if the environment has none.
    """
    if started_together(environment) < 2:
        return 0
    numbers = [environment[name] for name in _NUMBERS if environment.get(name, "").isdigit()]
    return int(numbers[0]) if numbers else 0


def _is_running(process: int) -> bool:
    """Whether a process with this number exists on this machine and has not ended yet.

    If a launcher collects ended processes only when it ends itself, they stay in the system's table until then.
    """
    try:
        os.kill(process, 0)
    except OSError:
        return False
    try:
        state = (
            Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[0]
        )
    except (OSError, IndexError):
        return True  # not on Linux
    return state not in "ZX"


def _is_open(number: int) -> bool:
    """Whether a file is open under a number: the channel to MPICH's starter is not, in processes that a rank starts."""
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def is_idle(ranks: Ranks) -> bool:
    """Whether a rank has nothing to do, as the first one does all.

    Raises ElvisError if one has another command line.
    """
    ranks.gather(None, shlex.join(sys.argv[1:]))
    return ranks.rank > 0


def ranks_of_run() -> Alone | MpiRanks:
    """The ranks of the run that this process belongs to; they must `end` together.

    All ranks but the first are silent from now on.

    Processes that they start are not ranks: the variables that mark ranks are removed from their environment.
    """
    count = started_together()
    if count < 2:
        return ALONE
    if number_of_process():
        _be_silent()
    remember_told()
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
