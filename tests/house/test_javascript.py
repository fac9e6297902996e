"""JavaScript is checked for syntax errors."""

import subprocess
import sys

import pytest
from test_sizes import loaded


@pytest.fixture(scope="module")
def tool(root):
    return loaded(root / "tools" / "javascript.py")


def test_all_files_are_valid(root):
    done = subprocess.run([sys.executable, root / "tools" / "javascript.py"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_syntax_errors_are_found(tool):
    node = tool.node_program()
    if node is None:
        pytest.skip("Node.js is not installed")
    assert tool.fault_of(node, "export const x = 1;\n") == ""
    assert "SyntaxError" in tool.fault_of(node, "export const x = = 1;\n")
