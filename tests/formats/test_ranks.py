"""Work that ranks share comes to what one process finds: norms and points to the bit, integrals to their errors."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import Dataset, write
from elvis.core.base import ranks as ranks_module
from elvis.core.base.exact_sums import parts_of_sum, rounded_sum
from elvis.core.base.ranks import MpiRanks, Turns, started_together
from elvis.core.data.dataset import Block, Field, Homogeneous
from elvis.core.data.mesh import Composite
from elvis.core.integrals import comes_apart, integrate
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location
from elvis.core.numbers.norms import norms, quantity_norms
from elvis.core.numbers.sampling import Samples, by_elements, columns_of_parts
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.interpolation import modified
from elvis.core.portions import Portion
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Sampler
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.testing.played_ranks import played
from elvis.plugins.command.command import main

TARGETS = (
    "domain",
    "all",
    "plane:0.1,0.2,0.3:1,0.3,0.2",
    "sphere:0.5,0.5,0.5:0.3",
    "u=0.2",
    "line:0.1,0.1,0.1:0.8,0.7,0.9",
)


@pytest.mark.parametrize("rank", [0, 1])
def test_rank_0_aborts_first_and_prints_why(monkeypatch, rank):
    calls = []
    monkeypatch.setattr(ranks_module, "sleep", lambda seconds: calls.append(seconds > 0.5))
    world = SimpleNamespace(Get_rank=lambda: rank, Get_size=lambda: 2, Abort=calls.append)
    MpiRanks(world).abort(130)
    assert calls == [rank > 0, 130]


def shared(size, work, len_of=len):
    """What the first rank makes of work that all take part in; ``len_of``: how much of it that is."""
    first, *others = played(size, work)
    assert not any(map(len_of, others))
    return first


@pytest.fixture(scope="module")
def bent():
    """All shapes, curved, with a field."""
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
def test_processes_of_one_communicator_are_counted(environment, count):
    assert started_together(environment) == count


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("size", [1, 2, 5])
def test_every_piece_has_one_turn(count, size):
    pieces = "abcdefg"[:count]
    taken = played(size, lambda ranks: list(Turns(ranks).of(pieces)))
    assert sorted(piece for own in taken for piece in own) == list(pieces)
    assert max(map(len, taken)) - min(map(len, taken)) <= 1


@pytest.mark.parametrize("size", [2, 3, 8])
def test_norms_are_the_same_to_the_bit(bent, size, monkeypatch):
    monkeypatch.setattr("elvis.core.numbers.norms._BATCH", 12 * 200)
    assert shared(size, lambda ranks: norms(bent, ranks)) == norms(bent)
    wanted = [Expression.of(bent, text) for text in ("u", "d(u,x)/(2+u)")]
    assert shared(size, lambda ranks: quantity_norms(bent, wanted, ranks)) == quantity_norms(bent, wanted)


def own(dataset, ranks):
    """The part of a dataset that a rank has."""
    return Portion.of_whole(dataset, ranks.rank, ranks.size).dataset


@pytest.mark.parametrize("size", [2, 7, 100])
def test_norms_of_parts_are_the_same_to_the_bit(bent, size):
    """Of few elements and many, and of none."""
    assert shared(size, lambda ranks: norms(own(bent, ranks), ranks)) == norms(bent)
    wanted = [Expression.of(bent, text) for text in ("u", "d(u,x)/(2+u)")]
    assert shared(size, lambda ranks: quantity_norms(own(bent, ranks), wanted, ranks)) == quantity_norms(bent, wanted)
    alone = Dataset(bent.mesh)
    assert shared(size, lambda ranks: norms(own(alone, ranks), ranks)) == norms(alone)


@pytest.fixture(scope="module")
def waves():
    """Triangles with a Fourier direction, and a field."""
    expansion = replace(
        modified(Shape.TRIANGLE, (4, 4)), homogeneous=Homogeneous((Basis.FOURIER,), (2.5,), (0, 1, 2, 3))
    )
    mesh = grid(Shape.TRIANGLE, 3)
    (ids,) = (entities.ids for entities in mesh.elements.values())
    coefficients = np.random.default_rng(0).normal(size=(len(ids), mode_count(expansion)))
    return Dataset(mesh, (Field("u", (Block(expansion, ids, coefficients),)),))


def test_tables_of_parts_have_fourier_directions(waves):
    assert list(norms(waves)) == ["x", "y", "z", "u"]
    assert shared(30, lambda ranks: norms(own(waves, ranks), ranks)) == norms(waves)
    points = np.random.default_rng(0).uniform(-0.1, 1.1, (50, 3)) * [1, 1, 2.5]
    wanted = [Expression.of(waves, text) for text in ("u", "d(u,z)")]

    def probed(dataset):
        return Sampler(dataset, wanted).sample(points)

    alone = probed(waves).columns()
    found = shared(4, lambda ranks: by_elements(probed(own(waves, ranks)), points, False, ranks), len_of=rows)
    assert {name: each.tobytes() for name, each in found.items()} == {n: each.tobytes() for n, each in alone.items()}
    for over in ("domain", "all"):
        whole = integrate(waves, ["u", "z*u"], over)
        parts = shared(4, lambda ranks, over=over: integrate(own(waves, ranks), ["u", "z*u"], over, ranks=ranks))
        for one, other in zip(whole, parts, strict=True):
            assert (one.over, one.integrand, one.exact) == (other.over, other.integrand, other.exact)
            assert abs(one.value - other.value) <= one.error + other.error + 1e-13 * abs(one.value)


@pytest.mark.parametrize("size", [3, 100])
@pytest.mark.parametrize("every", [False, True], ids=["one", "every"])
def test_points_between_parts_are_in_the_elements_that_one_process_finds(bent, size, every):
    """In corners and on edges, where many elements hold a point to rounding, inside and outside."""
    vertices = bent.mesh.vertices
    middles = vertices[bent.mesh.of(Shape.SEGMENT).members].mean(axis=1)
    points = np.concatenate([vertices, middles, np.random.default_rng(0).uniform(-0.2, 1.2, (200, 3))])
    wanted = [Expression.of(bent, text) for text in ("u", "d(u,x)")]

    def probed(dataset):
        return Sampler(dataset, wanted).sample(points, all=every)

    alone = probed(bent).columns()
    found = shared(size, lambda ranks: by_elements(probed(own(bent, ranks)), points, every, ranks), len_of=rows)
    assert {name: column.tobytes() for name, column in found.items()} == {
        name: column.tobytes() for name, column in alone.items()
    }
    assert set(alone["status"]) == {0, 1}


def test_ambiguous_hits_count_for_points_found_nowhere_else():
    """As in one process, which doesn't search elements in doubt for others; each part is requested points 0 to 3."""

    def found(point, element, margin, status, is_late):
        none = np.full(len(point), -1)
        where = Location(np.array(point), none, none, np.array(element), none, np.array(margin), status, is_late)
        return Samples(
            ("u",), np.zeros((len(point), 3)), where, np.array(element, float)[:, None], np.zeros((len(point), 1))
        )

    inside, failed = int(Status.INSIDE), int(Status.FAILED)
    one = found([0, 1, 2], [7, 7, -1], [0.1, 0.2, np.nan], np.array([inside, inside, failed]), np.zeros(3, bool))
    other = found([0, 1], [4, 5], [0.3, 0.2], np.array([inside, inside]), np.array([True, False]))
    for parts in ([one, other], [other, one]):
        table = columns_of_parts(parts, np.zeros((4, 3)), all=False)
        assert table["element"].tolist() == [7, 5, -1, -1]
        assert table["status"].tolist() == [inside, inside, failed, int(Status.OUTSIDE)]
        assert repr(table["u"].tolist()) == "[7.0, 5.0, nan, nan]"
        every = columns_of_parts(parts, np.zeros((4, 3)), all=True)
        assert every["element"].tolist() == [4, 7, 5, 7, -1, -1]


