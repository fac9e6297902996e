"""Devices that can be requested: Vulkan and CUDA GPUs, Vulkan in software, slang's CPU target."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from elvis.core.base.memory import c_library
from elvis.core.base.terminal import note
from elvis.renderer.device.compiled_modules import LinkedKernels
from elvis.renderer.device.diagnostics import errors_alone
from elvis.renderer.device.drawing import slangpy_module
from elvis.renderer.device.errors import DeviceError
from elvis.renderer.device.kernels.cache import kernel_cache

if TYPE_CHECKING:
    import slangpy

Opened = TypeVar("Opened")

SOFTWARE = ("llvmpipe", "swiftshader", "lavapipe")
#: what to install where no Vulkan device is found
ADVICE = "install a Vulkan driver (Debian and Ubuntu: libvulkan1 and mesa-vulkan-drivers, Mesa 23 or later)"
#: note if the CPU target draws for lack of a Vulkan driver: its processor time is 2.5 to 4 times that of Mesa's driver,
#: which uses all cores
ONE_CORE = f"no Vulkan device can draw here, so one CPU core does, several times slower; {ADVICE}"
#: what to install where slang's CPU target finds no compiler
COMPILER_ADVICE = "install a C++ compiler (g++)"
#: environment variable for Slang's optimisation of kernels, and its values
OPTIMIZATION = "ELVIS_SLANG_OPTIMIZATION"
LEVELS = ("none", "default", "high", "maximal")
#: level of the CPU target unless the environment requests one: at Slang's default level g++ optimises for size, so that
#: each sum of vectors is a function call; this takes four times the processor time
CPU_LEVEL = "maximal"
#: features that kernels use, as slangpy calls them -> in words
FEATURES = {"double": "64-bit floats", "pointer": "addresses of buffers", "wave_ops": "operations across a wave"}
#: slangpy-like name for the bytes that kernels can address in a bound buffer; Vulkan is queried directly
REACH = "max_storage_buffer_range"
#: limits that kernels need, as slangpy calls them -> smallest, in words; no shared memory is used
LIMITS = {
    "max_compute_threads_per_group": (64, "threads in a group"),
    "max_compute_dispatch_thread_groups": (32768, "groups in a row"),
    REACH: (1 << 27, "bytes of a bound buffer"),
}
#: place of maxStorageBufferRange in Vulkan's properties of a device, in numbers of 32 bits; how many there may be
_REACH_PLACE, _MOST_PROPERTIES = 81, 512
#: kinds of devices that say of themselves which features they have; CUDA has all, the CPU target answers none
ASKED = ("vulkan",)
#: of two devices alike otherwise the first kind is taken
KINDS = ("vulkan", "cuda", "cpu")


class UnfitError(DeviceError):
    """A device that is there, but can't be opened or lacks what kernels need; ``reason`` is a clause about it."""

    def __init__(self, adapter: Adapter, reason: str) -> None:
        super().__init__(f"the device {adapter.name} ({adapter.label}) {reason}")
        self.reason = reason


@dataclass(frozen=True)
class Adapter:
    """A device that can be requested by ``name`` (``vulkan:0``, ``cuda:0``, ``cpu``)."""

    name: str
    label: str
    software: bool
    luid: tuple[int, ...] = ()

    @property
    def kind(self) -> str:
        """``vulkan``, ``cuda`` or ``cpu``."""
        return self.name.split(":")[0]

    @property
    def shares(self) -> int:
        """Contiguous parts of a dispatch that are worked on side by side: llvmpipe has one for each processor.

        Mesa, src/gallium/drivers/llvmpipe/lp_cs_tpool.c.  GPUs take one group after the other: 1.
        """
        return (os.cpu_count() or 1) if self.software and self.kind == "vulkan" else 1


@dataclass(frozen=True)
class Choice(Generic[Opened]):
    """The adapter that draws, its open device, and the reasons why better ones were skipped.

    passed  a sentence for each of them
    """

    adapter: Adapter
    device: Opened
    passed: tuple[str, ...] = ()


