"""A plugin for pytest: writes the lines of ElVis that each test runs, and its seconds.

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
    result = yield
    touched[item.nodeid] = {name: sorted(of) for name, of in lines.items()}
    return result


def pytest_runtest_logreport(report):
    if report.passed:
        seconds[report.nodeid] = seconds.get(report.nodeid, 0.0) + report.duration
    elif report.nodeid in seconds or report.failed or report.skipped:
        seconds[report.nodeid] = float("inf")


def pytest_sessionfinish():
    passed = {
        node: [seconds[node], of] for node, of in touched.items() if seconds.get(node, float("inf")) < float("inf")
    }
    with open(os.environ["MUTATION_TOUCHED"], "w", encoding="utf-8") as file:
        json.dump(passed, file)
