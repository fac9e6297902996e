"""What the numbers were measured on."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from measuring import contention

from elvis.renderer.device.device import Device

PACKAGES = ("elvis-viz", "numpy", "h5py", "slangpy", "vtk")
ROOT = Path(__file__).resolve().parents[1]


def description(device: str) -> dict[str, Any]:
    """Date, processor, device, versions, and how busy the machine is."""
    return {
        "date": date.today().isoformat(),
        "revision": _revision(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": platform.platform(terse=True),
        "device": _label(device),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "contention": [round(contention(), 2)],
    }


def _label(device: str) -> str:
    """What a device is called."""
    with Device(device) as opened:
        return opened.adapter.label


def sentences(machine: dict[str, Any]) -> str:
    """The description in a paragraph."""
    versions = ", ".join(f"{name} {number}" for name, number in machine["versions"].items() if number)
    busy = ", ".join(f"{value:.2f}" for value in machine["contention"])
    return (
        f"{machine['date']}, revision {machine['revision']}. {machine['processor']}, {machine['cores']} cores, "
        f"{machine['system']}; device {machine['device']}. Python {machine['python']}, {versions}. "
        f"Clock over processor seconds of a busy loop: {busy} (1 on a quiet machine)."
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _revision() -> str:
    """Of the working tree, with a + where files differ from it."""
    try:
        revision = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
        changes = subprocess.run(["git", "status", "--short", "-uno"], cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return "unknown"
    return (revision.stdout.strip() or "unknown") + ("+" if changes.stdout.strip() else "")