def rows(columns):
    """How many rows a table has."""
    return len(columns["point"])


@pytest.mark.parametrize("numbers", [[1e16, 1, 1e-16, 1], [], [1e308, 1e308], [1, np.inf], [1, np.nan]], ids=str)
def test_compressed_lists_expand_to_all_numbers(numbers):
    halves = [parts_of_sum(np.array(some, float)) for some in (numbers[:1], numbers[1:])]
    assert repr(rounded_sum([*halves[0], *halves[1]])) == repr(rounded_sum(numbers))
    assert max(map(len, halves)) <= 3


@pytest.mark.thorough
def test_integrals_differ_by_their_errors(bent):
    fields = ("u", "sin(3*u)", "average(u*u)")
    alone = integrate(bent, fields, TARGETS, 1e-3)
    found = shared(3, lambda ranks: integrate(bent, fields, TARGETS, 1e-3, ranks=ranks))
    for one, other in zip(alone, found, strict=True):
        assert (one.over, one.integrand, one.exact) == (other.over, other.integrand, other.exact)
        assert abs(one.value - other.value) <= one.error + other.error + 1e-14 * abs(one.value)
        assert other.measure == pytest.approx(one.measure, rel=1e-12 if one.exact else 1e-5)


@pytest.fixture(scope="module")
def walled():
    """All shapes, curved, with a field, boundaries, one of them inside, a region, and a second one without elements."""
    mesh = curved(mixed_volume(), ripple(0.05), 2)
    faces = np.concatenate([mesh.of(shape).members.reshape(-1) for shape in mesh.elements])
    ids = np.concatenate([mesh.of(shape).ids for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL)])
    outer, inner = (ids[np.flatnonzero(np.bincount(faces) == count)] for count in (1, 2))
    parts = [(shape.tag, own.ids) for shape, own in mesh.elements.items()]
    composites = (
        *(Composite(number, (part,), "most" if number else None) for number, part in enumerate(parts)),
        *(
            Composite(10 + number, (("F", some),), name)
            for number, (name, some) in enumerate({"wall": outer[::3], "one": outer[1:2], "within": inner[:4]}.items())
        ),
    )
    mesh = replace(mesh, composites=composites, domains={0: tuple(range(len(parts)))})
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: p[:, 0] - p[:, 1] * p[:, 2], 2),))