def adapters() -> list[Adapter]:
    """All devices, GPUs first, then software Vulkan, then the CPU target where a compiler is found."""
    found: list[Adapter] = []
    for kind in ("vulkan", "cuda"):
        for number, info in enumerate(_enumerate(kind)):
            software = any(word in info.name.lower() for word in SOFTWARE)
            found.append(Adapter(f"{kind}:{number}", info.name, software, tuple(info.luid)))
    found.sort(key=lambda adapter: adapter.software)
    return [*found, Adapter("cpu", "slang's CPU target, one thread", True)] if has_compiler() else found


def has_compiler() -> bool:
    """Whether a compiler for slang's CPU target is in a place where slang searches.

    Outside Windows slang uses a compiler named g++, which is clang on macOS; it doesn't recognize other names of clang.
    """
    if sys.platform == "win32":
        installer = Path(os.environ.get("PROGRAMFILES(X86)", "")) / "Microsoft Visual Studio" / "Installer"
        return (installer / "vswhere.exe").is_file() or which("cl") is not None
    return which("g++") is not None


def open_device(name: str) -> Choice[slangpy.Device]:
    """The device of ``auto``, ``vulkan``, ``vulkan:N``, ``cuda`` or ``cpu``, opened (see first_fit)."""
    slangpy_module()
    found = first_fit(name, adapters(), open_adapter)
    if name == "auto" and found.adapter.kind == "cpu" and sys.platform.startswith("linux"):
        _tell_of_one_core()
    return found


@cache
def _tell_of_one_core() -> None:
    """Print once what makes pictures quicker."""
    note(ONE_CORE)


def first_fit(name: str, every: Sequence[Adapter], open_: Callable[[Adapter], Opened]) -> Choice[Opened]:
    """The first device of that name, or for ``auto`` the best one, that can do what kernels need.

    every  all adapters
    open_  opens an adapter, or raises UnfitError
    DeviceError if there is no such device, if the requested one is unfit, or if all are.
    """
    if name != "auto":
        fitting = [adapter for adapter in every if name in (adapter.name, adapter.kind)]
        if not fitting:
            raise DeviceError(f"no device {name!r}: {_adapter_names(every)}{_advice(name)}")
        return Choice(fitting[0], open_(fitting[0]))
    passed: list[str] = []
    for adapter in by_preference(every):
        try:
            return Choice(adapter, open_(adapter), tuple(passed))
        except UnfitError as error:
            passed.append(f"{adapter.label} is skipped: it {error.reason}")
    reasons = "".join(f"; {sentence}" for sentence in passed)
    raise DeviceError(f"no device can draw here{reasons}; {ADVICE}, or {COMPILER_ADVICE}, or use --device reference")


def by_preference(every: Sequence[Adapter]) -> list[Adapter]:
    """Adapters in the order in which ``auto`` tries them: GPUs, then software."""
    return sorted(every, key=lambda adapter: (adapter.software, KINDS.index(adapter.kind)))


def lacking(has: Callable[[str], bool]) -> str:
    """Missing features of a device that kernels need, as a clause; empty if there are none.

    has  whether it has a feature of slangpy's name
    """
    missing = [words for feature, words in FEATURES.items() if not has(feature)]
    return f"has no {' and no '.join(missing)}, which the kernels need" if missing else ""


def limited(granted: Callable[[str], int]) -> str:
    """Limits of a device that are below what kernels need, as a clause; empty if there are none.

    granted  the device's limit of slangpy's name
    """
    found = []
    for limit, (least, words) in LIMITS.items():
        if granted(limit) < least:
            found.append(f"grants {granted(limit)} {words}, but the kernels need {least}")
    return " and ".join(found)


def _adapter_names(every: Sequence[Adapter]) -> str:
    return "found " + ", ".join(adapter.name for adapter in every) if every else "found none at all"


def _advice(name: str) -> str:
    """Advice on installation for a kind of device; empty if there is none."""
    advice = {"vulkan": ADVICE, "cpu": COMPILER_ADVICE}.get(name.split(":")[0])
    return f"; {advice}" if advice else ""


def _enumerate(kind: str) -> list[Any]:
    """Adapters of a kind; none where its driver is missing."""
    slangpy = slangpy_module()
    try:
        with _quiet():
            return list(slangpy.Device.enumerate_adapters(type=getattr(slangpy.DeviceType, kind)))
    except RuntimeError:
        return []


