"""Devices that draw, and what it means that two of them agree."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kernel_functions import KernelFunctions

from elvis import Scene, Status
from elvis.core.bounds.ranges import field_range
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.margins import margins
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.formats.reading import read
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime.serving import volume_of
from elvis.reference.picture import render as render_reference
from elvis.renderer.asking.completing import completed
from elvis.renderer.passes.faces.faces import FaceDrawer
from elvis.renderer.passes.volume.media import Medium
from elvis.renderer.passes.volume.rendering import VolumeRenderer
from elvis.renderer.raster.compositing import FragmentLists
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.model.quantities import quantities

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "nektar"
#: nearer to the border of an element than this, neighbours may hold a point
BORDER = 1e-9


def pytest_generate_tests(metafunc):
    """Every shared case with a field, for tests that ask for ``case``."""
    if "case" in metafunc.fixturenames:
        folders = sorted(DATA.iterdir()) if DATA.is_dir() else []
        names = [folder.name for folder in folders if folder.is_dir() and len(files_of(folder)) == 2]
        metafunc.parametrize("case", names)


def files_of(folder):
    """The mesh, then the field of a case where it has one."""
    names = sorted(path for path in folder.iterdir() if "zVariation" not in path.name)
    meshes = [path for path in names if path.name.endswith((".xml", "_xml"))]
    return meshes[:1] + [path for path in names if path.name.endswith((".fld", ".rst", ".chk"))][:1]


@pytest.fixture(scope="session")
def shared_files(nektar):
    return lambda case: files_of(nektar / case)


@pytest.fixture(scope="session")
def shared(shared_files):
    """The dataset of a case."""
    return lambda case: read(*shared_files(case))


@pytest.fixture(scope="session")
def liveliest():
    """The name of the field whose coefficients vary most: some shared fields are constant."""

    def find(dataset):
        spread = [np.ptp(np.concatenate([block.coefficients.ravel() for block in f.blocks])) for f in dataset.fields]
        return dataset.fields[int(np.argmax(spread))].name

    return find


@pytest.fixture(scope="session")
def draw(renderer):
    """A frame of a dataset, with the scene's parts as keywords; ``device`` is vulkan, cpu or reference."""

    def draw(dataset, device="vulkan", **scene):
        whole = completed(dataset, Scene(**{"field": dataset.fields[0].name, **scene}))
        if device == "reference":
            return render_reference(dataset, whole)
        drawing = renderer(device)
        drawing.load(dataset, *quantities(whole))
        return drawing.render(whole)

    return draw


@pytest.fixture(scope="session")
def same_on(draw):
    """Draw on a device and in NumPy, check that the pixels agree, return both frames."""

    def compare(dataset, device="vulkan", **scene):
        drawn = draw(dataset, device, **scene)
        size = (drawn.view.width, drawn.view.height)
        truth = render_reference(dataset, replace(drawn.scene, camera=drawn.view.camera, size=size))
        check_pixels(drawn, truth, dataset.mesh, tolerance_of(dataset.field(drawn.scene.field)))
        return drawn, truth

    return compare


@pytest.fixture(scope="session")
def functions(renderer, tmp_path_factory):
    """Functions inside of a kernel, by its name and Slang text that completes it (kernel_functions.py)."""
    folder = tmp_path_factory.mktemp("kernels")
    return lambda name, exports="": KernelFunctions(renderer("vulkan").device, name, folder, exports)


@pytest.fixture(scope="session")
def integrate(renderer):
    """What rays accumulate in a dataset's first field, and from fragments given as depths, colours and alphas."""

    def draw(dataset, view, *media_or_transfers, fragments=(), **options):
        media = [each if isinstance(each, Medium) else Medium(each) for each in media_or_transfers]
        names = {medium.quantity for medium in media} - {None}
        volume = volume_of(dataset, [dataset.fields[0].name, *sorted(names)])
        loaded = DeviceVolume(renderer("vulkan").device, volume)
        faces = FaceDrawer(loaded, faces_of(dataset, volume))
        under = FragmentLists.of(loaded.device, view.count, fragments, (0.0, 0.0, 0.0)).compose()
        return VolumeRenderer(loaded, lambda: faces).draw(view, media, under, **options)

    return draw


def tolerance_of(field):
    """A hundred thousand millionth of the field's range; what is nearly constant has the rounding of its values."""
    whole = field_range(field.blocks)
    largest = max(abs(whole.lower), abs(whole.upper))
    return max(1e-11 * (whole.upper - whole.lower), 8 * np.finfo(float).eps * largest)


@pytest.fixture(scope="session")
def tolerance():
    """How far values of a field may differ."""
    return tolerance_of


def check_pixels(drawn, truth, mesh, tolerance):
    assert drawn.counts()["failed"] == truth.counts()["failed"] == 0
    inner = margin_of(truth, mesh) > BORDER
    assert np.array_equal(drawn.element[inner], truth.element[inner])
    assert (drawn.status[inner] == Status.CERTAIN).all()

    # covered exactly: borders belong to some element, and beyond them there is nothing
    assert drawn.seen[margin_of(truth, mesh) > -1e-12].all()
    assert (np.abs(margin_of(drawn, mesh)[drawn.seen & ~truth.seen]) < BORDER).all()

    same = drawn.seen & (drawn.element == truth.element)
    assert np.array_equal(np.isnan(drawn.field[same]), np.isnan(truth.field[same]))
    assert np.nanmax(np.abs(drawn.field - truth.field)[same]) <= tolerance
    assert np.abs(drawn.reference - truth.reference)[same].max() <= 1e-9


def margin_of(frame, mesh):
    """(h, w) margin of what is seen, from the frame's reference coordinates; NaN elsewhere.

    Plane elements end at -1 and 1 in the third coordinate: it is 0 in plane data, zeta in quasi-3D data.
    """
    result = np.full(frame.element.shape, np.nan)
    for shape, entities in mesh.elements.items():
        here = np.isin(frame.element, entities.ids)
        own, beyond = np.split(frame.reference[here], [shape.dimension], axis=1)
        ends = (0.5 - 0.5 * np.abs(beyond)).min(axis=1, initial=np.inf)
        result[here] = np.minimum(margins(shape, own), ends)
    return result


@pytest.fixture(scope="session")
def linear():
    """A dataset with the field x + 2 y - 3 z, made of the coefficients of the map itself, so exact on any mesh."""

    def make(mesh, name="u"):
        blocks = [
            Block(block.expansion, block.element_ids, np.einsum("nik,i->nk", block.coefficients, [1.0, 2.0, -3.0]))
            for block in geometry(Dataset(mesh))
        ]
        return Dataset(mesh, (Field(name, tuple(blocks)),))

    return make


@pytest.fixture(scope="session")
def cube(linear):
    """Eight hexahedra of the unit cube with the field of ``linear``."""
    return linear(grid(Shape.HEXAHEDRON, 2))
