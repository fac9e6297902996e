"""Functions inside of kernels, called by tests: the text of a kernel, followed by an entry point ``check``.

``shaders/NAME_check.slang`` next to the tests is the entry point of the kernel ``NAME``.  It reads one row of numbers
for each case and writes one (rows.slang).
"""

import zlib
from pathlib import Path

import numpy as np

from elvis.plugins.runtime.volume import interface_folder
from elvis.renderer.device.device import SHADERS

HERE = Path(__file__).parents[1] / "renderer" / "shaders"
#: elements of polynomial_volume.slang, whose degree is 2 in each direction
OF_POLYNOMIALS = (
    "import volume; import enclosures; import polynomial_volume;"
    "export struct TheVolume : IVolume = PolynomialVolume; export struct TheLeaves : ILeaves = PolynomialLeaves;"
    "export static const int cube_degree = 2; export static const int leaf_degree = 2;"
    "export static const int leaf_fields = 2; export static const int line_degree = 3;"
    "export static const int rows = 1; export static const int media = 1; export static const int sharing_lanes = 1;"
)


class KernelFunctions:
    """Results (n, m) of functions of a kernel for rows (n, k) of numbers.

    exports  Slang text that completes the kernel, as that of a part does
    """

    def __init__(self, device, name, folder, exports=""):
        native = interface_folder().parent / "native"
        folders = [*SHADERS, interface_folder(), native]
        kernel = next(path for shaders in folders for path in shaders.glob(f"{name}.slang"))
        text = kernel.read_text(encoding="utf-8").replace(f"module {name};", f"module {name}_check;", 1)
        folder = folder / f"{name}_{zlib.crc32(exports.encode()):08x}"
        folder.mkdir()
        for module in ("rows", "polynomial_volume", "curve_cases"):
            (folder / f"{module}.slang").write_bytes((HERE / f"{module}.slang").read_bytes())
        if kernel.parent == native:
            for module in native.glob("*.slang"):
                (folder / module.name).write_bytes(module.read_bytes())
        check, stage = HERE / f"{name}_check.slang", name
        if check.exists():
            stage = f"{name}_check"
            (folder / f"{stage}.slang").write_text(text + check.read_text(encoding="utf-8"), encoding="utf-8")
        before = device._folders[-1]
        device.include(folder)
        self._device = device
        self._kernel = device.link(stage, OF_POLYNOMIALS + exports)
        device.include(before)

    def __call__(self, rows, count, **given):
        """Results (n, count); arrays and records of the kernel are given by name, and are zero otherwise."""
        rows = np.ascontiguousarray(rows, float)
        own = {"given": rows, "sizes": np.array([rows.shape[1], count, len(rows)], np.uint32), **given}
        own["found"] = np.full(len(rows) * count, np.nan)
        return self.run(len(rows), "found", own["found"].size, **own).reshape(-1, count)

    def records(self, name, count):
        """Records (count,) of the kernel, all zero."""
        return np.zeros(count, self._kernel.dtype(name))

    def run(self, items, result, size, **given):
        """The first numbers of an array of the kernel, after it has run with all of these."""
        return self._run(items, [result], given)[result].view(np.float64)[:size].copy()

    def results(self, items, names, /, *, groups=False, **given):
        """Arrays of the kernel by name, after it has run with all of these: each item for a thread or a whole group."""
        found = self._run(items, names, given, groups)
        return {name: found[name].view(given[name].dtype)[: given[name].size].copy() for name in names}

    def _run(self, items, names, given, groups=False):
        import slangpy

        scalars = {name for name, kind in self._kernel._needed.items() if kind == slangpy.TypeReflection.Kind.scalar}
        nothing = self._device.buffer(np.zeros(64))
        unused = {name: np.zeros(1) if name in scalars else nothing for name in self._kernel._needed}
        buffers = {
            name: array if name in scalars else self._device.buffer(np.asarray(array)) for name, array in given.items()
        }
        self._kernel(items, {**unused, **buffers}, groups=groups)
        return {name: self._device.read(buffers[name], np.uint8) for name in names}


def rows_of(count, columns):
    """Rows (count, k) of numbers from arrays (count, ...) of them."""
    return np.concatenate([np.reshape(column, (count, -1)) for column in columns], axis=1)


def parted(found, groups):
    """Columns of results by name, a dictionary for each group."""
    first = 0
    for group in groups:
        named = {}
        for name, width in group.items():
            own = found[:, first : first + width]
            named[name] = own[:, 0] if width == 1 else own
            first += width
        yield named
    assert first == found.shape[1]


def width_of(groups):
    return sum(sum(group.values()) for group in groups)
