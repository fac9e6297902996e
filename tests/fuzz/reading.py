"""What is done with files: everything that a command does with them before it draws or writes."""

import os
from contextlib import redirect_stdout
from functools import cache

import bridges


@cache
def _candidates():
    from elvis.plugins.conversion.discovery import installed_converters

    return [each for each in installed_converters() if not each.missing]


def evaluated(paths):
    """The data, read and evaluated in each element."""
    from elvis import read
    from elvis.core.mapping.patch import patches
    from elvis.core.polynomials.evaluation import evaluate

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
    from elvis.plugins.conversion.converting import convert
    from elvis.plugins.conversion.discovery import choose_converter, with_defaults

    given = _given(paths)
    converter = choose_converter(_candidates(), given).converter
    options = with_defaults(converter, {"spaces": "H1:4"} if any(p.suffix == ".gfu" for p in given) else {})
    convert(converter(given, **options), files=given).report.metadata()


def opened(paths):
    """The fields of what a runtime plugin opens."""
    from elvis import ElvisError
    from elvis.plugins.runtime.opening import open_files

    found = open_files(paths)
    if found is None:
        raise ElvisError("no plugin opens the files")
    for field in found.fields[:3]:
        found.volume(field)


def staged(paths):
    """A scene."""
    from elvis.scene.model.files import read_scene

    read_scene(paths[0])


def received(paths):
    """A message of a page."""
    from elvis.viewer.messages import id_of, parsed, table_of_text

    content = table_of_text(paths[0].read_bytes().decode("utf-8", "replace"))
    id_of(content)
    parsed(content)


bridged_blueprint = bridges.blueprint
bridged_arrays = bridges.arrays
bridged_ngsolve = bridges.ngsolve
bridged_mfem = bridges.mfem


def coloured(paths):
    """A colour map."""
    from elvis.scene.record.palette import Palette

    Palette.of_name(str(paths[0]), 0.0, 1.0)


def triangulated(paths):
    """Triangles, for distances and for pictures."""
    from elvis.core.distances.triangle_files import triangles_of
    from elvis.renderer.passes.solids.hits import triangles

    triangles.cache_clear()
    triangles(str(paths[0]))
    triangles_of(str(paths[0]))


def placed(paths):
    """Points of a table."""
    from elvis.core.numbers.queries import points_in_table

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
    from elvis.plugins.command.running import Settings, elvis

    with open(os.devnull, "w") as nothing, redirect_stdout(nothing):
        elvis.main([str(each) for each in arguments], "elvis", standalone_mode=False, obj=Settings(debug=False))
