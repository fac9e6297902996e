"""Comparisons of 2D data: linear pictures of their own plane, VTK's among them."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Scene
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.reference import study
from elvis.reference.baseline.vtk import VtkBaseline
from elvis.reference.report.conclusion import conclusion
from elvis.reference.report.tables import every_table


def wave(points):
    return np.sin(3 * points[:, 0]) + points[:, 1] ** 2


@pytest.fixture(scope="module")
def flat():
    """Curved quadrilaterals of order 5 in the plane."""
    mesh = curved(grid(Shape.QUADRILATERAL, 2), lambda points: points + 0.05 * bent(points), 4)
    return with_field(mesh, wave, modes=6)


def bent(points):
    """A displacement within the plane."""
    return np.stack([np.sin(2 * points[:, 1]), np.cos(3 * points[:, 0]), np.zeros(len(points))], axis=1)


def compared(flat):
    scene = Scene("u", size=(60, 50), device="reference")
    return study.compare_scene(flat, scene, (0, 2), validation_size=0)


def test_vtk_draws_2d_data_in_their_own_plane(flat):
    pytest.importorskip("vtkmodules")
    made = compared(flat)
    vtk = made.rivals[-1]
    assert vtk.name == "VTK's own cells"
    assert vtk.skipped is None

    # what VTK shows of high-order cells is linear pieces, but of the same domain and the same field
    both = (vtk.record.status > 0) & (made.exact.status > 0)
    assert both.sum() > 0.97 * (made.exact.status > 0).sum()
    off = np.abs(vtk.record.field - made.exact.field)[both]
    assert off.max() < 0.1 * (made.ends[1] - made.ends[0])
    assert vtk.errors.value_max < made.rivals[0].errors.value_max


def test_an_empty_picture_is_skipped_with_the_reason_and_never_scored(flat, monkeypatch):
    pytest.importorskip("vtkmodules")
    whole = VtkBaseline.triangles

    def nothing(self, shown, field):
        mesh = whole(self, shown, field)
        return replace(mesh, simplices=mesh.simplices[:0], element=mesh.element[:0])

    monkeypatch.setattr(VtkBaseline, "triangles", nothing)
    made = compared(flat)
    vtk = made.rivals[-1]
    assert (vtk.errors, vtk.record) == (None, None)
    assert vtk.skipped == study.NOTHING_DRAWN
    rows = [row for table in every_table(made) for row in table["rows"] if row[0] == vtk.name]
    assert any(study.NOTHING_DRAWN in row for row in rows)
    assert conclusion(made)
