"""Faces and isosurfaces of the solver's own data: hits lie where the map says, and have the requested value."""

from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from elvis import Scene
from elvis import render as draw
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import positions, values
from elvis.formats.reading import read
from elvis.reference.picture import render
from elvis.reference.record import Record
from elvis.reference.tolerances import check_tolerances
from elvis.scene import CutSurface, Faces, Isosurface, Sphere, Style, Transfer, VolumeRendering

CASES = ["gen_allelem_n4", "gen_pyr_curved", "gen_pipe_curved", "tet_small", "hex_c0", "hex_chk", "chan3d_tet"]


@pytest.fixture(params=CASES)
def data(nektar, request):
    """A dataset of volume elements."""
    kept = (".xml", ".fld", ".chk", ".rst", ".nekg")
    return read(*(path for path in (nektar / request.param).iterdir() if path.suffix in kept))


def check_places(data, frame):
    """The map takes the reference point to the place that the pixel's ray passes; the field is the value there."""
    assert frame.counts()["failed"] == 0
    seen = frame.seen
    size = np.linalg.norm(np.ptp(frame.position[seen], axis=0))
    for patch in patches(data, [data.fields[0].name]):
        order = np.argsort(patch.element_ids)
        here = seen & np.isin(frame.element, patch.element_ids)
        rows = order[np.searchsorted(patch.element_ids, frame.element[here], sorter=order)]
        world = positions(patch, rows, frame.reference[here])
        assert np.abs(world - frame.position[here]).max(initial=0) < 1e-11 * size
        expected = values(patch, 0, rows, frame.reference[here])
        assert np.abs(frame.field[here] - expected).max(initial=0) <= 1e-13 * max(1.0, np.abs(expected).max(initial=0))


def test_faces_isosurfaces_and_volumes_of_real_data(data):
    name = data.fields[0].name
    faces = render(data, Scene(name, camera="iso", size=(36, 36), objects=(Faces(),)))
    assert faces.seen.sum() > 200
    check_places(data, faces)

    # a value that is on the outside is somewhere inside, too
    low, high = np.nanmin(faces.field), np.nanmax(faces.field)
    middle = 0.5 * (low + high)
    scene = Scene(name, camera=faces.view.camera, size=(36, 36), objects=(Isosurface((float(middle),)),))
    surface = render(data, scene)
    assert surface.seen.any()
    check_places(data, surface)
    assert np.abs(surface.field[surface.seen] - middle).max() < 1e-11 * (high - low)
    behind = surface.seen & faces.seen
    assert (surface.depth[behind] - faces.depth[behind] > -1e-9).all()

    # even volume is there where the faces are
    volume = VolumeRendering(Transfer((0.0, 1.0), (1.0, 1.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    dim = render(data, Scene(name, camera=faces.view.camera, size=(12, 12), objects=(volume,)))
    clear = render(data, Scene(name, camera=faces.view.camera, size=(12, 12), objects=(Faces(),)))
    certain = clear.status != 2
    assert np.array_equal((dim.color[..., 0] < 1.0)[certain], clear.seen[certain])


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["gen_pipe_curved"])
def test_a_picture_takes_less_than_a_quarter_of_a_minute(nektar, case, slowness):
    """150 x 150 pixels of the largest of the shared cases that have curved volume elements; of processor time."""
    data = read(*(path for path in (nektar / case).iterdir() if path.suffix in (".xml", ".fld")))
    start = process_time()
    render(data, Scene(data.fields[0].name, camera="iso", size=(150, 150), objects=(Faces(),)))
    assert process_time() - start < slowness * 15


OBJECTS = {
    "faces": (Faces(),),
    "sphere": (CutSurface(Sphere((-0.645, -0.44, 0.425), 0.03)),),
    "isosurface": (Isosurface((0.3,), style=Style(range=(0.0, 1.0))),),
    "through one another": (Faces(style=Style(opacity=0.4)), Isosurface((0.3, 0.6), style=Style(range=(0.0, 1.0)))),
    "volume": (VolumeRendering(Transfer((0.0, 0.3, 1.0), (0.0, 2.0, 0.5))),),
}


@pytest.mark.parametrize("objects", OBJECTS)
def test_the_device_is_within_the_tolerances(nektar, objects):
    """The renderer's kernels and the reference draw the same scenes of the same data, each by its own means."""
    data = read(*(path for path in (nektar / "tet_small").iterdir() if path.suffix in (".xml", ".fld")))
    name, span = data.fields[0].name, range_of(data)
    shown = tuple(scaled(item, span) for item in OBJECTS[objects])
    scene = Scene(name, camera="iso", size=(60, 60), objects=shown, range=span)
    found = draw(data, scene)
    completed = Scene(name, camera=found.view.camera, size=(60, 60), objects=shown, range=span)
    true = render(data, completed)
    assert (true.status > 0).sum() > 100
    pictures = Record.of(true), Record.of(found)
    if true.seen.any():
        assert {check.name for check in check_tolerances(*pictures, ends=span) if not check.passed} == set()
    assert np.abs(pictures[0].color - pictures[1].color).max() < 1e-6


def range_of(data):
    """Minimum and maximum value on the outer faces."""
    frame = render(data, Scene(data.fields[0].name, camera="iso", size=(20, 20), objects=(Faces(),)))
    return float(np.nanmin(frame.field)), float(np.nanmax(frame.field))


def scaled(item, span):
    """The object with values in parts of a range as values of the field."""
    low, wide = span[0], span[1] - span[0]
    match item:
        case Isosurface():
            values = tuple(low + wide * value for value in item.values)
            return Isosurface(values, style=Style(opacity=item.style.opacity, range=span))
        case VolumeRendering(transfer=own):
            return VolumeRendering(Transfer(tuple(low + wide * value for value in own.values), own.densities))
    return item


@pytest.mark.parametrize("options", [{"samples": 2}, {"samples": 3, "range": "all"}])
def test_colours_of_samples_and_of_whole_ranges_are_the_devices(nektar, options):
    """Means over the points of a pixel, and maps from bound to bound of a field: the same colours on both."""
    data = read(*(path for path in (nektar / "tet_small").iterdir() if path.suffix in (".xml", ".fld")))
    style = Style(opacity=0.5, quantity="u^2+v^2")
    scene = Scene(
        data.fields[0].name, camera="iso", size=(26, 24), objects=(Faces(), Faces(("inner",), style)), **options
    )
    found = draw(data, scene)
    true = render(data, replace(scene, camera=found.view.camera))
    plain = render(data, Scene(scene.field, camera=found.view.camera, size=(26, 24), objects=scene.objects))
    assert np.abs(true.color - found.color).max() < 1e-9
    assert np.abs(true.color - plain.color).max() > 0.05
    assert np.array_equal(true.element, plain.element)
