"""An open device: its buffers, and kernels linked for the Slang type of a part."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, cached_property
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias
from zlib import crc32

import numpy as np
from numpy.typing import DTypeLike, NDArray

from elvis.core.base.memory import size_text
from elvis.plugins.runtime.volume import Part, Quantity, interface_folder
from elvis.renderer.device.adapters import Adapter, compiler, open_device, reach_of
from elvis.renderer.device.announcing import Announcement
from elvis.renderer.device.compiled_modules import LinkedKernels
from elvis.renderer.device.diagnostics import compiling
from elvis.renderer.device.errors import DeviceError, DeviceLostError
from elvis.renderer.device.kernels.cache import KernelCache, kernel_cache
from elvis.renderer.device.kernels.elsewhere import Elsewhere
from elvis.renderer.device.kernels.failures import naming_what_fails
from elvis.renderer.device.layouts import dtype_of
from elvis.renderer.device.leaf_types import enclosure_of, leaves, leaves_along_rays, works_together
from elvis.renderer.device.memory import CLOSED, Buffer, Pool
from elvis.renderer.device.pacing import Pace, Watch, grid_of, rows_of

if TYPE_CHECKING:
    import slangpy

_HERE = Path(__file__).parents[1]
#: folders of kernels: a pass has them next to its Python, shared ones in shaders
SHADERS = [_HERE / "shaders", *sorted(path for path in (_HERE / "passes").iterdir() if any(path.glob("*.slang")))]
#: stages whose waves work on one element at a time
TOGETHER = ("cut_draw", "face_draw", "iso_draw", "iso_line", "volume_list", "volume_trace", "line_draw")
#: stages that evaluate elements with all lanes of a wave; the number of lanes that read for one another in software
SHARING, SHARING_LANES = ("cut_draw", "face_draw", "iso_draw", "volume_trace"), 8
#: stages that hold many copies of an element's code, as formulas do: loops compile sooner
COMPACT = ("line_draw", "trace_follow", "volume_bends")
#: stages that bound quantities along rays
ALONG_RAYS = ("volume_trace", "volume_bends")
#: pixels that a thread of cut_draw works on: CPUs like few long threads, GPUs many short ones
ROWS = {True: 8, False: 1}
#: degree of the polynomials that stand for what isn't one, over a sub-element
STAND_IN = 4
#: the same where it is known how far from them it may be
ENCLOSED = 7
#: bytes that are sooner read than left out
FEW = 1 << 13
#: entries that lists start with, before their length is known
FIRST_CAPACITY = 1 << 16
#: which groups a dispatch has, as in dispatch.slang
EXTENT = "extent"
#: the number of items of all dispatches together, for kernels that declare it: buffers may have room for more
COUNT = "item_count"
#: what kernels are given by name: buffers, and records (1,)
Given: TypeAlias = Mapping[str, Buffer | NDArray[Any]]


class Device:
    """An open device: buffers, and kernels linked for the Slang type of a part.

    Closing it frees all of them at once, also those referenced by an exception's frames or a reference cycle: slangpy
    keeps a device, its threads and its memory as long as one buffer or kernel of it exists.

    passed  a sentence for each better device that ``auto`` could not use
    watch   work of its kernels between dispatches
    reach   bytes that kernels can address in a bound buffer
    """

    def __init__(self, name: str = "auto") -> None:
        """Open a device (see first_fit)."""
        choice = open_device(name)
        self.adapter, self.passed = choice.adapter, choice.passed
        self._opened: slangpy.Device | None = choice.device
        self.reach = reach_of(self.adapter, choice.device)
        self.cache = kernel_cache()
        self._announcement = Announcement(self.cache, self.adapter.software)
        self._elsewhere = Elsewhere(self.adapter, self.cache.private)
        keep = _keeping(choice.device, self.cache, self._announcement, self._elsewhere)
        self.watch = Watch(choice.device.is_submit_finished, choice.device.wait_for_idle, keep)
        self._folders = [*SHADERS, interface_folder()]
        self._compiler: tuple[slangpy.SlangSession, LinkedKernels] | None = None
        self._kernels: dict[tuple[str, ...], Kernel] = {}
        self._readable = Pool(self._create_readable)
        # software shares its memory with the host, which writes and reads it in place
        shared = self.adapter.software
        self.memory = self._readable if shared else Pool(self._create)
        self._given = Pool(self._create_writeable) if shared else self.memory
        self.bytes_made = 0  # of memory that was made for buffers so far

    @property
    def _pools(self) -> set[Pool]:
        """All memory: for kernel output, for host input and for reading back."""
        return {self.memory, self._given, self._readable}

    @property
    def buffers_made(self) -> int:
        """Pieces of memory that were made for buffers so far."""
        return sum(pool.made for pool in {self.memory, self._given})

    @property
    def _device(self) -> slangpy.Device:
        if self._opened is None:
            raise DeviceError(CLOSED)
        return self._opened

    def close(self) -> None:
        """Give the device back with all that was made on it; it can't be used any more.  Closing twice is harmless."""
        for kernel in self._kernels.values():
            kernel.release()
        self._kernels.clear()
        for pool in self._pools:
            pool.close()
        self._compiler, self.watch = None, Watch.none()
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
            self.find_modules_in([*SHADERS, interface_folder(), folder])

    def find_modules_in(self, folders: list[Path]) -> None:
        """Let kernels import the Slang modules of these folders."""
        if folders != self._folders:
            self._folders, self._compiler = folders, None

    def buffer(self, data: NDArray[Any]) -> Buffer:
        """A buffer that holds the data; an empty array makes a buffer of one element."""
        data = np.ascontiguousarray(data).reshape(-1)
        data = data if len(data) else np.zeros(1, data.dtype)
        return self._filled(len(data), data.dtype.itemsize, data)

    def empty(self, dtype: DTypeLike, count: int) -> Buffer:
        """A buffer of ``count`` elements with any content."""
        return self._filled(max(count, 1), np.dtype(dtype).itemsize, None)

    def _filled(self, count: int, itemsize: int, data: NDArray[Any] | None) -> Buffer:
        """A buffer of elements, with data or uninitialised; DeviceLostError without free memory."""
        pool = self.memory if data is None else self._given
        before = pool.made
        try:
            buffer = pool.take(itemsize, count)
            if data is not None:
                buffer.memory.copy_from_numpy(_as_writeable(data.view(np.uint8)))
        except RuntimeError as error:
            size = size_text(count * itemsize)
            raise DeviceLostError(f"{self.adapter.label} has no memory for a buffer of {size}") from error
        self.bytes_made += buffer.size if pool.made > before else 0
        return buffer

    def _create(self, itemsize: int, count: int) -> slangpy.Buffer:
        """Memory of the device that kernels read and write."""
        return self._device.create_buffer(element_count=count, struct_size=itemsize, usage=_usage())

    def _create_readable(self, itemsize: int, count: int) -> slangpy.Buffer:
        """Memory that the host reads: what kernels have written, or copies of it."""
        import slangpy

        kind, usage = slangpy.MemoryType.read_back, slangpy.BufferUsage.copy_destination
        usage = _usage() if self.adapter.software else usage
        return self._device.create_buffer(element_count=count, struct_size=itemsize, usage=usage, memory_type=kind)

    def _create_writeable(self, itemsize: int, count: int) -> slangpy.Buffer:
        """Memory that the host writes, and kernels read and write."""
        import slangpy

        kind = slangpy.MemoryType.upload
        return self._device.create_buffer(element_count=count, struct_size=itemsize, usage=_usage(), memory_type=kind)

    def read(self, buffer: Buffer, dtype: DTypeLike, count: int | None = None) -> NDArray[Any]:
        """The content of a buffer, or its first ``count`` elements."""
        dtype = np.dtype(dtype)
        size = buffer.size if count is None else count * dtype.itemsize
        with WORKING:
            source = buffer if self._is_read_in_place(buffer, size) else self._copy(buffer, size)
            content: NDArray[Any] = source.memory.to_numpy().reshape(-1).view(np.uint8)[:size].view(dtype)
        return content

    def _is_read_in_place(self, buffer: Buffer, size: int) -> bool:
        """Whether reading the complete buffer in place is faster than copying its first bytes."""
        return buffer.pool is self._readable and buffer.room <= 2 * size + FEW

    def _copy(self, buffer: Buffer, size: int) -> Buffer:
        """A copy of a buffer's first bytes that the host can read."""
        copy = self._readable.take(1, max(size, 1))
        encoder = self._device.create_command_encoder()
        encoder.copy_buffer(copy.memory, 0, buffer.memory, 0, max(size, 1))
        self.watch.wait(self._device.submit_command_buffer(encoder.finish()))
        return copy

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

        part         None for stages without elements
        quantity     one of the part's, to be evaluated instead of its own field
        line_degree  of polynomials along rays; 0 uses the field's
        media        number of transfer functions that are blended along rays

        DeviceError with the compiler's own message if the part's module does not compile.
        """
        source = f"export static const int rows = {ROWS[self.adapter.software]};"
        source += f"export static const int media = {media};"
        if part is not None:
            chosen = part.quantity(quantity)
            source += f"export static const int sharing_lanes = {self._sharing_lanes(stage, chosen)};"
            source += _of_type(stage, part, chosen, line_degree)
        else:
            source += f"export static const int line_degree = {line_degree or STAND_IN};"
        key = (str(self._folders[-1]), stage, source)
        if key not in self._kernels:
            self._announcement.expect()
            with compiling():
                self._kernels[key] = self.link(stage, source)
        return self._kernels[key]

    def _sharing_lanes(self, stage: str, chosen: Part | Quantity) -> int:
        """The number of lanes that read for one another in a stage (lanes.slang); 1 if they do not."""
        shares = stage in SHARING and works_together(stage, chosen)
        return SHARING_LANES if shares and self._has_wide_waves else 1

    @cached_property
    def _has_wide_waves(self) -> bool:
        """Whether the device is in software, where loads are slow, and its waves have enough lanes to share loads."""
        if not self.adapter.software or self.adapter.kind != "vulkan":
            return False
        found = self.buffer(np.zeros(1, np.uint32))
        self.kernel("wave_lanes")(1, {"lane_count": found}, groups=True)
        return int(self.read(found, np.uint32)[0]) >= SHARING_LANES

    def link(self, stage: str, source: str) -> Kernel:
        """Stage and element type meet here: the stage's ``extern struct TheVolume`` becomes the type."""
        if self._compiler is None:
            self._compiler = compiler(self._device, self.adapter, self._folders)
        session, linked = self._compiler
        name = f"{stage}_{crc32(source.encode()):08x}"
        if not linked.is_known(name):
            self._elsewhere.make(self._folders, stage, source)
        entry = session.load_module(stage)
        own = session.load_module_from_source(name, source)
        program = session.link_program([entry, own], [entry.entry_point(stage.rsplit("_", maxsplit=1)[-1])])
        with naming_what_fails(stage, self._folders, self.adapter):
            kernel = Kernel(self._device, program, self.watch, self.adapter)
        linked.note(name)
        return kernel

    def finish_writing(self) -> None:
        """Wait until all compiled kernels are in the database, to which slangpy writes in a thread."""
        _ = self._device.shader_cache_stats

    def appended(self, name: str, kernel: Kernel, run: Callable[[dict[str, Buffer]], None]) -> NDArray[Any]:
        """Entries that a kernel appends to the buffer ``name`` and counts in ``count``.

        It runs again with a longer list if the first was too short, so running twice must be harmless.
        DeviceLostError if kernels can't address the complete list; with fewer pixels they may.
        """
        dtype = kernel.dtype(name)
        while True:
            size = kernel.capacity * dtype.itemsize
            if size > self.reach:
                room = f"{size_text(self.reach)} of a bound buffer"
                raise DeviceLostError(f"{self.adapter.label} addresses {room}, but a list takes {size_text(size)}")
            lists = {name: self.empty(dtype, kernel.capacity), "count": self.buffer(np.zeros(1, np.uint32))}
            run(lists)
            count = int(self.read(lists["count"], np.uint32)[0])
            if count <= kernel.capacity:
                return self.read(lists[name], dtype, count) if count else np.empty(0, dtype)
            kernel.capacity = count + count // 4


