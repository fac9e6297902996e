"""The command starts at once."""

import subprocess
import sys
import time

import pytest

HELP = [sys.executable, "-c", "from elvis.plugins.command import main; main(['--help'])"]


def test_help_takes_less_than_three_tenths_of_a_second():
    def seconds():
        start = time.perf_counter()
        subprocess.run(HELP, check=True, capture_output=True)
        return time.perf_counter() - start

    assert min(seconds() for _ in range(8)) < 0.3


@pytest.mark.parametrize("heavy", ["numpy", "lxml", "h5py", "slangpy", "rich", "PIL", "asyncio"])
def test_help_loads_nothing_heavy(heavy):
    lines = ("import sys", "from elvis.plugins.command import elvis", "elvis(['--help'], standalone_mode=False)")
    code = "; ".join([*lines, f"assert {heavy!r} not in sys.modules"])
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
