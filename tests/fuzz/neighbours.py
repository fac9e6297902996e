"""Commands while others damage what they read: ``python tests/fuzz/neighbours.py [KIND=COUNT ...] [--seed N]``.

    watched  steps of a run are damaged, cut, emptied, removed and moved while ``elvis watch`` follows it
    caches   two processes fill one new cache; a third one damages its files and gives them to another user
    viewed   ``elvis view`` starts on a disk without room, stops, and starts again at the same port

A run of ``watched`` ends with the picture of the last sound step, ``caches`` with the files that one process writes,
``viewed`` with a page or one sentence.  No run prints a traceback or takes more than a minute.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from interruptions import ELVIS, Tally, limit_disk, place_for
from PIL import Image

from elvis import Dataset, Shape, write
from elvis.core.testing import approximated, grid

COUNTS = {"watched": 20, "caches": 20, "viewed": 10}
#: seconds after which a run counts as one that hangs
PATIENCE = 60.0
#: id of a user who owns nothing
NOBODY = 65534
PLANE = ("--plane", "z=0.4", "--size", "24x18", "--device", "reference")
RANGE = ("--range", "0:9")


def begin(folder: Path, *words: str, **settings: str) -> subprocess.Popen[str]:
    """The command, running in a folder."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*ELVIS, *words], cwd=folder, env=os.environ | settings, **pipes)


def ending(process: subprocess.Popen[str], what: str, tally: Tally) -> tuple[int, str]:
    """Status and messages of a process; those that aren't sentences of ElVis, and a process that hangs, are faults."""
    try:
        _, text = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        _, text = process.communicate()
        tally.faults.append(f"{what}: hangs: {text[-500:]}")
    lines = [line for line in text.splitlines() if line]
    strange = [line for line in lines if not re.match(r"elvis: (note|warning|error): ", line) or len(line) > 2000]
    if strange:
        tally.faults.append(f"{what}: prints {strange[:20]}")
    if process.returncode not in (0, 1, 130):
        tally.faults.append(f"{what}: status {process.returncode}: {lines[-3:]}")
    return process.returncode, text


def constant(value: float) -> Dataset:
    """A cube with a field of one value, which is also the time."""
    bare = Dataset(grid(Shape.HEXAHEDRON, 1))
    return replace(bare, fields=(approximated(bare, "u", lambda x: value + 0 * x[:, 0], 3),), time=value)


def write_step(folder: Path, value: float) -> Path:
    """A step of a run, whose field is its number."""
    path = folder / f"s_{value:.0f}.chk"
    write(constant(value), folder / "m.xml", path)
    return path


def harm(path: Path, dice: random.Random) -> None:
    """Damage a file in one of several ways; it may be gone."""
    try:
        content = bytearray(path.read_bytes())
        kind = dice.randrange(6)
        if kind == 0:
            path.unlink()
        elif kind == 1:
            path.write_bytes(content[: dice.randrange(len(content) + 1)])
        elif kind == 2:
            path.write_bytes(b"")
        elif kind == 3:
            path.rename(path.with_name("elsewhere"))
        elif kind == 4 and content:
            for _ in range(20):
                content[dice.randrange(len(content))] = dice.randrange(256)
            path.write_bytes(content)
        else:
            os.utime(path)
    except FileNotFoundError:
        return


def watched(folder: Path, dice: random.Random, tally: Tally) -> str:
    """The picture at the end is that of the last sound step."""
    write_step(folder, 1)
    words = ("m.xml", "s_*.chk", *PLANE, *RANGE)
    process = begin(folder, "watch", *words, "--every", "0.05", "--idle", "2", "-o", "latest.png")
    time.sleep(dice.uniform(0.3, 1.0))
    for value in range(2, 6):
        path = write_step(folder, value)
        for _ in range(dice.randrange(4)):
            time.sleep(dice.uniform(0, 0.15))
            harm(dice.choice([path, folder / "s_1.chk", folder / "m.xml"]), dice)
    for path in folder.glob("s_*.chk"):
        path.unlink()
    write_step(folder, 8)
    status, text = ending(process, "watch", tally)
    expected = begin(folder, "render", "m.xml", "s_8.chk", *PLANE, *RANGE, "-o", "expected.png")
    expected.communicate()
    found, wanted = (np.array(Image.open(folder / name)) for name in ("latest.png", "expected.png"))
    if status or not np.array_equal(found, wanted):
        tally.faults.append(f"watch: status {status}, and the picture is not that of the last step: {text[-300:]}")
    return f"status {status}"