@pytest.mark.parametrize(
    ("size", "over", "clip"),
    [
        (50, ("domain", "region:most"), None),
        (50, ("all",), None),
        (20, ("wall", "one"), None),
        (3, ("one", "domain"), None),
        (2, ("plane:0.1,0.2,0.3:1,0.3,0.2", "plane:0.5,0,0:1,0,0"), None),
        (2, ("domain",), "plane:0.4,0,0:1,0,0"),
    ],
    ids=str,
)
def test_integrals_over_parts_match_those_of_the_whole(walled, size, over, clip):
    """Rows and their names are the same, whatever parts have elements or sides there; faces between parts are inner."""
    fields = ("u", "average(u)", "nx" if over in (("all",), ("wall", "one")) else "x")
    alone = integrate(walled, fields, over, 1e-4, clip=clip)

    def work(ranks):
        part = own(walled, ranks)
        assert comes_apart(part, fields, over, clip=clip, ranks=ranks)
        return integrate(part, fields, over, 1e-4, clip=clip, ranks=ranks)

    found = shared(size, work)
    assert [(one.over, one.integrand, one.exact) for one in alone] == [(o.over, o.integrand, o.exact) for o in found]
    for one, other in zip(alone, found, strict=True):
        assert abs(one.value - other.value) <= one.error + other.error + 1e-14 * abs(one.value)
        assert other.measure == pytest.approx(one.measure, rel=1e-12 if one.exact else 1e-5)


@pytest.mark.parametrize(
    ("field", "over"),
    [
        ("u", "within"),
        ("u", "u=0.2"),
        ("u", "distance(all)=0.1"),
        ("u", "line:0.1,0.1,0.1:0.8,0.7,0.9"),
        ("u", "element:1"),
    ],
    ids=str,
)
def test_computations_that_need_more_than_parts_are_reported(walled, field, over):
    assert played(3, lambda ranks: comes_apart(own(walled, ranks), [field], [over], ranks=ranks)) == [False] * 3


def test_a_field_on_some_elements_creates_no_boundary(walled):
    """Sides are inner ones of the elements that have it, not of all."""
    (field,) = walled.fields
    some = replace(walled, fields=(replace(field, blocks=field.blocks[:1]),))
    assert played(2, lambda ranks: comes_apart(own(some, ranks), ["1"], ["all"], ranks=ranks)) == [False] * 2


