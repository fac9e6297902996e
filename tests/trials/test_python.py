"""What new users try in Python: the lines of an afternoon, and what they expect of them."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from archives import arrays_of

ROOT = Path(__file__).resolve().parents[2]
SIZE = {"size": (40, 30), "device": "reference"}


@pytest.fixture(scope="module", autouse=True)
def place(tmp_path_factory):
    """A working folder with the sample data."""
    folder = tmp_path_factory.mktemp("data")
    runpy.run_path(str(ROOT / "examples" / "generate.py"))["main"](folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


def test_data_describe_themselves():
    from elvis import ElvisError, read

    ds = read("cylinder.xml", "cylinder.fld")
    assert len(repr(ds)) < 300
    assert "288 triangles" in repr(ds)
    assert list(ds) == ["u", "v", "Cp"]
    assert "u" in ds
    assert "speed" not in ds
    assert len(repr(ds["u"])) < 300
    assert "<table" in ds._repr_html_()
    assert len(repr(ds.mesh)) < 500
    with pytest.raises(KeyError, match=r"there is no field 'cp' \(perhaps Cp\)"):
        ds["cp"]
    with pytest.raises(ElvisError, match="there is no such file"):
        read("nothing.vtu")
    foreign = read("eddies0.f00000")
    assert list(foreign) == ["velocity_x", "velocity_y"]
    assert "converted in memory" in foreign.remarks[0]


def test_values_are_exact():
    from elvis import line, norms, read, sample

    ds = read("cylinder.xml", "cylinder.fld")
    found = sample(ds, ["speed", "d(u,x)"], (0.0, 2.0))
    assert found["speed"] == pytest.approx([1.25 - 2.5 / (4 * np.pi)], abs=1e-4)
    assert sample(ds, "u", [(0.0, 2.0), (9.0, 9.0)])["u"].shape == (2,)
    assert np.isnan(sample(ds, "u", (9.0, 9.0))["u"]).all()
    along = line(ds, "Cp", (1.5, 0.0), (4.0, 0.0), 11)
    assert len(along["Cp"]) == 11
    assert list(along.to_pandas()["Cp"]) == list(along["Cp"])
    assert norms(ds)["u"].l2 > 0


def test_pictures_take_the_names_of_the_command_line():
    from elvis import Plane, Scene, read, render

    frame = render("cylinder.xml", "cylinder.fld", "u", **SIZE)
    assert frame.image.shape == (30, 40, 3)
    assert frame.image.dtype == np.uint8
    assert frame._repr_png_().startswith(b"\x89PNG")
    assert len(repr(frame)) < 500
    frame.save("u.png")
    frame.save("u.npz")
    assert Path("u.png").stat().st_size
    assert arrays_of("u.npz")["status"].shape == (30, 40)
    blocks = read("blocks.xml", "blocks.fld")
    cut = ((1.5, 0.5, 0.45), (0.1, 0.2, 1))
    # NumPy takes a minute for contours of order 6
    picture = render(blocks, "wave", contours=5, colormap="turbo", plane=cut, size=(40, 30))
    same = render(blocks, Scene("wave", plane=Plane(*cut), palette="turbo", size=(40, 30)), contours=5)
    assert np.array_equal(picture.image, same.image)
    assert picture.counts()["failed"] == 0
    assert render("eddies0.f00000", "vorticity_z", **SIZE).counts()["certain"] > 500


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda api: api.render("cylinder.xml", "cylinder.fld", "u", colourmap="turbo"), "did you mean colormap"),
        (lambda api: api.render("cylinder.xml", "cylinder.fld", "U"), r"there is no 'U' \(perhaps u\)"),
        (lambda api: api.Scene(plnae=3), "Scene has no keyword 'plnae': did you mean plane"),
        (lambda api: api.Scene(contours=3), r"Scene has no keyword 'contours': use render\(data, contours=...\)"),
        (lambda api: api.Plane((0, 0, 0), normale=(0, 0, 1)), "Plane has no keyword 'normale': did you mean normal"),
        (lambda api: api.render("blocks.xml", "blocks.fld", "wave", plane=((9, 9, 9), (0, 0, 1))), "picture is empty"),
    ],
)
def test_mistakes_are_reported_with_a_hint(make, words):
    import elvis

    with pytest.raises(elvis.ElvisError, match=words):
        make(elvis)


def test_other_libraries_exchange_arrays():
    from elvis import from_arrays, read, sample, to_meshio, to_pyvista

    ds = read("blocks.xml", "blocks.fld")
    grid = to_pyvista(ds, refinement=1)
    assert grid.n_cells > 4
    assert grid.field_data["error of wave"].max() > 0
    assert to_meshio(ds, refinement=0).points.shape[1] == 3
    corners = np.array([[(0, 0), (1, 0), (0, 1), (1, 1)]], float)
    square = from_arrays({"quadrilateral": corners}, u=corners[..., 0] * corners[..., 1])
    assert sample(square, "u", (0.25, 0.5))["u"] == pytest.approx([0.125])


def test_a_dataset_has_the_names_that_users_try():
    from elvis import ElvisError, read

    ds = read("cylinder.xml", "cylinder.fld")
    assert ds.bounds == pytest.approx(np.array([[-5, -5], [5, 5]]), abs=1e-3)
    assert (ds.n_elements, ds.order, ds.boundaries) == (288, 8, ("cylinder", "far"))
    assert ds.times.tolist() == [ds.time]
    assert {"u", "speed", "vorticity"} <= set(ds._ipython_key_completions_())
    assert "lambda2" not in read("blocks.xml", "blocks.fld")._ipython_key_completions_()
    with pytest.raises(ElvisError, match="expected the coordinates x, y, found 1 of them"):
        ds["u"](0.5)
    with pytest.raises(ElvisError, match=r"u\.png: expected a name that ends in .* dataset\.plot\(\)\.save"):
        ds.save("u.png")
    with pytest.raises(ElvisError, match="expected coordinates as numbers that can be broadcast"):
        ds["u"]([1, 2], [1, 2, 3])
    with pytest.raises(KeyError, match="expression 'u \\+'"):
        ds["u +"]


def test_fields_and_quantities_are_functions():
    from dataclasses import replace

    from elvis import read, sample

    ds = read("cylinder.xml", "cylinder.fld")
    angle = np.linspace(0, 6, 12).reshape(3, 4)
    x, y = 2 * np.cos(angle), 2 * np.sin(angle)
    speed, points = ds["speed"], np.stack([x, y], -1).reshape(-1, 2)
    assert np.array_equal(speed(x, y).ravel(), sample(ds, "speed", points)["speed"])
    assert np.array_equal(speed(points), speed(x, y).ravel())
    assert speed(points[0]) == speed(x[0, 0], y[0, 0])
    # the potential flow around the cylinder, u = 1 - (x² - y²)/r⁴ and its circulation, has no vorticity
    assert abs(ds["vorticity"](x, y)).max() < 1e-3 * speed.range[1]
    assert isinstance(ds["u"](0.0, 2.0), float)
    assert np.isnan(ds["u"](9.0, 9.0))
    assert ds["u"](0.0, [2.0, 9.0]).shape == (2,)
    low, high = ds["u"].range
    assert low <= ds["u"](x, y).min()
    assert ds["u"](x, y).max() <= high
    # a field that was changed is evaluated as it is
    doubled = tuple(replace(own, coefficients=2 * own.coefficients) for own in ds["u"].blocks)
    assert replace(ds["u"], name="twice", blocks=doubled)(0.0, 2.0) == pytest.approx(2 * ds["u"](0.0, 2.0), rel=1e-14)


def test_data_are_plotted_and_saved_by_methods():
    from matplotlib.figure import Figure

    from elvis import read

    ds = read("cylinder.xml", "cylinder.fld")
    assert ds.save("saved.xml", field_format="hdf5") == (Path("saved.xml"), Path("saved.fld"))
    assert np.array_equal(read("saved.xml", "saved.fld")["u"](2.0, 1.0), ds["u"](2.0, 1.0))
    axes = Figure().subplots()
    frame = ds.plot("Cp", ax=axes, **SIZE)
    image = axes.images[0]
    # the middle of a pixel is where the record has it
    height, width = frame.element.shape
    left, right, bottom, top = image.get_extent()
    middle = frame.position[10, 20]
    assert left + (20 + 0.5) * (right - left) / width == pytest.approx(middle[0], abs=1e-12)
    assert top + (10 + 0.5) * (bottom - top) / height == pytest.approx(middle[1], abs=1e-12)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x", "y")
    assert np.array_equal(np.asarray(image.get_array()), frame.image)
    bar = axes.figure.axes[1]
    assert bar.get_ylabel() == "Cp"
    assert bar.get_ylim() == pytest.approx(frame.range, rel=1e-14)
    # a view in space has no axes
    solid = Figure().subplots()
    ds["Cp"].plot(ax=solid, camera="iso", **SIZE)
    assert not solid.axison


@pytest.mark.parametrize("name", ["generate", "cases"])
def test_help_of_examples_makes_nothing(name, tmp_path):
    command = [sys.executable, ROOT / "examples" / f"{name}.py", "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout[:6]) == (0, "usage:")
    assert not list(tmp_path.iterdir())
