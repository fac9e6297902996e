"""Install the wheel and the sdist into empty environments and work there as a user would; prints a table.

    python packaging/try_wheels.py [--python 3.12 ...] [--keep FOLDER] [--resolve]

Every Python from 3.10 to 3.14 that is on the path or among those of pyenv takes the wheel by pip; the newest one takes
it by uv, where that is installed, and the sdist by pip, too.  An environment sees neither the repository nor this one's
packages, and a home that can't be written to.  Pictures are drawn with the Vulkan driver that the machine has, and with
none.  A picture that can't be drawn for want of a device is well where one sentence says what is missing.

needs   build and hatchling
seconds are those of the clock; a first picture's with its kernels compiled, which nothing has kept
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).resolve().parent.parent
VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
PLATFORMS = (
    "x86_64-manylinux_2_28",
    "x86_64-manylinux_2_34",
    "aarch64-manylinux_2_28",
    "aarch64-manylinux_2_34",
    "aarch64-apple-darwin",
    "x86_64-apple-darwin",
    "x86_64-pc-windows-msvc",
)
#: where folders of commands are in an environment
BIN = "Scripts" if os.name == "nt" else "bin"
#: what hides every Vulkan driver
NO_DRIVER = {"VK_ICD_FILENAMES": "/nonexistent", "VK_DRIVER_FILES": "/nonexistent"}
CUT = ("blocks.xml", "blocks.fld", "--plane", "1.5,0.5,0.45:0.1,0.2,1", "--size", "64x64", "--overwrite")
#: what is done in an environment: a name, arguments of elvis, variables on top, whether it may say what drawing needs
WORK: tuple[tuple[str, tuple[str, ...], dict[str, str], bool], ...] = (
    ("help", ("--help",), {}, False),
    ("info", ("info", "blocks.xml", "blocks.fld"), {}, False),
    ("norms", ("norms", "blocks.xml", "blocks.fld"), {}, False),
    ("probe", ("probe", "blocks.xml", "blocks.fld", "--line", "0.1,0.1,0.1:0.2,0.2,0.2", "-n", "3"), {}, False),
    ("convert", ("convert", "eddies0.f00000", "-o", "eddies.xml", "--overwrite"), {}, False),
    ("picture", ("render", *CUT, "-o", "a.png"), {}, True),
    ("no driver", ("render", *CUT, "-o", "b.png"), NO_DRIVER, True),
    ("reference", ("render", *CUT, "-o", "c.png", "--device", "reference"), NO_DRIVER, False),
)


@dataclass
class Trial:
    """An environment: which Python, what was installed, by what, and how it went."""

    python: str
    source: str
    installer: str
    install: float = 0.0
    megabytes: float = 0.0
    seconds: dict[str, str] | None = None
    fault: str = ""

    def row(self) -> list[str]:
        """Cells of the table."""
        times = [(self.seconds or {}).get(name, "-") for name, *_ in WORK]
        size = f"{self.megabytes:.0f}"
        return [self.python, self.source, self.installer, f"{self.install:.0f}", size, *times, self.fault or "ok"]


def interpreters(wanted: list[str]) -> Iterator[tuple[str, str]]:
    """Versions and the Pythons that have them, oldest first."""
    for version in wanted:
        folder = Path.home() / ".pyenv" / "versions"
        found = [shutil.which(f"python{version}"), *sorted(map(str, folder.glob(f"{version}.*/{BIN}/python")))]
        if sys.version_info[:2] == tuple(map(int, version.split("."))):
            found.insert(0, sys.executable)
        for candidate in filter(None, found):
            if subprocess.run([candidate, "-c", "import venv, ensurepip"], capture_output=True).returncode == 0:
                yield version, candidate
                break


def isolated(folder: Path) -> dict[str, str]:
    """Variables of a process that knows nothing of this one's: a home that can't be written to, by root neither."""
    home = folder / "home"
    home.mkdir(exist_ok=True)
    home.chmod(0o555)
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    kept = {name: os.environ[name] for name in ("SYSTEMROOT", "TEMP", "TMP", "PROGRAMFILES(X86)") if name in os.environ}
    system = os.environ["PATH"] if os.name == "nt" else "/usr/local/bin:/usr/bin:/bin"
    return {"PATH": system, "HOME": "/proc/nobody" if is_root else str(home), **kept}


def run(command: list[str], folder: Path, environ: dict[str, str]) -> tuple[int, str, float]:
    """Exit status, the last line on standard error, seconds."""
    start = perf_counter()
    process = subprocess.run(command, cwd=folder, env=environ, capture_output=True, text=True, timeout=900)
    lines = process.stderr.strip().splitlines() or [""]
    return process.returncode, lines[-1], perf_counter() - start


def work(commands: Path, folder: Path, environ: dict[str, str]) -> tuple[dict[str, str], str]:
    """Seconds of each thing that the ``elvis`` among some commands does in a folder with data; the first fault."""
    seconds, fault = {}, ""
    for name, arguments, more, may_refuse in WORK:
        elvis = shutil.which("elvis", path=str(commands)) or "elvis"
        status, words, spent = run([elvis, *arguments], folder, environ | more)
        refused = may_refuse and status == 1 and ("drawing needs" in words or "no device can draw" in words)
        seconds[name] = "says why" if refused else f"{spent:.1f}" if status == 0 else "FAILS"
        if status and not refused:
            fault = fault or f"{name}: {words}"
    return seconds, fault


def tried(trial: Trial, python: str, artifact: Path, folder: Path) -> Trial:
    """The trial, carried out in an empty folder."""
    environment, environ = folder / "environment", isolated(folder)
    subprocess.run([python, "-m", "venv", environment], check=True, capture_output=True)
    inside = str(environment / BIN / "python")
    before = size(environment)
    pip = [inside, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(artifact)]
    uv = [shutil.which("uv") or "uv", "pip", "install", "--quiet", "--python", inside, str(artifact)]
    # pip and uv need the home where they are configured and keep what they fetched
    status, words, trial.install = run(pip if trial.installer == "pip" else uv, folder, dict(os.environ))
    trial.megabytes = size(environment) - before
    if status:
        trial.fault = words
        return trial
    # the sample data, made by what was installed
    shutil.copy(ROOT / "examples" / "generate.py", folder)
    status, words, _ = run([inside, "generate.py", "."], folder, environ)
    trial.fault = words if status else ""
    if not status:
        trial.seconds, trial.fault = work(environment / BIN, folder, environ)
    return trial


def size(folder: Path) -> float:
    """Megabytes of a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink()) / 1e6


