"""Checks the syntax of every JavaScript file with Node.js; `make lint` runs it.

python tools/javascript.py

Node.js comes from the PATH, or from the package playwright, which contains it.  Without either nothing is checked, and
a line reports this.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    """0 if all files are valid, 1 otherwise."""
    node = node_program()
    if node is None:
        print("JavaScript is not checked: neither node nor playwright is installed")
        return 0
    listed = subprocess.run(["git", "ls-files", "*.js"], cwd=ROOT, capture_output=True, text=True, check=True)
    faults = {name: fault_of(node, (ROOT / name).read_text(encoding="utf-8")) for name in listed.stdout.splitlines()}
    for name, fault in faults.items():
        if fault:
            print(f"{name}: {fault}")
    return int(any(faults.values()))


def node_program() -> str | None:
    """Path of Node.js, None if it is not installed."""
    found = shutil.which("node")
    if found:
        return found
    try:
        import playwright
    except ImportError:
        return None
    program = Path(playwright.__file__).with_name("driver") / ("node.exe" if sys.platform == "win32" else "node")
    return str(program) if program.exists() else None


def fault_of(node: str, text: str) -> str:
    """The syntax error of an ES module as Node.js prints it; empty if there is none."""
    done = subprocess.run([node, "--check", "--input-type=module", "-"], input=text, capture_output=True, text=True)
    return done.stderr.strip() if done.returncode else ""


if __name__ == "__main__":
    sys.exit(main())
