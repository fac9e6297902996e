"""A worker: a forked process that damages files and reads them, case by case, and tells what came of each.

Cases are deterministic: the generator of random numbers of a case is made of the seed, the reader and its number.
"""

import json
import os
import resource
import shutil
import signal
import time
import traceback
import warnings
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

import mutations
import numpy as np
import reading

#: seconds of the processor that a case may take (or twice those of the sound files), and those that end the process
SECONDS, PATIENCE = 5.0, 20.0

#: kilobytes that an interpreter with the project's libraries takes, whatever is read
INTERPRETER = 40 << 10

#: kilobytes that a reader may take, and kilobytes for each one of the files
BASE, PER_BYTE = 300 << 10, 20

#: bytes of address space that cases may take beyond what the process has
ROOM = 6 << 30

#: seconds between two looks at the memory of libraries' processes
PERIOD = 0.005

#: bytes about which a file is as likely to be chosen as an empty one
LIGHT = 20_000


class Worker:
    """Runs cases of one reader; ``tell`` sends a dictionary to whoever watches."""

    def __init__(self, subjects, seed, folder, tell, known, kept):
        self.subjects, self.seed, self.folder, self.tell, self.kept = subjects, seed, folder, tell, kept
        self.baselines = dict(known)
        weights = np.array([(each.size + LIGHT) ** -1.5 for each in subjects])
        self.shares = weights / weights.sum()

    def run(self, numbers):
        """Cases of these numbers."""
        _bound()
        for number in numbers:
            self.case(number)

    def case(self, number):
        """One case, from its damage to its outcome."""
        reader = self.subjects[0].reader
        random = np.random.default_rng([self.seed, number, *reader.encode()])
        which = int(random.choice(len(self.subjects), p=self.shares))
        subject = self.subjects[which]
        action = subject.actions[int(random.integers(0, len(subject.actions)))]
        memory, seconds = self._baseline(which, action)
        paths = self._copies(subject)
        target = paths[int(random.integers(0, len(paths)))]
        self.tell({"case": number, "state": "damaging", "subject": subject.name, "file": target.name, "action": action})
        damage = mutations.damage(target, random)
        self.tell({"case": number, "state": "reading", "damage": damage})
        size = sum(path.stat().st_size for path in paths)
        outcome = self._measure(action, paths)
        total = INTERPRETER + outcome["memory"]
        outcome["ratio"] = round(total / (INTERPRETER + memory), 3)
        if outcome["kind"] in ("read", "refused"):
            is_slow = outcome["seconds"] > max(SECONDS, 2 * seconds)
            is_large = outcome["ratio"] > 2 or total > BASE + PER_BYTE * size // 1024
            outcome["kind"] = "slow" if is_slow else "large" if is_large else outcome["kind"]
        if outcome["kind"] not in ("read", "refused"):
            keep(self.kept, reader, outcome["kind"], number, self.folder)
        self.tell({"case": number, "state": "done", **outcome})

    def _baseline(self, which, action):
        """Kilobytes and seconds that the sound files take, measured the second time that they are read."""
        key = f"{which} {action}"
        if key not in self.baselines:
            paths = self._copies(self.subjects[which])
            self._measure(action, paths)
            found = self._measure(action, paths)
            self.baselines[key] = found["memory"], found["seconds"]
            self.tell({"state": "baseline", "key": key, "name": self.subjects[which].name, "action": action, **found})
        return self.baselines[key]

    def _copies(self, subject):
        for path in self.folder.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        return [Path(shutil.copyfile(path, self.folder / path.name)) for path in subject.files]

    def _measure(self, action, paths):
        """What came of an action, with processor time and memory."""
        before = _resident()
        _forget_peak()
        start = _seconds()
        with Below() as below:
            kind, message = outcome_of(action, paths)
            seconds = _seconds() - start
        memory = max(0, _peak() - before) + below.grown
        return {"kind": kind, "message": message, "seconds": round(seconds, 3), "memory": memory}


class Below:
    """Memory of the processes below this one while a block runs: libraries read files in processes of their own.

    grown  kilobytes that they took at most beyond what they, or the processes they are copies of, had before
    """

    def __init__(self):
        self.grown = 0
        self._before = dict(_resident_below(os.getpid()))
        self._is_over = Event()
        self._thread = Thread(target=self._watch, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._is_over.set()
        self._thread.join()

    def _watch(self):
        while not self._is_over.wait(PERIOD):
            self.grown = max(self.grown, self._now(os.getpid(), 0))

    def _now(self, process, above):
        """Growth of the processes below one; new ones are copies of it, and have its memory ``above`` at first."""
        total = 0
        for child in _children(process):
            base = self._before.get(child, above)
            total += max(0, _peak(child) - base) if base else 0
            total += self._now(child, base)
        return total


def keep(kept, reader, kind, number, folder):
    """Copy the damaged files of a case."""
    target = kept / f"{reader}-{kind}-{number}".replace(" ", "_")
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(folder, target)


def outcome_of(action, paths):
    """``read``, ``refused`` with the sentence, or ``traceback`` with its last lines."""
    from elvis import ElvisError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            getattr(reading, action)(paths)
    except ElvisError as error:
        sentence = str(error)
        good = "\n" not in sentence and 10 < len(sentence) < 2000 and "Traceback" not in sentence
        return ("refused", sentence[:300]) if good else ("no sentence", sentence[:2000])
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        own = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)]
        return "traceback", f"{type(error).__name__}: {str(error)[:200]} at {' < '.join(own[:-7:-1])}"
    return "read", ""


def serve(subjects, seed, folder, numbers, stream, known, kept):
    """The worker's life in a forked process: told things go to a pipe as lines of JSON."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nothing, descriptor)
    signal.signal(signal.SIGINT, signal.SIG_DFL)

    def tell(found):
        os.write(stream, json.dumps(found).encode() + b"\n")

    try:
        Worker(subjects, seed, folder, tell, known, kept).run(numbers)
    except BaseException as error:
        tell({"state": "harness", "message": "".join(traceback.format_exception(error))})
        os._exit(3)
    os._exit(0)


def _bound():
    """Limit the address space of this process."""
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, taken + 2 * ROOM))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _seconds():
    """Seconds of the processor of this process and of all that it started; the clock that ends hangs starts again."""
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    own = os.times()
    return time.process_time() + own.children_user + own.children_system + _seconds_below(os.getpid())


def _children(process):
    """Processes that the main thread of a process has started; none if it has ended."""
    try:
        return Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except (FileNotFoundError, ProcessLookupError):
        return []


def _resident_below(process):
    """The processes below one, and their kilobytes."""
    for child in _children(process):
        yield child, _resident(child)
        yield from _resident_below(child)


def _seconds_below(process):
    """Seconds of a process's children that nobody has waited for, theirs included: libraries' processes and copies."""
    total = 0.0
    for child in _children(process):
        with suppress(FileNotFoundError, ProcessLookupError):
            # columns 14 to 17 are ticks, of it and of those it waited for; the second, in parentheses, is its name
            columns = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
            total += sum(map(int, columns[11:15])) / os.sysconf("SC_CLK_TCK") + _seconds_below(child)
    return total


def _resident(process="self"):
    """Kilobytes of a process, 0 if it has ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize() // 1024
    return 0


def _forget_peak():
    Path("/proc/self/clear_refs").write_text("5")


def _peak(process="self"):
    """Largest kilobytes of a process so far, 0 if it has ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        status = Path(f"/proc/{process}/status").read_text().splitlines()
        return next((int(line.split()[1]) for line in status if line.startswith("VmHWM")), 0)
    return 0