def caches(folder: Path, dice: random.Random, tally: Tally) -> str:
    """Two processes, whatever happens to their cache, write what one without a cache writes."""
    write(constant(3.0), folder / "m.xml", folder / "m.fld")
    exported = begin(folder, "export", "m.xml", "m.fld", "-o", "m.vtu")
    exported.communicate()
    words = ("convert", "m.vtu", "--format", "text", "-o")
    begin(folder, *words, "expected.xml", XDG_CACHE_HOME=str(folder / "other")).communicate()
    place = folder / "cache"
    for number in range(3):
        runs = [begin(folder, *words, f"{number}{each}.xml", XDG_CACHE_HOME=str(place)) for each in "ab"]
        until = time.monotonic() + PATIENCE
        while any(run.poll() is None for run in runs) and time.monotonic() < until:
            time.sleep(dice.uniform(0, 0.1))
            kept = [path for path in place.rglob("*") if path.is_file()]
            if kept and dice.random() < 0.3:
                harm(dice.choice(kept), dice)
        for run in runs:
            ending(run, "two with one cache", tally)
        for suffix in ("xml", "fld"):
            names = [folder / f"{stem}.{suffix}" for stem in ("expected", f"{number}a", f"{number}b")]
            if len({path.read_bytes() if path.is_file() else None for path in names}) != 1:
                tally.faults.append(f"two with one cache: {suffix} files differ")
        if not os.geteuid():
            for path in place.rglob("*"):
                harm(path, dice) if path.is_file() else None
                os.chown(path, NOBODY, NOBODY) if path.exists() else None
    return "done"


def viewed(folder: Path, dice: random.Random, tally: Tally) -> str:
    """It serves its page, or says why not, and starts again where it has been."""
    write(constant(3.0), folder / "m.xml", folder / "m.fld")
    (folder / "tmp").mkdir()
    limit_disk(folder, dice.choice((0, 0, 4096, 65536)))
    settings = {"TMPDIR": str(folder / "tmp"), "XDG_CACHE_HOME": str(folder / "tmp")}
    found, port = [], "0"
    for _ in range(3):
        process = begin(folder, "view", "m.xml", "m.fld", "--no-browser", "--port", port, **settings)
        address = re.search(r"http://\S+", process.stdout.readline() or "")
        if address:
            port = address[0].split(":")[2].split("/")[0]
            with urllib.request.urlopen(address[0], timeout=PATIENCE) as page:
                found.append(str(page.status))
        process.send_signal(signal.SIGINT)
        status, text = ending(process, "view", tally)
        if not address:
            found.append(f"status {status}: {text.splitlines()[-1:]}")
    return ", ".join(found)


KINDS: dict[str, Callable[[Path, random.Random, Tally], str]] = {"watched": watched, "caches": caches, "viewed": viewed}


def main() -> int:
    """Print what became of all runs, and what should not have happened."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("counts", nargs="*", metavar="KIND=COUNT", help=", ".join(COUNTS))
    given = parser.parse_args()
    counts = {kind: int(count) for kind, count in (each.split("=") for each in given.counts)} or COUNTS
    tally = Tally()
    for kind, count in counts.items():
        dice = random.Random(f"{kind} {given.seed}")
        for _ in range(count):
            with place_for("disks" if kind == "viewed" else kind) as folder:
                tally.counts[kind, KINDS[kind](folder, dice, tally)] += 1
    return tally.report()


if __name__ == "__main__":
    if shutil.which("mount") is None:
        print("there is no mount: disks have room", file=sys.stderr)
    sys.exit(main())
