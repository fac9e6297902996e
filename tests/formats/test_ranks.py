"""Work that ranks share comes to what one process finds: norms and points to the bit, integrals to their errors."""

import sys

import pytest

from elvis.core.integrals import integrate
from elvis.core.norms import norms, quantity_norms
from elvis.core.quantities import Expression
from elvis.core.ranks import Turns, started_together
from elvis.core.testing import approximated, curved, mixed_volume, ripple
from elvis.core.testing.played_ranks import played
from elvis.formats import Dataset, write

TARGETS = (
    "domain",
    "all",
    "plane:0.1,0.2,0.3:1,0.3,0.2",
    "sphere:0.5,0.5,0.5:0.3",
    "u=0.2",
    "line:0.1,0.1,0.1:0.8,0.7,0.9",
)


def shared(size, work):
    """What the first rank makes of work that all take part in."""
    first, *others = played(size, work)
    assert not any(map(len, others))
    return first


@pytest.fixture(scope="module")
def bent():
    """All shapes, bent, with a field."""
    mesh = curved(mixed_volume(), ripple(0.05), 3)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: p[:, 0] - p[:, 1] * p[:, 2] ** 2, 4),))


@pytest.mark.parametrize(
    ("environment", "count"),
    [
        ({}, 1),
        ({"PMI_SIZE": "3"}, 3),
        ({"PMI_SIZE": "3", "PMI_FD": "9999"}, 1),
        ({"OMPI_COMM_WORLD_SIZE": "4"}, 4),
        ({"SLURM_STEP_NUM_TASKS": "5", "PMIX_RANK": "0"}, 5),
        ({"SLURM_STEP_NUM_TASKS": "5"}, 1),
    ],
)
def test_processes_that_know_of_each_other_are_counted(environment, count):
    assert started_together(environment) == count


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("size", [1, 2, 5])
def test_every_piece_has_one_turn(count, size):
    pieces = "abcdefg"[:count]
    taken = played(size, lambda ranks: list(Turns(ranks).of(pieces)))
    assert sorted(pair for own in taken for pair in own) == list(enumerate(pieces))
    assert max(map(len, taken)) - min(map(len, taken)) <= 1


@pytest.mark.parametrize("size", [2, 3, 8])
def test_norms_are_the_same_to_the_bit(bent, size, monkeypatch):
    monkeypatch.setattr("elvis.core.norms._BATCH", 12 * 200)
    assert shared(size, lambda ranks: norms(bent, ranks)) == norms(bent)
    wanted = [Expression.of(bent, text) for text in ("u", "d(u,x)/(2+u)")]
    assert shared(size, lambda ranks: quantity_norms(bent, wanted, ranks)) == quantity_norms(bent, wanted)


def test_integrals_differ_by_their_errors(bent):
    fields = ("u", "sin(3*u)", "average(u*u)")
    alone = integrate(bent, fields, TARGETS, 1e-8)
    found = shared(3, lambda ranks: integrate(bent, fields, TARGETS, 1e-8, ranks=ranks))
    for one, other in zip(alone, found, strict=True):
        assert (one.over, one.integrand, one.exact) == (other.over, other.integrand, other.exact)
        assert abs(one.value - other.value) <= one.error + other.error + 1e-14 * abs(one.value)
        assert other.measure == pytest.approx(one.measure, rel=1e-12 if one.exact else 1e-7)


def test_what_is_clipped_is_shared(bent):
    clip = "sphere:0.5,0.5,0.5:0.3"
    alone = integrate(bent, "u", error=1e-5, clip=clip)
    found = shared(2, lambda ranks: integrate(bent, "u", error=1e-5, clip=clip, ranks=ranks))
    assert abs(alone.value - found.value) <= alone[0].error + found[0].error


