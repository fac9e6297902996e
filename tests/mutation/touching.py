"""A plugin for pytest: writes the lines of ElVis that each test runs, and its processor seconds.

``pytest -p touching`` with ``MUTATION_TOUCHED`` (a JSON file) and ``MUTATION_ROOT`` in the environment.  Python reports
each line of each code object once a test (PEP 669), so the tests take about as long as without.
"""

from __future__ import annotations

import json
import os
import sys
from collections import defaultdict

import pytest

TOOL = sys.monitoring.COVERAGE_ID
ROOT = os.environ["MUTATION_ROOT"].rstrip("/") + "/"
touched: dict[str, dict[str, list[int]]] = {}
seconds: dict[str, float] = {}
#: tests that failed or were skipped
without: set[str] = set()
lines = defaultdict(set)


def note(code, line):
    """Keep a line of the areas; no line is reported twice in a test."""
    name = code.co_filename
    if name.startswith(ROOT) and "/elvis/" in name:
        lines[name[len(ROOT) :]].add(line)
    return sys.monitoring.DISABLE


def pytest_configure():
    sys.monitoring.use_tool_id(TOOL, "mutation")
    sys.monitoring.register_callback(TOOL, sys.monitoring.events.LINE, note)
    sys.monitoring.set_events(TOOL, sys.monitoring.events.LINE)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    lines.clear()
    sys.monitoring.restart_events()
    before = processor_seconds()
    result = yield
    touched[item.nodeid] = {name: sorted(of) for name, of in lines.items()}
    seconds[item.nodeid] = processor_seconds() - before
    return result


def processor_seconds():
    """Seconds of all threads, and of the processes that have ended."""
    return sum(os.times()[:4])


def pytest_runtest_logreport(report):
    if not report.passed:
        without.add(report.nodeid)


def pytest_sessionfinish():
    passed = {node: [seconds[node], of] for node, of in touched.items() if node not in without}
    with open(os.environ["MUTATION_TOUCHED"], "w", encoding="utf-8") as file:
        json.dump(passed, file)
