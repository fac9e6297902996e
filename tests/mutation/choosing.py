"""Which tests run for a line: all that run it, those of the test modules that are nearest by imports first."""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import os
import re
import signal
import subprocess
import sys
from collections import defaultdict, deque
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from types import CodeType

AREAS = ("formats", "plugins", "converters", "renderer", "reference")
#: folders of tests that check the tree, other programs' pages or damaged files
NOT_FOR_MUTANTS = ("house", "fuzz", "mutation", "benchmarks", "trials", "examples")
#: parts of the budget that tests of the nearest module, and of each other one, may take
NEAREST, SHARE = 0.5, 0.25
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
            stems = re.findall(r"^\s*(?:(?:__exported\s+)?import|__include|implementing)\s+\"?([\w.]+)\"?;", text, re.M)
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
        # modules don't repeat the names of their folders
        words = set(path.stem.split("_")) | set(path.parent.name.split("_"))

        def order(test: Path) -> tuple[int, bool, int, str]:
            return distance[test], test.parent.name != folder, -len(words & set(test.stem.split("_"))), str(test)

        return sorted(self.tests & distance.keys(), key=order)

    @cached_property
    def tests(self) -> set[Path]:
        """Test modules that may kill mutants."""
        tests = self._root / "tests"
        found = {path for path in self._files if path.match("test_*.py") and tests in path.parents}
        return {test for test in found if test.relative_to(tests).parts[0] not in NOT_FOR_MUTANTS}

    def kernels_including(self, path: Path) -> set[str]:
        """Names of the modules of kernels that import a module, itself too."""
        found = {path}
        waiting = [path]
        while waiting:
            users = {user for user in self._users[waiting.pop()] if user.suffix == ".slang"} - found
            found |= users
            waiting += users
        return {kernel.stem for kernel in found}


class Touched:
    """What each test runs (touching.py), found once for each version of its module."""

    def __init__(self, root: Path, imports: Imports, kept: Path) -> None:
        self._root, self._imports, self._kept = root, imports, kept
        kept.mkdir(parents=True, exist_ok=True)

    def update(self) -> None:
        """Run the modules that are new or have changed, those of a folder in one process."""
        modules = {test: self._kept / map_name(self._root, test) for test in self._imports.tests}
        for old in set(self._kept.glob("*.json")) - set(modules.values()):
            old.unlink()
        missing = sorted(test for test, target in modules.items() if not target.exists())
        for folder in dict.fromkeys(test.parent for test in missing):
            own = [str(test) for test in missing if test.parent == folder]
            print(f"{folder.relative_to(self._root)}: finding what {len(own)} modules of tests run", flush=True)
            self._run(own)

    def _run(self, tests: list[str]) -> None:
        environment = os.environ | {"MUTATION_ROOT": str(self._root), "MUTATION_TOUCHED": str(self._kept)}
        environment["PYTHONPATH"] = str(Path(__file__).parent)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "touching", "--tb=no", *tests]
        run = subprocess.run(command, cwd=self._root, env=environment, capture_output=True, text=True, check=False)
        for line in run.stdout.splitlines():
            if line.startswith(("FAILED ", "ERROR ")):
                print(f"{line}: this kills no mutant, as it isn't known what it runs", flush=True)

    @cached_property
    def _maps(self) -> dict[Path, dict]:
        targets = {test: self._kept / map_name(self._root, test) for test in self._imports.tests}
        return {
            test: json.loads(target.read_text(encoding="utf-8")) for test, target in targets.items() if target.exists()
        }

    def running(self, path: Path, lines: range) -> dict[Path, dict[str, float]]:
        """Processor seconds of the tests that run some of the lines, by module.

        If no test runs exactly these (parts of a statement have no line of their own, functions may have changed), of
        those that run the functions; of a line that runs on import, of those that run any function of the file.
        """
        if path.suffix == ".slang":
            return self._running_kernel(path)
        name = str(path.relative_to(self._root))
        wanted = lines_by_function(path, lines)
        exact = self._with_entries(
            lambda file, function, own: file == name and not wanted.get(function, set()).isdisjoint(own)
        )
        if exact or not wanted:
            return exact or self._with_entries(lambda file, *_: file == name)
        return self._with_entries(lambda file, function, _: file == name and function in wanted)

    def _with_entries(self, is_wanted: Callable[[str, str, list[int]], bool]) -> dict[Path, dict[str, float]]:
        found = {}
        for test, known in self._maps.items():
            numbers = {number for number, entry in enumerate(known["entries"]) if is_wanted(*entry)}
            own = {node: seconds for node, (seconds, of, _) in known["tests"].items() if not numbers.isdisjoint(of)}
            if own:
                found[test] = own
        return found

    def _running_kernel(self, path: Path) -> dict[Path, dict[str, float]]:
        including = self._imports.kernels_including(path)
        found = {}
        for test, known in self._maps.items():
            own = {node: seconds for node, (seconds, _, of) in known["tests"].items() if not including.isdisjoint(of)}
            if own:
                found[test] = own
        return found


def map_name(root: Path, test: Path) -> str:
    """The name of the file that says what a version of a test module runs."""
    parts = test.relative_to(root / "tests").with_suffix("").parts
    return f"{'-'.join(parts)}.{hashlib.sha256(test.read_bytes()).hexdigest()[:12]}.json"


def lines_by_function(path: Path, lines: range) -> dict[str, set[int]]:
    """Lines of a file that are parts of functions, by function, numbered from its start."""
    found: dict[str, set[int]] = {}
    waiting = [compile(path.read_text(encoding="utf-8"), str(path), "exec")]
    while waiting:
        code = waiting.pop()
        waiting += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        own = {line for *_, line in code.co_lines() if line in lines}
        if own and code.co_flags & inspect.CO_NEWLOCALS:
            found[code.co_qualname] = {line - code.co_firstlineno for line in own}
    return found


def chosen_tests(imports: Imports, touched: Touched, path: Path, lines: range, budget: float) -> list[str]:
    """Tests that run some of the lines, the nearest modules first, within a budget of processor seconds.

    Each module has a part of the budget; what is left is for the quickest of all other tests.
    """
    running = touched.running(path, lines)
    order = [test for test in imports.tests_near(path) if test in running]
    order += sorted(running.keys() - set(order))
    chosen: dict[str, float] = {}
    left = budget
    for test in order:
        own = (NEAREST if test == order[0] else SHARE) * budget
        for node, seconds in sorted(running[test].items(), key=lambda item: item[1]):
            if seconds > min(own, left) and chosen:
                break
            chosen[node] = seconds
            own, left = own - seconds, left - seconds
    others = {node: seconds for own in running.values() for node, seconds in own.items() if node not in chosen}
    for node in sorted(others, key=others.__getitem__):
        left -= others[node]
        if left < 0.0:
            break
        chosen[node] = others[node]
    return list(chosen)
