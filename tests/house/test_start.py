"""The command starts at once."""

import resource
import subprocess
import sys

import pytest

HELP = [sys.executable, "-c", "from elvis.plugins.command import main; main(['--help'])"]


def test_help_takes_less_than_three_tenths_of_a_second():
    # of the processor, which is what it waits for: other programs hardly touch them
    def seconds():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(HELP, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

    assert min(seconds() for _ in range(8)) < 0.3


@pytest.mark.parametrize("heavy", ["numpy", "lxml", "h5py", "slangpy", "rich", "PIL", "asyncio"])
def test_help_loads_nothing_heavy(heavy):
    lines = ("import sys", "from elvis.plugins.command import elvis", "elvis(['--help'], standalone_mode=False)")
    code = "; ".join([*lines, f"assert {heavy!r} not in sys.modules"])
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
