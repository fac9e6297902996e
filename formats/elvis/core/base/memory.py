"""Available memory, and the release of memory that is no longer needed."""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

#: mount point of Linux control groups: containers, jobs of a batch system, units of systemd
_GROUPS = Path("/sys/fs/cgroup")
#: files of a group in versions 1 and 2: its limit, its usage, and the key of the usage that is freed on demand
_FILES = {
    1: ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    2: ("memory.max", "memory.current", "inactive_file"),
}
#: bytes from which on an array has pages of its own, and the number of this setting in glibc's malloc.h
_OWN_PAGES, _MMAP_THRESHOLD = 1 << 22, -3
#: bytes of free memory at the end of the heap that stay with the process, and the number of this setting
_RETAINED, _TRIM_THRESHOLD = 1 << 27, -1


def settle_free_memory() -> None:
    """Let malloc return long arrays to the system when they are freed, and reuse the pages of short ones.

    By default, after an array was freed, glibc serves requests up to that size (at most 32 MiB) from one heap, where
    gaps between arrays stay with the process.  If only that is changed, the end of the heap is returned once a few
    short arrays there are freed: the next ones need new pages, and clearing these costs a virtual machine more than the
    arithmetic on the arrays.  Has no effect without glibc.
    """
    set_option = _of_glibc("mallopt")
    if set_option is not None:
        set_option(_MMAP_THRESHOLD, _OWN_PAGES)
        set_option(_TRIM_THRESHOLD, _RETAINED)


def release_free_memory() -> None:
    """Give memory that malloc keeps for later back to the system: after compilations that are hundreds of megabytes."""
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(0)


@cache
def c_library() -> ctypes.CDLL:
    """The C library of this process; each time that it is loaded leaves a reference cycle behind."""
    return ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)


def _of_glibc(name: str) -> Any:
    """A function that only glibc has; None elsewhere."""
    return getattr(c_library(), name, None) if sys.platform.startswith("linux") else None


def size_text(size: float) -> str:
    """A number of bytes in words, three digits and a unit that `elvis render --memory` takes: 1.5 GiB."""
    units = ["bytes", "KiB", "MiB", "GiB", "TiB"]
    while size >= 999.5 and len(units) > 1:
        size, units = size / 1024.0, units[1:]
    return f"{size:.3g} {units[0]}"


def peak_memory() -> int | None:
    """Peak memory of this process so far, in bytes; None if the system does not report it."""
    try:
        import resource
    except ImportError:  # on Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def free_memory() -> float:
    """Bytes of memory available to the system and to the control groups of this process.

    The total if the system does not report this, infinite if it reports neither.
    """
    return min(_of_system(), *_of_groups())


def _of_system() -> float:
    """Bytes that are free on this machine."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        names = os.sysconf_names if hasattr(os, "sysconf_names") else {}
        known = {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= names.keys()
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")) if known else float("inf")


def _of_groups(process: Path = Path("/proc/self/cgroup"), groups: Path = _GROUPS) -> list[float]:
    """Bytes available to each control group of a process that has a limit, and to the groups that contain it."""
    try:
        lines = process.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return [float("inf")]
    found = [float("inf")]
    for line in lines:
        number, controllers, path = line.split(":", 2)
        version = 2 if number == "0" else 1
        if version == 2 or "memory" in controllers.split(","):
            root = groups if version == 2 else groups / "memory"
            own = root / path.strip("/")
            # inside a container the path may belong to the machine, where it is not visible
            found += [_of_group(folder, version) for folder in (own, *own.parents) if folder.is_relative_to(root)]
    return found


def _of_group(folder: Path, version: int) -> float:
    """Bytes that are free to one group; infinite if it has no limit."""
    limit, used, reclaimable = _FILES[version]
    try:
        most, now = ((folder / name).read_text(encoding="ascii").strip() for name in (limit, used))
        if most == "max":
            return float("inf")
        statistics = (folder / "memory.stat").read_text(encoding="ascii").split()
        spare = int(statistics[statistics.index(reclaimable) + 1]) if reclaimable in statistics else 0
        return max(0.0, float(int(most) - int(now) + spare))
    except (OSError, ValueError):
        return float("inf")