def built(folder: Path) -> tuple[Path, Path]:
    """The wheel, built from the sdist, and the sdist."""
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def print_table(header: list[str], rows: list[list[str]]) -> None:
    """Columns, as wide as they must be."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    for row in (header, *rows):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip(), flush=True)


def print_resolved() -> None:
    """Print which slangpy is installed where, for each Python, or that the installation would fail."""
    rows = []
    for platform in PLATFORMS:
        cells = []
        for version in VERSIONS:
            chosen = ["--python-version", version, "--python-platform", platform, "--only-binary", ":all:"]
            command = ["uv", "pip", "compile", "--quiet", "--no-header", "--no-annotate", *chosen, "pyproject.toml"]
            process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            found = [line.partition("==")[2] for line in process.stdout.splitlines() if line.startswith("slangpy==")]
            cells.append("fails" if process.returncode else found[0] if found else "without")
        rows.append([platform, *cells])
    print_table(["slangpy on", *VERSIONS], rows)


def main() -> int:
    """Try everything; 1 where anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", nargs="*", default=list(VERSIONS), metavar="X.Y", help="versions to try")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="leave the wheel and the sdist there")
    parser.add_argument("--resolve", action="store_true", help="only look up what would be installed elsewhere")
    options = parser.parse_args()
    if options.resolve:
        print_resolved()
        return 0
    done = tried_all(options.python, options.keep)
    print_table(["python", "of", "by", "install s", "MB", *(name for name, *_ in WORK), ""], [t.row() for t in done])
    return int(any(trial.fault for trial in done))


def tried_all(versions: list[str], keep: Path | None) -> list[Trial]:
    """Every trial, carried out; the wheel and the sdist are left in a folder where one is named."""
    done = []
    with tempfile.TemporaryDirectory() as name:
        wheel, sdist = built(Path(name))
        if keep:
            keep.mkdir(parents=True, exist_ok=True)
            for path in (wheel, sdist):
                shutil.copy(path, keep)
        pythons = list(interpreters(versions))
        newest, last = pythons[-1]
        plan = [(Trial(version, "wheel", "pip"), python, wheel) for version, python in pythons]
        plan.append((Trial(newest, "sdist", "pip"), last, sdist))
        if shutil.which("uv"):
            plan.append((Trial(newest, "wheel", "uv"), last, wheel))
        for trial, python, artifact in plan:
            with tempfile.TemporaryDirectory() as place:
                done.append(tried(trial, python, artifact, Path(place)))
            print(*done[-1].row(), file=sys.stderr, flush=True)
    return done


if __name__ == "__main__":
    sys.exit(main())
