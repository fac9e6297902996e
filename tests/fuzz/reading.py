"""What is done with files: everything that a command does with them before it draws or writes."""

import importlib
import os
import signal
from contextlib import contextmanager, redirect_stdout, suppress
from functools import cache
from pathlib import Path

import numpy as np


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


def judged(paths):
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
    from elvis.core.distances.files import triangles_of
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
def forked_trials():
    """Trials of libraries in a fork of this process, which has them loaded, instead of in one that loads them.

    Their memory has a limit of its own and is not counted; their time is.
    """
    from elvis.converters import trial

    programs = {"vtkmodules": "vtk", "gmsh": "gmsh", "mfem": "mfem.ser", "ngsolve": "ngsolve"}

    def attempt(program, paths, size=None):
        for word, module in programs.items():
            if f"import {word}" in program or f"from {word}" in program:
                importlib.import_module(module)
        size = sum(path.stat().st_size for path in paths) if size is None else size
        read_end, write_end = os.pipe()
        child = os.fork()
        if not child:
            os.close(read_end)
            _child(trial, program, paths, size, write_end)
        os.close(write_end)
        with os.fdopen(read_end, "rb") as stream:
            said = stream.read()
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        return trial.Outcome(status, " ".join(said.decode("utf-8", "replace").split()))

    original = trial.attempt
    users = [
        importlib.import_module(f"elvis.converters.{name}")
        for name in ("gmsh_mesh", "mfem_files", "vtk_files", "ngsolve_files")
    ]
    for module in (trial, *users):
        module.attempt = attempt
    try:
        yield
    finally:
        for module in (trial, *users):
            module.attempt = original


def _child(trial, program, paths, size, stream):
    """The program of a trial, with its limits, in this process; never returns."""
    import resource
    import sys
    import time

    status = 1
    with suppress(BaseException):
        signal.setitimer(signal.ITIMER_PROF, 0)
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        own = taken + trial.MEMORY + trial.MEMORY_PER_BYTE * size
        resource.setrlimit(resource.RLIMIT_AS, (own if hard < 0 else min(own, hard), hard))
        seconds = trial.SECONDS + size // trial.BYTES_PER_SECOND

        def bound():
            limit = int(time.process_time()) + 1 + seconds
            resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.getrlimit(resource.RLIMIT_CPU)[1]))

        def say(text):
            os.write(stream, text.encode("utf-8", "replace")[:4000])

        sys.argv = ["-c", *map(str, paths)]
        try:
            exec(program, {"bound": bound, "say": say, "sys": sys, "os": os, "suppress": suppress, "np": np})
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1
    os._exit(status)
