"""Datasets in the hands of PyVista, meshio and xarray: what arrives, and whether the error is as measured."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, ElvisError, read, sample, to_meshio, to_pyvista, to_xarray
from elvis.converters.shared.linear import _weights, linear_cells
from elvis.core.mapping.cutting import template
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, one_element, ripple

pyvista = pytest.importorskip("pyvista")
meshio = pytest.importorskip("meshio")


def wave(x):
    return np.sin(3 * x[:, 0]) * np.cos(2 * x[:, 1]) + x[:, 2] ** 2


@pytest.fixture(scope="module")
def solid():
    """All volume shapes, curved, with a field of degree 4 and one of degree 1."""
    bare = Dataset(curved(mixed_volume(seed=1), ripple(0.03), n=4), time=0.5)
    fields = (approximated(bare, "p", wave, modes=5), approximated(bare, "u", lambda x: x[:, 0], modes=5))
    return replace(bare, fields=fields)


@pytest.fixture(scope="module")
def plane():
    bare = Dataset(mixed_plane(seed=3))
    return replace(bare, fields=(approximated(bare, "u", lambda x: 1 + x[:, 0] - 3 * x[:, 1], modes=2),))


def worst(dataset, found, name):
    """The error of a PyVista grid in the middle of its cells, by PyVista's own probe there."""
    centres = found.cell_centers().points
    probed = pyvista.PolyData(centres).sample(found)
    exact = sample(dataset, name, centres)
    same = probed["vtkValidPointMask"].astype(bool) & (exact.location.element_id == probed["element"])
    assert same.mean() > 0.5
    return np.abs(probed[name] - exact[name])[same].max()


@pytest.mark.parametrize("refinement", [0, 1, 2, 3])
def test_the_stated_error_is_that_of_pyvista(solid, refinement):
    found = to_pyvista(solid, "p", refinement)
    told = found.field_data["error of p"][0]
    seen = worst(solid, found, "p")
    assert 0.1 * told < seen < 2 * told


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON])
def test_errors_fall_by_four_with_each_refinement(shape):
    bare = Dataset(curved(grid(shape, 2), ripple(0.03), n=4))
    dataset = replace(bare, fields=(approximated(bare, "p", wave, modes=5),))
    for name in ("p", "coordinates"):
        errors = [to_pyvista(dataset, "p", level).field_data[f"error of {name}"][0] for level in (2, 3, 4)]
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.4)
        assert errors[1] / errors[2] == pytest.approx(4, rel=0.3)


def test_points_have_exact_values(solid):
    found = to_pyvista(solid, ["p", "p*u"], 1)
    at = sample(solid, ["p", "p*u"], found.points, all=True)
    for name in ("p", "p*u"):
        differences = np.full(found.n_points, np.inf)
        np.minimum.at(differences, at.location.point, np.abs(at[name] - found[name][at.location.point]))
        assert differences.max() < 1e-12
    assert found.field_data["TimeValue"].tolist() == [0.5]
    assert set(found["element"]) == set(np.unique(solid.mesh.domain_ids()))


@pytest.mark.parametrize("refinement", [0, 1, 2])
def test_cells_fill_the_domain(refinement):
    """Volumes of all cells are positive, and add up to that of straight elements."""
    straight = Dataset(mixed_volume(seed=1))
    sizes = to_pyvista(straight, "x", refinement).compute_cell_sizes()["Volume"]
    assert (sizes > 0).all()
    assert sizes.sum() == pytest.approx(to_pyvista(straight, "x", 0).compute_cell_sizes()["Volume"].sum(), rel=1e-12)


@pytest.mark.parametrize("refinement", [0, 1])
def test_fourier_directions_become_cells(nektar, refinement):
    """Triangles and quadrilaterals over a period: values are exact, cells are positive and fill the box."""
    quasi = read(*sorted((nektar / "triquad_h1d").glob("*[!t]")))
    found = to_pyvista(quasi, ["u", "x*w"], refinement)
    at = sample(quasi, ["u", "x*w"], found.points, all=True)
    for name in ("u", "x*w"):
        differences = np.full(found.n_points, np.inf)
        np.minimum.at(differences, at.location.point, np.abs(at[name] - found[name][at.location.point]))
        assert differences.max() < 1e-12
    sizes = found.compute_cell_sizes()["Volume"]
    assert (sizes > 0).all()
    assert sizes.sum() == pytest.approx(np.prod(np.ptp(np.reshape(found.bounds, (3, 2)), axis=1)), rel=1e-12)
    assert set(found.celltypes) == {pyvista.CellType.WEDGE, pyvista.CellType.HEXAHEDRON}
    assert to_meshio(quasi, "u", refinement).cells_dict.keys() == {"wedge", "hexahedron"}


