"""A sample of runs that are killed, interrupted or meet a full disk; the script next to this does many more."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("interruptions.py")


def test_nothing_is_lost(tmp_path):
    counts = ["killed=2", "interrupted=1", "warm=2", "disks=2"]
    command = [sys.executable, str(SCRIPT), "--seed", "7", "--commands", "convert", *counts]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 faults" in done.stdout


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["watched", "caches", "viewed"])
def test_damage_by_others_while_a_command_runs(tmp_path, kind):
    command = [sys.executable, str(SCRIPT.with_name("neighbours.py")), f"{kind}=2", "--seed", "7"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 faults" in done.stdout


@pytest.mark.thorough
def test_damaged_messages_to_a_viewer(tmp_path):
    command = [sys.executable, str(SCRIPT.with_name("pages.py")), "--messages", "600", "--seed", "3"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.thorough
def test_inputs_with_a_lot_of_one_kind(tmp_path):
    command = [sys.executable, str(SCRIPT.with_name("large.py")), "--points", "100000", "--fields", "1000"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
