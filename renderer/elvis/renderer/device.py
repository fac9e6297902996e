"""An open device: its buffers, and kernels linked for the Slang type of a part."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any
from weakref import WeakSet
from zlib import crc32

import numpy as np
from numpy.typing import DTypeLike, NDArray

from elvis.plugins.volume import Part, Quantity, interface_folder
from elvis.renderer.adapters import open_device
from elvis.renderer.announcing import Announcement
from elvis.renderer.device_errors import DeviceError, DeviceLostError
from elvis.renderer.diagnostics import compiling
from elvis.renderer.kernel_cache import KernelCache, kernel_cache
from elvis.renderer.pacing import Pace, Watch

if TYPE_CHECKING:
    import slangpy

_HERE = Path(__file__).parent
#: where kernels are: those of a pass stand beside its Python, what passes share in shaders
SHADERS = [_HERE / "shaders", *sorted(path for path in (_HERE / "passes").iterdir() if any(path.glob("*.slang")))]
#: stages whose waves work on one element at a time
TOGETHER = ("cut_draw", "face_draw", "iso_draw", "iso_line", "volume_list", "volume_trace", "line_draw")
#: stages that hold many copies of an element's code, as formulas do: loops compile sooner
COMPACT = ("line_draw",)
#: pixels that a thread of cut_draw works on: CPUs like few long threads, GPUs many short ones
ROWS = {True: 8, False: 1}
#: groups of a row, as in dispatch.slang
GROUPS_IN_ROW = 32768
#: degree of the polynomials that stand for what isn't one, over a sub-element
STAND_IN = 4
#: the same where it is known how far from them it may be
ENCLOSED = 7
#: entries that lists start with, before their length is known
FIRST_CAPACITY = 1 << 16
#: the number of a dispatch's first group, as in dispatch.slang
OFFSET = "first_group"
#: message of the error where a closed device is used
CLOSED = "the device is closed: open another one"


class Buffer:
    """Memory of a device: given back with the last reference to it, or when the device is closed."""

    def __init__(self, memory: slangpy.Buffer) -> None:
        self._memory: slangpy.Buffer | None = memory

    @property
    def memory(self) -> slangpy.Buffer:
        """What slangpy knows it as; DeviceError where the device is closed."""
        if self._memory is None:
            raise DeviceError(CLOSED)
        return self._memory

    def release(self) -> None:
        """Give the memory back, whoever still refers to the buffer."""
        self._memory = None


class Device:
    """An open device: buffers, and kernels linked for the Slang type of a part.

    Closing it frees all of them at once, also those that an exception's frames or a reference cycle still hold: slangpy
    keeps a device, its threads and its memory for as long as one buffer or kernel of it is there.

    passed  a sentence for each better device that ``auto`` could not take
    watch   what its kernels do between dispatches
    """

    def __init__(self, name: str = "auto") -> None:
        """Open a device (see first_fit)."""
        choice = open_device(name)
        self.adapter, self.passed = choice.adapter, choice.passed
        self._opened: slangpy.Device | None = choice.device
        self.cache = kernel_cache()
        self._announcement = Announcement(self.cache, self.adapter.software)
        self.watch = Watch(choice.device.wait_for_idle, _keeping(choice.device, self.cache, self._announcement))
        self._folders = [*SHADERS, interface_folder()]
        self._session: slangpy.SlangSession | None = None
        self._kernels: dict[tuple[str, ...], Kernel] = {}
        self._buffers: WeakSet[Buffer] = WeakSet()
        self.bytes_made = 0  # of all buffers so far

    @property
    def _device(self) -> slangpy.Device:
        if self._opened is None:
            raise DeviceError(CLOSED)
        return self._opened

    def close(self) -> None:
        """Give the device back with all that was made on it; it can't be used any more.  Closing twice is harmless."""
        for buffer in self._buffers:
            buffer.release()
        for kernel in self._kernels.values():
            kernel.release()
        self._kernels.clear()
        self._session, self.watch = None, Watch.none()
        device, self._opened = self._opened, None
        if device is not None:
            device.close()

    def __enter__(self) -> Device:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def include(self, folder: Path) -> None:
        """Let kernels import the Slang modules of a plugin in this folder, and of no other plugin."""
        if folder != self._folders[-1]:
            self._folders = [*SHADERS, interface_folder(), folder]
            self._session = None

    def buffer(self, data: NDArray[Any]) -> Buffer:
        """A buffer that holds the data; an empty array makes a buffer of one element."""
        data = np.ascontiguousarray(data).reshape(-1)
        data = data if len(data) else np.zeros(1, data.dtype)
        return self._create(data.dtype, len(data), data)

    def empty(self, dtype: DTypeLike, count: int) -> Buffer:
        """A buffer of ``count`` elements without content."""
        return self._create(np.dtype(dtype), max(count, 1), None)

    def _create(self, dtype: np.dtype[Any], count: int, data: NDArray[Any] | None) -> Buffer:
        import slangpy

        usage = slangpy.BufferUsage.shader_resource | slangpy.BufferUsage.unordered_access
        usage |= slangpy.BufferUsage.copy_source | slangpy.BufferUsage.copy_destination
        self.bytes_made += count * dtype.itemsize
        try:
            # plain bytes that could be written to: slangpy takes no other arrays
            raw = None if data is None else data.view(np.uint8)
            raw = raw if raw is None or raw.flags.writeable else raw.copy()
            memory = self._device.create_buffer(element_count=count, struct_size=dtype.itemsize, usage=usage, data=raw)
        except RuntimeError as error:
            size = count * dtype.itemsize / 2**20
            raise DeviceLostError(f"{self.adapter.label} has no room for a buffer of {size:.1f} MiB") from error
        buffer = Buffer(memory)
        self._buffers.add(buffer)
        return buffer

    def read(self, buffer: Buffer, dtype: DTypeLike) -> NDArray[Any]:
        """The content of a buffer."""
        with working():
            content: NDArray[Any] = buffer.memory.to_numpy().reshape(-1).view(np.uint8).view(dtype)
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
            source += _of_type(stage, part, part.quantity(quantity), line_degree)
        else:
            source += f"export static const int line_degree = {line_degree or STAND_IN};"
        key = (str(self._folders[-1]), stage, source)
        if key not in self._kernels:
            self._announcement.expect()
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
        return Kernel(self._device.create_compute_kernel(program), program, self.watch)

    def appended(self, name: str, kernel: Kernel, run: Callable[[dict[str, Buffer]], None]) -> NDArray[Any]:
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
    """A linked compute kernel; buffers are given by the names of its module's globals, bound or read through pointers.

    capacity  entries of a list that it appends to: as many as the longest one had so far, and some more
    """

    def __init__(self, kernel: slangpy.ComputeKernel, program: slangpy.ShaderProgram, watch: Watch) -> None:
        self._kernel: slangpy.ComputeKernel | None = kernel
        self._watch: Watch | None = watch
        self._pace, self.capacity = Pace(), FIRST_CAPACITY
        self._group = int(program.layout.entry_points[0].compute_thread_group_size.x)
        # the cpu target wraps all globals in a constant buffer
        layout = program.layout.globals_type_layout
        fields = (layout.element_type_layout or layout).fields
        self._globals: dict[str, slangpy.TypeLayoutReflection] = {item.name: item.type_layout for item in fields}
        self._dtypes: dict[str, np.dtype[Any]] = {}

    def release(self) -> None:
        """Give the program back, whoever still refers to the kernel."""
        self._kernel, self._watch = None, None
        self._globals = {}

    def dtype(self, name: str) -> np.dtype[Any]:
        """The NumPy dtype of one element of a structured buffer, as Slang lays it out."""
        if name not in self._dtypes:
            self._dtypes[name] = _dtype(self._globals[name].element_type_layout)
        return self._dtypes[name]

    def __call__(
        self, count: int, buffers: dict[str, Buffer], *, groups: bool = False, work: NDArray[Any] | None = None
    ) -> None:
        """Run over ``count`` items, each a thread's or (``groups``) a whole group's, with the buffers it knows of.

        work  (count,) how much each group has to do, in any unit, where they differ much
        Long work is done in several dispatches (see Device.watch); it is done on return.
        """
        if self._kernel is None or self._watch is None:
            raise DeviceError(CLOSED)
        missing = self._globals.keys() - buffers.keys() - {OFFSET}
        if missing:
            raise DeviceError(f"kernel buffers {', '.join(sorted(missing))} are not bound")
        bound = {name: self._argument(name, buffers[name]) for name in self._globals if name != OFFSET}
        total = count if groups else -(-count // self._group)
        fresh, start = not self._pace.compiled, perf_counter()
        with working():
            for first, end in self._pace.batches(total, GROUPS_IN_ROW, work):
                self._dispatch(first, end - first, bound)
                self._watch.after_dispatch()
        if fresh:
            self._watch.compiled(perf_counter() - start)

    def _argument(self, name: str, buffer: Buffer) -> slangpy.Buffer | int:
        """What stands for a buffer: its address where the module reads it through a pointer, else itself."""
        import slangpy

        is_pointer = self._globals[name].type.kind == slangpy.TypeReflection.Kind.pointer
        return buffer.memory.device_address if is_pointer else buffer.memory

    def _dispatch(self, first: int, total: int, bound: dict[str, Any]) -> None:
        """Run some groups from the first one on, in rows that devices allow."""
        import slangpy

        assert self._kernel is not None
        row = min(total, GROUPS_IN_ROW)
        threads = slangpy.uint3(row * self._group, -(-total // row), 1)
        self._kernel.dispatch(threads, vars={**bound, OFFSET: first})


def _keeping(device: slangpy.Device, cache: KernelCache, announcement: Announcement) -> Callable[[float], None]:
    """Keeps what a device has compiled since the last call; is told how many seconds that took."""
    kept = 0

    def keep(seconds: float) -> None:
        nonlocal kept
        compiled = device.shader_cache_stats.miss_count
        if compiled > kept:
            kept = compiled
            announcement.note(seconds)
            cache.keep()

    return keep


@contextmanager
def working() -> Iterator[None]:
    """What goes wrong while the device works is a DeviceLostError in the driver's words."""
    try:
        yield
    except RuntimeError as error:
        raise DeviceLostError(f"the device failed: {' '.join(str(error).split()) or 'it was lost'}") from error


def _of_type(stage: str, part: Part, chosen: Part | Quantity, line_degree: int) -> str:
    """Slang text that makes a type a stage's ``TheVolume``."""
    chosen_leaves = _leaves(chosen) if stage.startswith("iso_") else ""
    together, compact = stage in TOGETHER, stage in COMPACT or chosen.type.startswith("Expressed<")
    return (
        f"import volume; import {part.module}; {chosen.source}\nexport struct TheVolume : IVolume = {chosen.type};"
        f"export static const bool lanes_together = {str(together).lower()};"
        f"export static const bool compact = {str(compact).lower()};"
        f"export static const int cube_degree = {chosen.degree or stand_in(chosen)};"
        f"export static const int line_degree = {line_degree or chosen.degree or STAND_IN};"
        f"export static const bool cube_collapsed = {str(part.collapsed).lower()};{chosen_leaves}"
    )


def stand_in(chosen: Part | Quantity) -> int:
    """Degree of the polynomials that stand for a quantity that is none, over a sub-element."""
    return STAND_IN if chosen.enclosure is None else max(ENCLOSED, chosen.enclosure.map_degree)


def _leaves(chosen: Part | Quantity) -> str:
    """Slang text that says what a quantity is made of where it is no polynomial, but enclosed."""
    enclosure = chosen.enclosure
    if chosen.degree or enclosure is None:
        return ""
    return (
        f"export struct TheLeaves : ILeaves = {enclosure.type};"
        "export static const bool analytic = true;"
        f"export static const int leaf_fields = {enclosure.fields};"
        f"export static const int leaf_degree = {enclosure.degree};"
        f"export static const bool leaf_total = {str(enclosure.is_total).lower()};"
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