def test_cells_of_high_order_have_no_fourier_directions(nektar):
    quasi = read(*sorted((nektar / "triquad_h1d").glob("*[!t]")))
    with pytest.raises(ElvisError, match="without Fourier directions, found some with"):
        to_pyvista(quasi, "u", refinement=None)


def test_linear_data_arrive_exactly(plane):
    found = to_pyvista(plane, refinement=0)
    assert found.field_data["error of u"][0] < 1e-14
    assert found.field_data["error of coordinates"][0] < 1e-14
    assert found.n_cells == sum(map(len, plane.mesh.elements.values()))


def test_without_refinement_cells_are_of_high_order(solid):
    found = to_pyvista(solid, "p", refinement=None)
    assert found.n_cells == len(solid.mesh.domain_ids())
    assert found.field_data["error of p"][0] < 1e-12
    with pytest.raises(ElvisError, match=r"p\^2 is not a field: give a refinement"):
        to_pyvista(solid, ["p^2"], refinement=None)


def test_errors_beyond_the_bound_are_rejected(solid):
    with pytest.raises(ElvisError, match=r"expected errors up to 0.0001 of the range, found .* in .*take a higher"):
        to_pyvista(solid, "p", 0, max_error=1e-4)
    with pytest.raises(ElvisError, match="take a higher refinement"):
        to_meshio(solid, "p", 0, max_error=1e-4)


@pytest.mark.parametrize("refinement", [-1, 9])
def test_refinements_have_bounds(solid, refinement):
    with pytest.raises(ElvisError, match=f"expected a refinement from 0 to 8, found {refinement}"):
        to_pyvista(solid, "p", refinement)


def test_meshio_objects_have_the_same_values(solid, tmp_path):
    mesh, other = to_meshio(solid, "p", 1), to_pyvista(solid, "p", 1)
    assert np.array_equal(mesh.points, other.points)
    assert np.array_equal(mesh.point_data["p"], other["p"])
    assert mesh.info["errors"]["p"]["error"] == other.field_data["error of p"][0]
    mesh.write(tmp_path / "a.vtu")
    again = pyvista.read(tmp_path / "a.vtu")
    assert again.compute_cell_sizes()["Volume"].sum() == pytest.approx(other.compute_cell_sizes()["Volume"].sum())


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 0])
def test_weights_match_those_of_linear_functions(shape):
    weights = _weights(shape)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert (weights > 0).all()
    # vtk's own functions agree: cells of linear data are exact at their middle
    cut = template(shape, 2)
    assert sum(map(len, cut.cells.values())) >= 2 ** (2 * shape.dimension)


def test_segments_and_single_elements():
    bare = Dataset(one_element(Shape.SEGMENT))
    cells = linear_cells(replace(bare, fields=(approximated(bare, "u", lambda x: x[:, 0], modes=3),)), None, 3)
    assert len(cells.cells[Shape.SEGMENT]) == 8


def test_xarray_has_exact_values_by_name(solid):
    xarray = pytest.importorskip("xarray")
    found = to_xarray(solid, ["p", "u"], (5, 4, 3))
    assert isinstance(found, xarray.Dataset)
    assert dict(found.sizes) == {"z": 3, "y": 4, "x": 5}
    x, y, z = (float(found[name][1]) for name in "xyz")
    assert float(found["p"].sel(x=x, y=y, z=z)) == pytest.approx(sample(solid, "p", (x, y, z))["p"][0], nan_ok=True)
    assert found.attrs["time"] == 0.5


def test_xarray_of_flat_data_has_two_dimensions(plane):
    pytest.importorskip("xarray")
    found = to_xarray(plane, None, 7, box=((0.1, 0.2), (0.3, 0.2)))
    assert found["u"].dims == ("y", "x")
    assert float(abs(found["u"] - (1 + found["x"] - 3 * found["y"])).max()) < 1e-13
    with pytest.raises(ElvisError, match="counts: expected 2 whole numbers"):
        to_xarray(plane, None, (3, 3, 3))
    with pytest.raises(ElvisError, match="box: expected lower and upper ends"):
        to_xarray(plane, None, 3, box=((1, 1), (0, 0)))


@pytest.mark.parametrize(
    ("function", "module"), [(to_pyvista, "pyvista"), (to_meshio, "meshio"), (to_xarray, "xarray")]
)
def test_missing_libraries_are_named(plane, monkeypatch, function, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ElvisError, match=rf"{function.__name__} needs {module}.*pip install 'elvis-viz\[notebook\]'"):
        function(plane)
