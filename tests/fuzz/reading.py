"""What is done with files: everything that a command does with them before it draws or writes."""

import importlib
import os
import resource
import signal
from contextlib import contextmanager, redirect_stdout, suppress
from functools import cache
from pathlib import Path

#: what workers load
MODULES = {
    "gmsh_library": ("gmsh",),
    "mfem_library": ("mfem.ser",),
    "ngsolve_library": ("ngsolve",),
    "vtk_library": ("vtkmodules.vtkIOLegacy", "vtkmodules.vtkIOXML", "vtkmodules.util.numpy_support"),
}


@cache
def _candidates():
    from elvis.plugins.discovery import installed

    return [each for each in installed() if not each.missing]


def evaluated(paths):
    """The data, read and evaluated in each element."""
    from elvis.core.patch import patches
    from elvis.core.polynomials.evaluation import evaluate
    from elvis.formats import read

    dataset = read(*_given(paths))
    for patch in patches(dataset, [field.name for field in dataset.fields]):
        evaluate(patch.geometry, patch.geometry_coefficients, patch.shape.vertices / 3)


def described(paths):
    """``elvis info``."""
    _command("info", *_given(paths))


def checked(paths):
    """``elvis info --strict``, which fails where it finds anything."""
    from elvis.formats.strict import findings

    for found in findings(*_given(paths)):
        assert "\n" not in str(found)


def converted(paths):
    """The data, converted by the converter that says it opens them."""
    from elvis.plugins.converting import convert
    from elvis.plugins.discovery import chosen, with_defaults

    given = _given(paths)
    converter = chosen(_candidates(), given).converter
    options = with_defaults(converter, {"spaces": "H1:4"} if any(p.suffix == ".gfu" for p in given) else {})
    convert(converter(given, **options), files=given).report.metadata()


def opened(paths):
    """The fields of what a runtime plugin opens."""
    from elvis.formats import ElvisError
    from elvis.plugins.opening import open_files

    found = open_files(paths)
    if found is None:
        raise ElvisError("no plugin opens the files")
    for field in found.fields[:3]:
        found.volume(field)


def staged(paths):
    """A scene."""
    from elvis.scene.files import read_scene

    read_scene(paths[0])


def coloured(paths):
    """A colour map."""
    from elvis.scene.palette import Palette

    Palette.named(str(paths[0]), 0.0, 1.0)


def triangulated(paths):
    """Triangles, for distances and for pictures."""
    from elvis.core.distances.triangle_files import triangles_of
    from elvis.renderer.passes.solids.hits import triangles

    triangles.cache_clear()
    triangles(str(paths[0]))
    triangles_of(str(paths[0]))


def placed(paths):
    """Points of a table."""
    from elvis.core.queries import points_in_table

    points_in_table(paths[0])


def recalled(paths):
    """The record of a picture."""
    from elvis.reference.record import Record

    Record.load(paths[0])


def _given(paths):
    """The files that a user names: those that others name are left out."""
    first = [path for path in paths if path.suffix in (".pvd", ".nek5000")]
    return first or [path for path in paths if path.suffix != ".nekg"]


def _command(*arguments):
    """A command within this process; what it raises comes out as it is."""
    from elvis.plugins.running import Settings, elvis

    with open(os.devnull, "w") as nothing, redirect_stdout(nothing):
        elvis.main([str(each) for each in arguments], "elvis", standalone_mode=False, obj=Settings(debug=False))


@contextmanager
def forked():
    """Libraries at work in forks of this process, which has them loaded, instead of in processes that load them.

    Their memory has a limit of its own and is not counted; their time is.
    """
    from elvis.converters import apart

    original = apart.launched
    apart.launched = _Fork
    try:
        yield
    finally:
        apart.launched = original


class _Fork:
    """A fork of this process that serves a worker, with what `subprocess.Popen` has and is asked of it."""

    def __init__(self, worker, memory):
        from elvis.converters.apart import serve

        importlib.import_module(worker.partition(":")[0])
        for module in MODULES.get(worker.partition(":")[0].rpartition(".")[2], ()):
            importlib.import_module(module)
        requests, self._asking = os.pipe()
        self._answering, answers = os.pipe()
        self._status = None
        self.pid = os.fork()
        if not self.pid:
            with suppress(BaseException):
                os.dup2(requests, 0)
                os.dup2(answers, 1)
                os.closerange(3, 256)
                taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                serve(worker, taken + memory)
            os._exit(1)
        os.close(requests)
        os.close(answers)
        self.stdin, self.stdout = os.fdopen(self._asking, "wb"), os.fdopen(self._answering, "rb")

    def kill(self):
        if self._status is None:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self):
        if self._status is None:
            self._status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self._status
