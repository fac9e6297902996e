"""Editors that check types know the public names: pyright accepts the examples, and rejects what is wrong."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: a package whose names have no types
UNTYPED = "netgen"
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


def line_of(folder, name, number):
    """The text of a line of a file."""
    return (folder / name).read_text(encoding="utf-8").splitlines()[number - 1]


@pytest.mark.thorough
def test_examples_have_the_right_types(tmp_path):
    subprocess.run([sys.executable, ROOT / "tools" / "checkout_package.py", tmp_path / "site"], check=True)
    work = tmp_path / "work"
    work.mkdir()
    for path in (ROOT / "examples").glob("*.py"):
        (work / path.name).write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    (work / "wrong.py").write_text(WRONG, encoding="utf-8")
    (work / "pyrightconfig.json").write_text(json.dumps({"extraPaths": ["../site"]}), encoding="utf-8")
    found = [own for own in checked(work) if UNTYPED not in line_of(work, *own[:2])]
    assert [own[:2] for own in found] == [("wrong.py", line) for line in (6, 7, 8)], found
