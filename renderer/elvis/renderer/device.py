"""Devices that run the kernels: Vulkan and CUDA GPUs, Vulkan in software, slang's CPU target.

slangpy is imported only here, and only when a device is opened or listed.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy.typing import DTypeLike, NDArray

from elvis.plugins.volume import Part, Quantity, interface_folder
from elvis.renderer.diagnostics import compiling, errors_alone
from elvis.renderer.errors import DeviceError, DeviceLostError

if TYPE_CHECKING:
    import slangpy

SHADERS = Path(__file__).parent / "shaders"
#: stages whose waves work on one element at a time
TOGETHER = ("cut_draw", "face_draw", "iso_split", "iso_draw", "iso_line", "volume_list", "volume_trace", "line_draw")
#: stages that hold many copies of an element's code, as formulas do: loops compile sooner
COMPACT = ("line_draw",)
#: pixels that a thread of cut_draw works on: CPUs like few long threads, GPUs many short ones
ROWS = {True: 8, False: 1}
#: groups of a row, as in shaders/dispatch.slang
GROUPS_IN_ROW = 32768
#: degree of the polynomials that stand for what isn't one, over a piece of an element
STAND_IN = 4
#: entries that lists start with, before their length is known
FIRST_CAPACITY = 1 << 16
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


class Device:
    """An open device: buffers, and kernels linked for the Slang type of a part."""

    def __init__(self, name: str = "auto") -> None:
        """Open a device (see choose)."""
        self.adapter = choose(name)
        self._device = _open(self.adapter)
        self._folders = [SHADERS, interface_folder()]
        self._session: slangpy.SlangSession | None = None
        self._kernels: dict[tuple[str, ...], Kernel] = {}
        self.bytes_made = 0  # of all buffers so far

    def close(self) -> None:
        """Give the device back; it can't be used any more."""
        self._kernels.clear()
        self._session = None
        self._device.close()

    def __enter__(self) -> Device:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def include(self, folder: Path) -> None:
        """Medium for the modules of plugins in this folder, and in no other plugin's."""
        if folder != self._folders[-1]:
            self._folders = [SHADERS, interface_folder(), folder]
            self._session = None

    def buffer(self, data: NDArray[Any]) -> slangpy.Buffer:
        """A buffer that holds the data; an empty array makes a buffer of one element."""
        data = np.ascontiguousarray(data).reshape(-1)
        data = data if len(data) else np.zeros(1, data.dtype)
        return self._create(data.dtype, len(data), data)

    def empty(self, dtype: DTypeLike, count: int) -> slangpy.Buffer:
        """A buffer of ``count`` elements without content."""
        return self._create(np.dtype(dtype), max(count, 1), None)

    def _create(self, dtype: np.dtype[Any], count: int, data: NDArray[Any] | None) -> slangpy.Buffer:
        import slangpy

        usage = slangpy.BufferUsage.shader_resource | slangpy.BufferUsage.unordered_access
        usage |= slangpy.BufferUsage.copy_source | slangpy.BufferUsage.copy_destination
        self.bytes_made += count * dtype.itemsize
        try:
            # plain bytes that could be written to: slangpy takes no other arrays
            raw = None if data is None else data.view(np.uint8)
            raw = raw if raw is None or raw.flags.writeable else raw.copy()
            return self._device.create_buffer(element_count=count, struct_size=dtype.itemsize, usage=usage, data=raw)
        except RuntimeError as error:
            size = count * dtype.itemsize / 2**20
            raise DeviceLostError(f"{self.adapter.label} has no room for a buffer of {size:.1f} MiB") from error

    def read(self, buffer: slangpy.Buffer, dtype: DTypeLike) -> NDArray[Any]:
        """The content of a buffer."""
        with working():
            content: NDArray[Any] = buffer.to_numpy().reshape(-1).view(np.uint8).view(dtype)
        return content

    def kernel(
        self,
        stage: str,
        part: Part | None = None,
        quantity: str | None = None,
        *,
        line_degree: int = 0,
        media: int = 1,
    ) -> Kernel:
        """The kernel of a stage (``cut_draw`` has the entry point ``draw``) for the elements of a part's Slang type.

        part         None for stages that know nothing of elements
        quantity     one of the part's, to be evaluated in place of its own field
        line_degree  of polynomials along rays; 0 takes that of the field
        media        number of transfer functions that are mixed along rays

        DeviceError with the compiler's own words where the part's module does not compile.
        """
        source = f"export static const int rows = {ROWS[self.adapter.software]};"
        source += f"export static const int media = {media};"
        if part is not None:
            source += _of_type(stage, part, part if quantity is None else part.quantities[quantity], line_degree)
        else:
            source += f"export static const int line_degree = {line_degree or STAND_IN};"
        key = (str(self._folders[-1]), stage, source)
        if key not in self._kernels:
            with compiling():
                self._kernels[key] = self._link(stage, source)
        return self._kernels[key]

    def _link(self, stage: str, source: str) -> Kernel:
        """Stage and element type meet here: the stage's ``extern struct TheVolume`` becomes the type."""
        import slangpy

        if self._session is None:
            options = slangpy.SlangCompilerOptions()
            options.include_paths = [str(folder) for folder in self._folders]
            self._session = self._device.create_slang_session(options)
        entry, name = self._session.load_module(stage), f"{stage}_{crc32(source.encode()):08x}"
        own = self._session.load_module_from_source(name, source)
        program = self._session.link_program([entry, own], [entry.entry_point(stage.rsplit("_", maxsplit=1)[-1])])
        return Kernel(self._device.create_compute_kernel(program), program)

    def listed(self, name: str, kernel: Kernel, run: Callable[[dict[str, slangpy.Buffer]], None]) -> NDArray[Any]:
        """What a kernel appends to the buffer ``name`` and counts in ``count``.

        It runs again with a longer list where the first was too short, so running twice must be harmless.
        """
        dtype = kernel.dtype(name)
        while True:
            lists = {name: self.empty(dtype, kernel.capacity), "count": self.buffer(np.zeros(1, np.uint32))}
            run(lists)
            count = int(self.read(lists["count"], np.uint32)[0])
            if count <= kernel.capacity:
                return self.read(lists[name], dtype)[:count].copy() if count else np.empty(0, dtype)
            kernel.capacity = count + count // 4


