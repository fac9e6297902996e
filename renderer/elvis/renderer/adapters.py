"""Devices that can be asked for: Vulkan and CUDA GPUs, Vulkan in software, slang's CPU target."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from elvis.renderer.device_errors import DeviceError
from elvis.renderer.diagnostics import errors_alone
from elvis.renderer.kernel_cache import kernel_cache

if TYPE_CHECKING:
    import slangpy

SOFTWARE = ("llvmpipe", "swiftshader", "lavapipe")
#: what to install where no Vulkan device is found
ADVICE = "install a Vulkan driver (Debian and Ubuntu: libvulkan1 and mesa-vulkan-drivers, Mesa 23 or later)"


@dataclass(frozen=True)
class Adapter:
    """A device that can be asked for by ``name`` (``vulkan:0``, ``cuda:0``, ``cpu``)."""

    name: str
    label: str
    software: bool
    luid: tuple[int, ...] = ()

    @property
    def kind(self) -> str:
        """``vulkan``, ``cuda`` or ``cpu``."""
        return self.name.split(":")[0]


def adapters() -> list[Adapter]:
    """All devices, GPUs first, then software Vulkan, then the CPU target."""
    found: list[Adapter] = []
    for kind in ("vulkan", "cuda"):
        for number, info in enumerate(_enumerate(kind)):
            software = any(word in info.name.lower() for word in SOFTWARE)
            found.append(Adapter(f"{kind}:{number}", info.name, software, tuple(info.luid)))
    found.sort(key=lambda adapter: adapter.software)
    return [*found, Adapter("cpu", "slang's CPU target, one thread", True)]


def choose(name: str) -> Adapter:
    """The adapter of ``auto``, ``vulkan``, ``vulkan:N``, ``cuda`` or ``cpu``; DeviceError where there is none."""
    every = adapters()
    if name == "auto":
        return min(every, key=lambda a: (a.software, ("vulkan", "cuda", "cpu").index(a.kind)))
    fitting = [adapter for adapter in every if name in (adapter.name, adapter.kind)]
    if fitting:
        return fitting[0]
    known = ", ".join(adapter.name for adapter in every)
    advice = f"; {ADVICE}" if name.startswith("vulkan") else ""
    raise DeviceError(f"no device {name!r}: found {known}{advice}")


def _enumerate(kind: str) -> list[Any]:
    """Adapters of a kind; none where its driver is missing."""
    import slangpy

    try:
        with _quiet():
            return list(slangpy.Device.enumerate_adapters(type=getattr(slangpy.DeviceType, kind)))
    except RuntimeError:
        return []


def opened(adapter: Adapter) -> slangpy.Device:
    """An adapter's device; DeviceError where it can't be opened."""
    import slangpy

    try:
        with _quiet():
            return slangpy.Device(
                type=getattr(slangpy.DeviceType, adapter.kind),
                adapter_luid=list(adapter.luid) or None,
                enable_hot_reload=False,
                enable_rhi_validation=False,
                enable_ray_tracing=False,
                shader_cache_path=kernel_cache().private,
            )
    except RuntimeError as error:
        advice = f"; {ADVICE}" if adapter.kind == "vulkan" else ""
        raise DeviceError(f"the device {adapter.name} ({adapter.label}) can't be opened{advice}") from error


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep drivers and slangpy from chattering on the terminal while devices are looked for and opened."""
    saved, void = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    sys.stdout.flush()
    try:
        for stream in (1, 2):
            os.dup2(void, stream)
        with errors_alone():
            yield
    finally:
        # what C code has buffered goes nowhere too
        _c_library().fflush(None)
        for stream, original in zip((1, 2), saved, strict=True):
            os.dup2(original, stream)
            os.close(original)
        os.close(void)


@cache
def _c_library() -> ctypes.CDLL:
    """The C library of this process; each time that it is loaded leaves a reference cycle behind."""
    return ctypes.CDLL(None)