def test_clipped_data_are_shared(bent):
    clip = "sphere:0.5,0.5,0.5:0.3"
    alone = integrate(bent, "u", error=1e-4, clip=clip)
    found = shared(2, lambda ranks: integrate(bent, "u", error=1e-4, clip=clip, ranks=ranks))
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
        ("info", "--extrema"),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_a_table_is_printed_once_and_equals_that_of_one_process(files, started, words, monkeypatch, capfd):
    command = (words[0], "bent.xml", "bent.fld", *words[1:])
    monkeypatch.chdir(files)
    with pytest.raises(SystemExit):
        main(list(command))
    alone, ranks = capfd.readouterr(), started.ranks(files, (2, *command))
    assert (ranks.returncode, ranks.stderr) == (0, alone.err)
    if words[0] == "integrate":
        assert float(ranks.stdout.split()[-3]) == pytest.approx(float(alone.out.split()[-3]), rel=1e-14)
    else:
        assert ranks.stdout == alone.out


@pytest.mark.parametrize(
    ("words", "status"), [("integrate bent.xml", 2), ("convert --wrong", 2), ("info none.xml", 1)], ids=str
)
def test_errors_are_printed_once(files, started, words, status):
    ranks = started.ranks(files, (2, *words.split()))
    assert (ranks.returncode, ranks.stdout) == (status, "")
    (sentence,) = ranks.stderr.splitlines()
    assert sentence.startswith("elvis: error: ")


def test_ranks_with_different_commands_are_reported(files, started):
    one, other = (("convert", "bent.xml", "bent.fld", "-o", name) for name in ("none1.xml", "none2.xml"))
    ranks = started.ranks(files, (1, *one), (1, *other))
    assert ranks.returncode == 1
    assert ranks.stderr.startswith("elvis: error: part 2 of 2: expected the data and the task of part 1, found others")
    assert not [path for path in files.iterdir() if "none" in path.name]


def test_child_processes_of_a_rank_are_not_ranks(started, tmp_path):
    """Though it takes over the channel to the starter, which MPICH closes, Open MPI keeps open."""
    count = "from elvis.core.base.ranks import started_together; print(started_together())"
    start = (
        "import os, subprocess, sys; from elvis.core.base.ranks import ranks_of_run; "
        "channel = int(os.environ['PMI_FD']);"
        f"ranks_of_run(); subprocess.run([sys.executable, '-c', {count!r}], pass_fds=[channel], check=True)"
    )
    ranks = started.processes(tmp_path, (2, sys.executable, "-c", start))
    # lines of processes may come between those of others
    assert (ranks.returncode, "".join(ranks.stdout.split()), ranks.stderr) == (0, "11", "")


#: a rank that sends each other one what is large enough not to be there before it is requested
SENDS = """
import os, numpy as np
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ranks_of_run

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


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("pass", "[[None, 10, None], [1, None, 21], [None, 12, None]]"),
        ("if ranks.rank == 1: raise ElvisError('there is none')", "part 2 of 3: there is none"),
        ("if ranks.rank == 2: values[1] = lambda: 0", "part 3 of 3: Can't "),
        (
            "if ranks.rank: ranks._world.isend(0, dest=3 - ranks.rank, tag=5); raise ElvisError('there is none')",
            "part ",
        ),
    ],
    ids=["none", "before", "while messages are made", "after unread messages"],
)
def test_each_rank_receives_the_data_of_the_others(started, tmp_path, fault, told):
    ranks = started.processes(tmp_path, (3, sys.executable, "-c", SENDS.format(fault=fault)))
    assert ranks.returncode == (fault != "pass")
    assert ranks.stderr == ""
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


#: ranks that note and fail, as commands do; the last word is printed by the first
NOTES = """
import sys
from elvis.core.base.ranks import ranks_of_run
from elvis.core.base.terminal import note, warn

ranks = ranks_of_run()
note("all see this")
for _ in range(2):
    if ranks.rank:
        warn("only others see this")
if ranks.rank == 2:
    note("one sees this")
raise SystemExit(ranks.end({status}, {reason}))
"""


@pytest.mark.parametrize("is_late", [False, True], ids=["at the first rank", "at a late rank"])
def test_notes_of_other_ranks_are_printed_once_and_any_failure_counts(started, tmp_path, is_late):
    status, reason = ("0", "'none' if ranks.rank == 1 else ''") if is_late else ("2", "''")
    ranks = started.processes(tmp_path, (3, sys.executable, "-c", NOTES.format(status=status, reason=reason)))
    assert ranks.returncode == (1 if is_late else 2)
    assert ranks.stderr.splitlines() == [
        "elvis: note: all see this",
        "elvis: warning: part 2 of 3: only others see this",
        "elvis: note: part 3 of 3: one sees this",
        *(["elvis: error: part 2 of 3: none"] if is_late else []),
    ]
