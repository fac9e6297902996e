"""A sample of runs that are killed, interrupted or meet a full disk; the script next to this does many more."""

import os
import subprocess
import sys
from pathlib import Path

import click
import interruptions
import pytest

from elvis.plugins.command.command import elvis

FOLDER = Path(__file__).parent


def run(folder, script, *options):
    """What a script next to this prints with options; it has to end well."""
    command = [sys.executable, str(FOLDER / script), *options]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(folder)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_command_is_interrupted():
    commands = elvis.list_commands(click.Context(elvis))
    assert set(interruptions.COMMANDS) == {*commands, "help"}


def test_nothing_is_lost(tmp_path):
    counts = ["killed=2", "interrupted=1", "warm=2", "disks=2"]
    assert "0 faults" in run(tmp_path, "interruptions.py", "--seed", "7", "--commands", "convert", *counts)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["watched", "caches", "viewed"])
def test_damage_by_others_while_a_command_runs(tmp_path, kind):
    assert "0 faults" in run(tmp_path, "neighbours.py", f"{kind}=2", "--seed", "7")


@pytest.mark.thorough
def test_damaged_messages_to_a_viewer(tmp_path):
    run(tmp_path, "pages.py", "--messages", "600", "--seed", "3")


@pytest.mark.thorough
def test_inputs_with_a_lot_of_one_kind(tmp_path):
    run(tmp_path, "large.py", "--points", "100000", "--fields", "1000")
