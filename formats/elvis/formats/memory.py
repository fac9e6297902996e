"""How much memory there is."""

from __future__ import annotations

import os


def free_memory() -> float:
    """Bytes of memory that are free; all there are where the system doesn't tell, infinite where it tells neither."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        names = os.sysconf_names if hasattr(os, "sysconf_names") else {}
        known = {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= names.keys()
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")) if known else float("inf")