def open_adapter(adapter: Adapter) -> slangpy.Device:
    """An adapter's device; UnfitError where it can't be opened or lacks what kernels need."""
    slangpy = slangpy_module()
    try:
        with _quiet():
            device = slangpy.Device(
                type=getattr(slangpy.DeviceType, adapter.kind),
                adapter_luid=list(adapter.luid) or None,
                enable_hot_reload=False,
                enable_rhi_validation=False,
                enable_ray_tracing=False,
                shader_cache_path=kernel_cache().private,
            )
    except RuntimeError as error:
        raise UnfitError(adapter, f"can't be opened{_advice(adapter.kind)}") from error
    if adapter.kind in ASKED:
        reason = lacking(partial(_has, device)) or limited(partial(_granted, device))
        if reason:
            device.close()
            raise UnfitError(adapter, reason)
    return device


def compiler(
    device: slangpy.Device, adapter: Adapter, folders: Sequence[Path]
) -> tuple[slangpy.SlangSession, LinkedKernels]:
    """A session of the Slang compiler for an open device, which finds modules in these folders, and its kernels.

    DeviceError if the environment requests an unknown level.
    """
    import slangpy

    level = os.environ.get(OPTIMIZATION, CPU_LEVEL if adapter.kind == "cpu" else "default")
    if level not in LEVELS:
        raise DeviceError(f"{OPTIMIZATION} is {level!r}: expected one of {', '.join(LEVELS)}")
    options = slangpy.SlangCompilerOptions()
    options.include_paths = [str(folder) for folder in folders]
    options.optimization = slangpy.SlangOptimizationLevel[level]
    kept = kernel_cache().modules.place(slangpy.__version__, adapter.kind, level, *map(str, folders))
    try:
        return device.create_slang_session(options, cache_path=kept), LinkedKernels(kept)
    except RuntimeError:
        # its folders can't be made
        return device.create_slang_session(options), LinkedKernels(None)


def _has(device: slangpy.Device, feature: str) -> bool:
    """Whether an open device has a feature.  For pointers slangpy answers for other targets: an address decides."""
    slangpy = slangpy_module()
    if feature != "pointer":
        return bool(device.has_feature(getattr(slangpy.Feature, feature)))
    usage = slangpy.BufferUsage.shader_resource
    return bool(device.create_buffer(element_count=1, struct_size=8, usage=usage).device_address)


def reach_of(adapter: Adapter, device: slangpy.Device) -> float:
    """Bytes that kernels reach of a bound buffer; software reaches all of it, whatever it grants."""
    is_limited = adapter.kind in ASKED and not adapter.software
    return _granted(device, REACH) if is_limited else float("inf")


def _granted(device: slangpy.Device, limit: str) -> int:
    """A limit of an open device; for limits with one value per direction, the first."""
    if limit == REACH:
        return _vulkan_reach(device)
    found = getattr(device.info.limits, limit)
    return int(found) if isinstance(found, int) else int(found[0])


def _vulkan_reach(device: slangpy.Device) -> int:
    """maxStorageBufferRange of a Vulkan device, which slangpy doesn't provide."""
    kind = slangpy_module().NativeHandleType.VkPhysicalDevice
    handle = next(handle.value for handle in device.native_handles if handle.type == kind)
    properties = (ctypes.c_uint32 * _MOST_PROPERTIES)()
    _vulkan().vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), properties)
    return int(properties[_REACH_PLACE])


def unfit(adapter: Adapter) -> str:
    """Why a GPU can't draw, as a clause; empty where it can.  Devices in software are not opened to be asked."""
    if adapter.software:
        return ""
    try:
        open_adapter(adapter).close()
    except UnfitError as error:
        return error.reason
    return ""


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress terminal output of drivers and slangpy while devices are listed and opened."""
    saved, void = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    sys.stdout.flush()
    try:
        for stream in (1, 2):
            os.dup2(void, stream)
        with errors_alone():
            yield
    finally:
        # also discard the buffers of C code
        c_library().fflush(None)
        for stream, original in zip((1, 2), saved, strict=True):
            os.dup2(original, stream)
            os.close(original)
        os.close(void)


@cache
def _vulkan() -> ctypes.CDLL:
    """Vulkan's loader, which slangpy has opened already."""
    names = {"win32": "vulkan-1.dll", "darwin": "libvulkan.1.dylib"}
    return ctypes.CDLL(names.get(sys.platform, "libvulkan.so.1"))
