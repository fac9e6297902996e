"""A plugin for pytest: writes what of ElVis each test runs, lines and kernels, and its processor seconds.

``pytest -p touching`` with ``MUTATION_TOUCHED`` (a folder) and ``MUTATION_ROOT`` in the environment writes a JSON file
for each test module.  Python reports each line of each code object once a test (PEP 669), so the tests take about as
long as without.  What a fixture runs counts for each test that uses it.  Lines are numbered from the start of their
function, so that a map stays true while other functions change.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from choosing import map_name

TOOL = sys.monitoring.COVERAGE_ID
ROOT = os.environ["MUTATION_ROOT"].rstrip("/") + "/"
FOLDER = Path(os.environ["MUTATION_TOUCHED"])


class Run:
    """Lines by file and function, and kernels by module, that a test or a fixture runs."""

    def __init__(self) -> None:
        self.lines = defaultdict(set)
        self.kernels = set()

    def add(self, other):
        """Add what a fixture runs."""
        for function, lines in other.lines.items():
            self.lines[function] |= lines
        self.kernels |= other.kernels


running = Run()
of_fixtures = defaultdict(Run)
#: tests of the present module: processor seconds and what they run
tests: dict[str, tuple[float, Run]] = {}
#: tests that failed or were skipped
without: set[str] = set()


def note(code, line):
    """Keep a line of the areas; no line is reported twice in a test."""
    name = code.co_filename
    if name.startswith(ROOT) and "/elvis/" in name:
        running.lines[name[len(ROOT) :], code.co_qualname].add(line - code.co_firstlineno)
    return sys.monitoring.DISABLE


def pytest_configure():
    sys.monitoring.use_tool_id(TOOL, "mutation")
    sys.monitoring.register_callback(TOOL, sys.monitoring.events.LINE, note)
    sys.monitoring.set_events(TOOL, sys.monitoring.events.LINE)
    note_kernels()


def pytest_unconfigure():
    # at exit, modules lose their names before the last lines run
    sys.monitoring.set_events(TOOL, sys.monitoring.events.NO_EVENTS)


def note_kernels():
    """Let kernels note the modules that they are linked from when they run."""
    from elvis.renderer.device.device import Device, Kernel

    link, run = Device._link, Kernel.__call__

    def linked(self, stage, source):
        kernel = link(self, stage, source)
        kernel._modules = {stage.removesuffix("_check"), stage, *re.findall(r"\bimport (\w+);", source)}
        return kernel

    def noted(self, *arguments, **named):
        running.kernels |= self._modules
        return run(self, *arguments, **named)

    Device._link, Kernel.__call__ = linked, noted


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef):
    global running
    outer, running = running, of_fixtures[fixturedef]
    sys.monitoring.restart_events()
    try:
        return (yield)
    finally:
        running = outer
        sys.monitoring.restart_events()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item, nextitem):
    global running
    running = Run()
    sys.monitoring.restart_events()
    before = processor_seconds()
    result = yield
    for fixtures in item._fixtureinfo.name2fixturedefs.values():
        for fixture in fixtures:
            if fixture in of_fixtures:
                running.add(of_fixtures[fixture])
    tests[item.nodeid] = processor_seconds() - before, running
    if nextitem is None or nextitem.path != item.path:
        write(item.path)
        tests.clear()
    return result


def processor_seconds():
    """Seconds of all threads, and of the processes that have ended."""
    return sum(os.times()[:4])


def pytest_runtest_logreport(report):
    if not report.passed:
        without.add(report.nodeid)


def write(path):
    """Write the map of a module: each function with its lines once, and for each test the numbers of such entries."""
    entries = {}
    known = {}
    for node, (seconds, run) in tests.items():
        if node not in without:
            own = [(*function, tuple(sorted(lines))) for function, lines in run.lines.items()]
            numbers = [entries.setdefault(entry, len(entries)) for entry in own]
            known[node] = [seconds, numbers, sorted(run.kernels)]
    target = FOLDER / map_name(Path(ROOT), path)
    target.write_text(json.dumps({"entries": list(entries), "tests": known}), encoding="utf-8")
