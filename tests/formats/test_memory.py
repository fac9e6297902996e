"""How much memory is free: to the machine, and to the groups of processes that limit it."""

import os
import subprocess
import sys

import pytest

from elvis.core.base import memory
from elvis.scene.commandline import parameters

MODERN = ("memory.max", "memory.current", "inactive_file")
OLD = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")


def group(folder, names, most, used, spare):
    """The files of a control group."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / names[0]).write_text(f"{most}\n")
    (folder / names[1]).write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 5\n{names[2]} {spare}\nother 7\n")


def free(tmp_path, lines):
    (tmp_path / "own").write_text("\n".join(lines) + "\n")
    return min(memory._of_groups(tmp_path / "own", tmp_path / "groups"))


def test_groups_of_today(tmp_path):
    """The smallest of all groups that hold the process; what its files take can be had."""
    groups = tmp_path / "groups"
    group(groups / "job" / "step", MODERN, 1000, 700, 200)
    assert free(tmp_path, ["0::/job/step"]) == 500
    group(groups / "job", MODERN, 2000, 1900, 0)
    assert free(tmp_path, ["0::/job/step"]) == 100
    group(groups / "job", MODERN, 2000, 2100, 0)
    assert free(tmp_path, ["0::/job/step"]) == 0
    group(groups / "job", MODERN, "max", 2100, 0)
    assert free(tmp_path, ["0::/job/step"]) == 500


def test_groups_of_old(tmp_path):
    group(tmp_path / "groups" / "memory" / "box", OLD, 1000, 400, 50)
    lines = ["9:cpu:/", "4:memory:/box", "0::/"]
    assert free(tmp_path, lines) == 650
    assert free(tmp_path, ["4:cpuset,memory:/box"]) == 650


def test_without_groups_there_is_no_limit(tmp_path):
    assert free(tmp_path, ["4:memory:/gone", "0::/gone"]) == float("inf")
    assert memory._of_groups(tmp_path / "none", tmp_path) == [float("inf")]
    group(tmp_path / "groups", MODERN, "garbage", 1, 1)
    assert free(tmp_path, ["0::/"]) == float("inf")


def test_the_lowest_limit_counts(monkeypatch):
    monkeypatch.setattr(memory, "_of_system", lambda: 900.0)
    monkeypatch.setattr(memory, "_of_groups", lambda: [float("inf"), 800.0])
    assert memory.free_memory() == 800.0
    monkeypatch.setattr(memory, "_of_groups", lambda: [float("inf")])
    assert memory.free_memory() == 900.0


@pytest.mark.parametrize(
    ("size", "text"),
    [
        (1, "1 bytes"),
        (999, "999 bytes"),
        (999.7, "0.976 KiB"),
        (2048, "2 KiB"),
        (1.5 * 2**30, "1.5 GiB"),
        (2.0**60, "1.05e+06 TiB"),
    ],
)
def test_printed_sizes_are_valid_option_values(size, text):
    assert memory.size_text(size) == text
    if "bytes" not in text:
        assert parameters.memory(text) == pytest.approx(size, rel=0.005)


@pytest.mark.skipif(sys.platform != "linux", reason="page faults are counted on Linux")
def test_pages_of_freed_arrays_are_reused():
    def faults(setting):
        """Page faults of repeated products of arrays of 1 MiB, in a process without settings of its own."""
        program = f"""
import resource
import numpy as np
from elvis.core.base.memory import settle_free_memory
{setting}
def work():
    arrays = [np.ones(1 << 17) for _ in range(16)]
work()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    work()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
        environment = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        return int(done.stdout)

    assert faults("settle_free_memory()") < 0.05 * faults("")
