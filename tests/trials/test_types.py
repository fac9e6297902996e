"""Editors that check types know the public names: pyright accepts the examples, and rejects what is wrong."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: its imports from netgen have no types
UNTYPED = {"street.py"}
WRONG = """\
import elvis

dataset = elvis.read("wing.xml", "wing.fld")
frame = elvis.render(dataset, "p", plane="z=0.2", contours=10, size=(80, 60))
frame.save("wing.png")
elvis.render(dataset, "p", contuors=10)
elvis.render(dataset, "p", plain="yes")
elvis.sampel(dataset, "p", (0, 0, 0))
"""


def checked(folder):
    """Errors of pyright in a folder: file, line from 1, message; skips where it does not run."""
    version = subprocess.run([sys.executable, "-m", "pyright", "--version"], capture_output=True, text=True)
    if version.returncode:
        pytest.skip("needs pyright, and a network when it runs for the first time")
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    found = json.loads(done.stdout)["generalDiagnostics"]
    return [(Path(own["file"]).name, own["range"]["start"]["line"] + 1, own["message"]) for own in found]


@pytest.mark.thorough
def test_examples_have_the_right_types(tmp_path):
    # as installed: all slices are in one folder
    package = tmp_path / "site" / "elvis"
    package.mkdir(parents=True)
    for slices in ROOT.glob("*/elvis"):
        for path in slices.iterdir():
            if path.name not in ("__pycache__", "py.typed"):
                (package / path.name).symlink_to(path)
    work = tmp_path / "work"
    work.mkdir()
    for path in (ROOT / "examples").glob("*.py"):
        if path.name not in UNTYPED:
            (work / path.name).write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    (work / "wrong.py").write_text(WRONG, encoding="utf-8")
    (work / "pyrightconfig.json").write_text(json.dumps({"extraPaths": ["../site"]}), encoding="utf-8")
    found = checked(work)
    assert [own[:2] for own in found] == [("wrong.py", line) for line in (6, 7, 8)], found