def _as_writeable(raw: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The bytes as a writeable array: slangpy, which reads them, accepts no other.

    They are copied only if their memory is read-only, such as the memory of ``bytes``.
    """
    own = raw.view()
    try:
        own.flags.writeable = True
    except ValueError:
        return raw.copy()
    return own


class Kernel:
    """A linked compute kernel; buffers are passed by the names of its module's globals, bound or read through pointers.

    Globals may also be records, which are the fastest data for reading by all threads.

    capacity  entries of a list that it appends to: as many as the longest list so far, and some more
    """

    def __init__(self, device: slangpy.Device, program: slangpy.ShaderProgram, watch: Watch, adapter: Adapter) -> None:
        import slangpy

        self._device: slangpy.Device | None = device
        self._watch: Watch | None = watch
        self._pipeline = device.create_compute_kernel(program).pipeline
        self._pace, self.capacity = Pace(), FIRST_CAPACITY
        self._group = int(program.layout.entry_points[0].compute_thread_group_size.x)
        # the cpu target wraps all globals in a constant buffer
        layout = program.layout.globals_type_layout
        fields = (layout.element_type_layout or layout).fields
        self._globals: dict[str, slangpy.TypeLayoutReflection] = {item.name: item.type_layout for item in fields}
        self._dtypes: dict[str, np.dtype[Any]] = {}
        self._is_in_c, self._shares = adapter.kind == "cpu", adapter.shares
        # kinds of the arguments by name
        self._needed = {name: own.type.kind for name, own in self._globals.items() if name not in (EXTENT, COUNT)}
        # arguments persist between dispatches: only changes are written
        self._arguments = device.create_root_shader_object(program)
        cursor = slangpy.ShaderCursor(self._arguments)
        self._places = {name: cursor[name] for name in self._globals}
        self._written: dict[str, slangpy.Buffer | int | tuple[int, ...]] = {}

    def release(self) -> None:
        """Release the program, even if the kernel is still referenced."""
        self._device, self._watch = None, None
        self._pipeline, self._arguments = None, None
        self._globals, self._places, self._written = {}, {}, {}

    def dtype(self, name: str) -> np.dtype[Any]:
        """The NumPy dtype of a record, or of one element of a buffer, as Slang lays it out."""
        if name not in self._dtypes:
            layout = self._globals[name]
            self._dtypes[name] = dtype_of(layout.element_type_layout or layout, self._is_in_c)
        return self._dtypes[name]

    def __call__(self, count: int, given: Given, *, groups: bool = False, work: NDArray[Any] | None = None) -> None:
        """Run over ``count`` items, each for a thread or (``groups``) a whole group, with the given buffers and values.

        work  (count,) work of each group, in any unit, if it varies much
        Long work is split into several dispatches (see Device.watch); it is finished on return.
        """
        if self._device is None or self._watch is None:
            raise DeviceError(CLOSED)
        try:
            for name, kind in self._needed.items():
                self._give(name, kind, given[name])
        except KeyError:
            missing = self._needed.keys() - given.keys()
            raise DeviceError(f"kernel buffers {', '.join(sorted(missing))} are not bound") from None
        if COUNT in self._globals:
            self._write(COUNT, count)
        total = count if groups else -(-count // self._group)
        fresh, start = not self._pace.compiled, perf_counter()
        with WORKING:
            for first, end in self._pace.batches(total, work):
                rows = 1 if work is None else rows_of(work[first:end], self._shares)
                self._watch.after_dispatch(self._dispatch(first, end, rows))
        if fresh:
            self._watch.compiled(perf_counter() - start)

    def _give(self, name: str, kind: object, given: Buffer | NDArray[Any]) -> None:
        """Let a global be a record, or refer to a buffer."""
        if isinstance(given, Buffer):
            self._write(name, given.address if kind == _pointer() else given.memory)
        else:
            size = self._globals[name].size
            self._places[name].set_data(given.view(np.uint8)[:size])

    def _write(self, name: str, argument: slangpy.Buffer | int | tuple[int, ...]) -> None:
        """Let a global have a value, unless it has it already."""
        if self._written.get(name) != argument:
            self._places[name].write(argument)
            self._written[name] = argument

    def _dispatch(self, first: int, end: int, rows: int) -> int:
        """Run a range of groups, in a grid with at least this number of rows; the number of the submission."""
        import slangpy

        assert self._device is not None
        columns, rows, turn = grid_of(end - first, rows)
        self._write(EXTENT, (first, end, rows, turn))
        encoder = self._device.create_command_encoder()
        commands = encoder.begin_compute_pass()
        commands.bind_pipeline(self._pipeline, self._arguments)
        commands.dispatch_compute(slangpy.uint3(columns, rows, 1))
        commands.end()
        return int(self._device.submit_command_buffer(encoder.finish()))


@cache
def _pointer() -> object:
    """The kind of global through which a module reads a buffer by its address."""
    import slangpy

    return slangpy.TypeReflection.Kind.pointer


@cache
def _usage() -> slangpy.BufferUsage:
    """Usage flags of kernels' buffers; slangpy is slow to combine these."""
    import slangpy

    usage = slangpy.BufferUsage.shader_resource | slangpy.BufferUsage.unordered_access
    return usage | slangpy.BufferUsage.copy_source | slangpy.BufferUsage.copy_destination


def _keeping(
    device: slangpy.Device, cache: KernelCache, announcement: Announcement, elsewhere: Elsewhere
) -> Callable[[float], None]:
    """A function that caches kernels compiled since its last call; it receives the seconds that this took."""
    kept = 0

    def keep(seconds: float) -> None:
        nonlocal kept
        compiled = device.shader_cache_stats.miss_count + elsewhere.made
        if compiled > kept:
            kept = compiled
            announcement.note(seconds)
            cache.keep()

    return keep


class _Working:
    """Converts errors while the device works into a DeviceLostError with the driver's message."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, RuntimeError):
            raise DeviceLostError(f"the device failed: {' '.join(str(error).split()) or 'it was lost'}") from error


#: nodes of a line of the lattices of guesses, from this degree of maps and fields on
_MORE_NODES, _FROM_DEGREE = 9, 4
#: around all that a device is given to do
WORKING = _Working()


def _of_type(stage: str, part: Part, chosen: Part | Quantity, line_degree: int) -> str:
    """Slang text that makes a type a stage's ``TheVolume``."""
    chosen_leaves = leaves(chosen) if stage.startswith("iso_") else ""
    if stage in ALONG_RAYS:
        chosen_leaves = leaves_along_rays(part, chosen)
    together = stage in TOGETHER
    is_long = chosen.type.startswith(("Expressed<", "Stacked<")) or (stage == "volume_trace" and part.collapsed)
    compact = stage in COMPACT or is_long
    degree = chosen.degree or stand_in(chosen)
    return (
        f"import volume; import {part.module}; {chosen.source}\nexport struct TheVolume : IVolume = {chosen.type};"
        f"export static const bool lanes_together = {str(together).lower()};"
        f"export static const bool compact = {str(compact).lower()};"
        f"export static const int guess_nodes = {guess_nodes(part)};"
        f"export static const int cube_degree = {degree};"
        f"export static const int cube_base_degree = {chosen.base_degree or degree};"
        f"export static const int line_degree = {line_degree or chosen.degree or STAND_IN};"
        f"export static const bool cube_collapsed = {str(part.collapsed).lower()};{chosen_leaves}"
        f"{_condition(chosen) if stage == 'iso_line' else ''}"
    )


def guess_nodes(part: Part) -> int:
    """Nodes of a line of the lattices that guesses of the inverse map go through: more for high degrees."""
    return _MORE_NODES if part.degree >= _FROM_DEGREE else 3


def _condition(chosen: Part | Quantity) -> str:
    """Slang text that says where a quantity's level isn't to be shown."""
    condition = chosen.condition if isinstance(chosen, Quantity) else None
    type = chosen.type if condition is None else condition.type
    is_there = str(condition is not None).lower()
    return f"export struct TheCondition : IVolume = {type}; export static const bool conditional = {is_there};"


def stand_in(chosen: Part | Quantity) -> int:
    """Degree of polynomials that stand for a quantity that is none, over a sub-element; with distances, of its map."""
    if (enclosure := enclosure_of(chosen)) is None or enclosure.distances or enclosure.in_boxes:
        return STAND_IN if enclosure is None else enclosure.degree
    return max(ENCLOSED, enclosure.map_degree)
