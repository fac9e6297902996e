"""Which tests run for a line: those that run it, from the test modules that are nearest to its file by imports."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
from collections import defaultdict, deque
from functools import cached_property
from pathlib import Path

AREAS = ("formats", "plugins", "converters", "renderer", "reference")
#: folders of tests that check the tree, other programs' pages or damaged files
NOT_FOR_MUTANTS = ("house", "fuzz", "mutation", "benchmarks", "trials", "examples")
#: test modules whose tests run for a line, and test modules that are searched for such tests, at most
MODULES, SEARCHED = 4, 25


#: a process that waits instead of computing ends after so many times its limit of processor seconds
LONGEST_WAIT = 20.0


def run_within(command: list[str], limit: float, **options) -> subprocess.CompletedProcess[str] | None:
    """What a command returns; None if it, or a process that it starts, needs more processor seconds than the limit."""
    limited = ["sh", "-c", 'ulimit -t "$0" && exec "$@"', str(round(limit)), *command]
    try:
        run = subprocess.run(
            limited, capture_output=True, text=True, timeout=LONGEST_WAIT * limit, check=False, **options
        )
    except subprocess.TimeoutExpired:
        return None
    return None if run.returncode in (-signal.SIGXCPU, -signal.SIGKILL) else run


class Imports:
    """The graph of files: a file points to the files of ElVis that it imports, and to the kernels that it names."""

    def __init__(self, root: Path) -> None:
        self._root = root
        files = [
            path for area in AREAS for path in (root / area / "elvis").rglob("*") if path.suffix in (".py", ".slang")
        ]
        tests = [path for path in (root / "tests").rglob("*") if path.suffix in (".py", ".slang")]
        self._files = [path for path in files + tests if path.is_file()]
        self._modules = {self._module(path): path for path in files if path.suffix == ".py"}
        self._kernels = {path.stem: path for path in self._files if path.suffix == ".slang"}

    def _module(self, path: Path) -> str:
        parts = path.relative_to(self._root).with_suffix("").parts[1:]
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    @cached_property
    def _users(self) -> dict[Path, set[Path]]:
        users = defaultdict(set)
        for path in self._files:
            for name in self._names(path):
                users[name].add(path)
        return users

    def _names(self, path: Path) -> set[Path]:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".slang":
            stems = re.findall(r"^\s*(?:import|__include|implementing)\s+\"?([\w.]+)\"?;", text, re.M)
            return {self._kernels[stem] for stem in stems if stem in self._kernels}
        # by name, as imports of Slang texts, or with the name of a shape behind a prefix
        stems = re.findall(r"[\"'](\w+)(?:\.slang)?[\"']", text) + re.findall(r"\bimport (\w+);", text)
        prefixes = tuple(re.findall(r"\bf[\"'](\w+_)\{", text))
        stems += [stem for stem in self._kernels if prefixes and stem.startswith(prefixes)]
        found = {self._kernels[stem] for stem in stems if stem in self._kernels}
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            found |= {self._modules[name] for name in names if name in self._modules}
        return found - {path}

    def tests_near(self, path: Path) -> list[Path]:
        """Test modules that reach a file, the nearest first; those of the file's own area before others."""
        distance = {path: 0}
        waiting = deque([path])
        while waiting:
            file = waiting.popleft()
            for user in self._users[file]:
                if user not in distance:
                    distance[user] = distance[file] + 1
                    waiting.append(user)
        folder = str(path.relative_to(self._root)).split("/")[0]
        stem = set(path.stem.split("_"))

        def order(test: Path) -> tuple[int, bool, int, str]:
            return distance[test], test.parent.name != folder, -len(stem & set(test.stem.split("_"))), str(test)

        tests = self._root / "tests"
        found = [
            test
            for test in distance
            if test.name.startswith("test_")
            and tests in test.parents
            and test.relative_to(tests).parts[0] not in NOT_FOR_MUTANTS
        ]
        return sorted(found, key=order)


class Touched:
    """Which lines each test of a test module runs, found once for each version of the tree's test module."""

    def __init__(self, root: Path, kept: Path, limit: float) -> None:
        self._root, self._kept, self._limit = root, kept, limit
        kept.mkdir(parents=True, exist_ok=True)

    def of(self, test: Path) -> dict[str, tuple[float, dict[str, list[int]]]]:
        """Processor seconds and lines of each passing test of a module."""
        name = "-".join(test.relative_to(self._root / "tests").with_suffix("").parts)
        stamp = hashlib.sha256(test.read_bytes()).hexdigest()[:12]
        target = self._kept / f"{name}.{stamp}.json"
        if not target.exists():
            for old in self._kept.glob(f"{name}.*.json"):
                old.unlink()
            self._run(test, target)
        return json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}

    def _run(self, test: Path, target: Path) -> None:
        environment = os.environ | {"MUTATION_ROOT": str(self._root), "MUTATION_TOUCHED": str(target)}
        environment["PYTHONPATH"] = str(Path(__file__).parent)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "touching", str(test)]
        if run_within(command, self._limit, cwd=self._root, env=environment) is None:
            target.write_text("{}", encoding="utf-8")

    def running(self, test: Path, name: str, line: int) -> dict[str, float]:
        """Processor seconds of the tests of a module that run a line; if it runs on import, of those of its file."""
        known = self.of(test).items()
        if self._is_in_function(name, line):
            return {node: seconds for node, (seconds, of) in known if line in of.get(name, ())}
        return {node: seconds for node, (seconds, of) in known if name in of}

    def _is_in_function(self, name: str, line: int) -> bool:
        tree = ast.parse((self._root / name).read_text(encoding="utf-8"))
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        return any(node.body[0].lineno <= line <= (node.end_lineno or line) for node in functions)


def tests_for(imports: Imports, touched: Touched, path: Path, lines: range, budget: float) -> list[list[str]]:
    """Groups of tests (one for each test module) that are to fail, within a budget of processor seconds."""
    root = touched._root
    name = str(path.relative_to(root))
    groups = []
    for test in imports.tests_near(path)[:SEARCHED]:
        if len(groups) == MODULES or budget <= 0.0:
            break
        if path.suffix == ".slang":
            seconds = {node: spent for node, (spent, _) in touched.of(test).items()}
        else:
            seconds = {node: spent for line in lines for node, spent in touched.running(test, name, line).items()}
        chosen = []
        for node in sorted(seconds, key=seconds.__getitem__):
            if budget - seconds[node] > 0.0 or not (chosen or groups):
                chosen.append(node)
                budget -= seconds[node]
        if chosen:
            groups.append(chosen)
    return groups