class Kernel:
    """A linked compute kernel; buffers are given by the names of its module's globals.

    capacity  entries of a list that it appends to: as many as the longest one had so far, and some more
    """

    def __init__(self, kernel: slangpy.ComputeKernel, program: slangpy.ShaderProgram) -> None:
        self._kernel, self.capacity = kernel, FIRST_CAPACITY
        self._group = int(program.layout.entry_points[0].compute_thread_group_size.x)
        # the cpu target wraps all globals in a constant buffer
        layout = program.layout.globals_type_layout
        self._globals = {item.name: item.type_layout for item in (layout.element_type_layout or layout).fields}
        self._dtypes: dict[str, np.dtype[Any]] = {}

    def dtype(self, name: str) -> np.dtype[Any]:
        """The NumPy dtype of one element of a structured buffer, as Slang lays it out."""
        if name not in self._dtypes:
            self._dtypes[name] = _dtype(self._globals[name].element_type_layout)
        return self._dtypes[name]

    def __call__(self, count: int, buffers: dict[str, slangpy.Buffer], *, groups: bool = False) -> None:
        """Run over ``count`` items, each a thread's or (``groups``) a whole group's, with the buffers it knows of."""
        import slangpy

        missing = self._globals.keys() - buffers.keys()
        if missing:
            raise DeviceError(f"kernel buffers {', '.join(sorted(missing))} are not bound")
        total = count if groups else -(-count // self._group)
        if total:
            row = min(total, GROUPS_IN_ROW)
            threads = slangpy.uint3(row * self._group, -(-total // row), 1)
            with working():
                self._kernel.dispatch(threads, vars={name: buffers[name] for name in self._globals})


@contextmanager
def working() -> Iterator[None]:
    """What goes wrong while the device works is a DeviceLostError in the driver's words."""
    try:
        yield
    except RuntimeError as error:
        raise DeviceLostError(f"the device failed: {' '.join(str(error).split()) or 'it was lost'}") from error


def _of_type(stage: str, part: Part, chosen: Part | Quantity, line_degree: int) -> str:
    """Slang text that makes a type a stage's ``TheVolume``."""
    together, compact = stage in TOGETHER, stage in COMPACT or chosen.type.startswith("Expressed<")
    return (
        f"import volume; import {part.module}; {chosen.source}\nexport struct TheVolume : IVolume = {chosen.type};"
        f"export static const bool lanes_together = {str(together).lower()};"
        f"export static const bool compact = {str(compact).lower()};"
        f"export static const int cube_degree = {chosen.degree or STAND_IN};"
        f"export static const int line_degree = {line_degree or chosen.degree or STAND_IN};"
        f"export static const bool cube_collapsed = {str(part.collapsed).lower()};"
    )


def _dtype(layout: Any) -> np.dtype[Any]:
    """Dtype of a reflected struct, array, vector or scalar."""
    import slangpy

    kinds, reflected = slangpy.TypeReflection.Kind, layout.type
    if reflected.kind == kinds.struct:
        fields = [(field.name, _dtype(field.type_layout), field.offset) for field in layout.fields]
        names, formats, offsets = (list(column) for column in zip(*fields, strict=True))
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": layout.stride})
    if reflected.kind == kinds.array:
        return np.dtype((_dtype(layout.element_type_layout), (reflected.element_count,)))
    return np.dtype((reflected.scalar_type.name, (reflected.col_count,) if reflected.kind == kinds.vector else ()))


def _enumerate(kind: str) -> list[Any]:
    """Adapters of a kind; none where its driver is missing."""
    import slangpy

    try:
        with _quiet():
            return list(slangpy.Device.enumerate_adapters(type=getattr(slangpy.DeviceType, kind)))
    except RuntimeError:
        return []


def _open(adapter: Adapter) -> slangpy.Device:
    import slangpy

    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "elvis" / "kernels"
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with _quiet():
            return slangpy.Device(
                type=getattr(slangpy.DeviceType, adapter.kind),
                adapter_luid=list(adapter.luid) or None,
                enable_hot_reload=False,
                enable_rhi_validation=False,
                enable_ray_tracing=False,
                shader_cache_path=cache,
            )
    except (RuntimeError, OSError) as error:
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
        ctypes.CDLL(None).fflush(None)
        for stream, original in zip((1, 2), saved, strict=True):
            os.dup2(original, stream)
            os.close(original)
        os.close(void)
