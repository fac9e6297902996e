"""A sample of runs that are killed, interrupted or meet a full disk; the script next to this does many more."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).with_name("interruptions.py")


def test_nothing_is_lost(tmp_path):
    counts = ["killed=2", "interrupted=1", "disks=2"]
    command = [sys.executable, str(SCRIPT), "--seed", "7", "--commands", "convert", *counts]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 faults" in done.stdout