@pytest.fixture(scope="module")
def files(bent, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ranks")
    write(bent, folder / "bent.xml", folder / "bent.fld")
    return folder


@pytest.mark.parametrize(
    "words",
    [
        ("norms", "--json"),
        ("probe", "--line", "0,0,0:1,1,1", "-n", "5", "--all"),
        ("integrate", "--field", "1"),
        ("info",),
    ],
    ids=lambda words: words[0],
)
def test_a_table_is_printed_once_and_is_that_of_one_process(files, started, words):
    command = (words[0], "bent.xml", "bent.fld", *words[1:])
    alone, ranks = started.alone(files, *command), started.ranks(files, (2, *command))
    assert (ranks.returncode, ranks.stderr) == (0, alone.stderr)
    if words[0] == "integrate":
        assert float(ranks.stdout.split()[-3]) == pytest.approx(float(alone.stdout.split()[-3]), rel=1e-14)
    else:
        assert ranks.stdout == alone.stdout


@pytest.mark.parametrize(
    ("words", "status"), [("integrate bent.xml", 2), ("convert --wrong", 2), ("info none.xml", 1)], ids=str
)
def test_what_is_wrong_is_told_once(files, started, words, status):
    ranks = started.ranks(files, (3, *words.split()))
    assert (ranks.returncode, ranks.stdout) == (status, "")
    (sentence,) = ranks.stderr.splitlines()
    assert sentence.startswith("elvis: error: ")


def test_ranks_with_commands_of_their_own_are_told(files, started):
    one, other = (("convert", "bent.xml", "bent.fld", "-o", name) for name in ("none1.xml", "none2.xml"))
    ranks = started.ranks(files, (1, *one), (1, *other))
    assert ranks.returncode == 1
    assert ranks.stderr.startswith("elvis: error: part 2 of 2: expected the data and the task of part 1, found others")
    assert not [path for path in files.iterdir() if "none" in path.name]


def test_what_a_rank_starts_is_none(started, tmp_path):
    """Though it takes over the channel to the starter, which MPICH closes, Open MPI keeps open."""
    count = "from elvis.core.ranks import started_together; print(started_together())"
    start = (
        "import os, subprocess, sys; from elvis.core.ranks import ranks_of_run; channel = int(os.environ['PMI_FD']);"
        f"ranks_of_run(); subprocess.run([sys.executable, '-c', {count!r}], pass_fds=[channel], check=True)"
    )
    ranks = started.processes(tmp_path, (2, sys.executable, "-c", start))
    assert (ranks.returncode, ranks.stdout, ranks.stderr) == (0, "1\n1\n", "")


#: a rank that sends each other one what is large enough not to be there before it is asked for
SENDS = """
import os, numpy as np
from elvis.core.errors import ElvisError
from elvis.core.ranks import ranks_of_run

ranks = ranks_of_run()
values = [np.full(1 << 20, 10 * ranks.rank + to) if (ranks.rank + to) % 2 else None for to in range(ranks.size)]
status, reason = 0, ""
try:
    {fault}
    found = ranks.alltoall(values, "numbers")
    told = ranks.gather([None if own is None else int(own.min()) for own in found], "what they got")
    if not ranks.rank:
        print(told)
except Exception as error:
    status, reason = 1, str(error)
    if not ranks.rank:
        print(reason)
raise SystemExit(ranks.end(status, reason))
"""


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("pass", "[[None, 10, None], [1, None, 21], [None, 12, None]]"),
        ("if ranks.rank == 1: raise ElvisError('there is none')", "part 2 of 3: there is none"),
        ("if ranks.rank == 2: values[1] = lambda: 0", "part 3 of 3: Can't "),
    ],
    ids=["none", "before", "while messages are made"],
)
def test_each_rank_gets_what_the_others_have_for_it(started, tmp_path, fault, told):
    ranks = started.processes(tmp_path, (3, sys.executable, "-c", SENDS.format(fault=fault)))
    assert (ranks.returncode, ranks.stderr) == (int(fault != "pass"), "")
    assert ranks.stdout.startswith(told)


def test_a_rank_that_is_killed_among_messages_ends_all(started, tmp_path):
    """It has told that it has its messages, and sends none."""
    fault = "ranks._world = Killed(ranks._world) if ranks.rank == 1 else ranks._world"
    killed = """
class Killed:
    def __init__(self, world): self._world = world
    def __getattr__(self, name): return getattr(self._world, name)
    def isend(self, value, dest, tag):
        if tag == 5: os.kill(os.getpid(), 9)
        return self._world.isend(value, dest=dest, tag=tag)
"""
    ranks = started.processes(tmp_path, (3, sys.executable, "-c", killed + SENDS.format(fault=fault)))
    assert ranks.returncode != 0
    assert "[[None" not in ranks.stdout
