"""Native to native: exact where contained, at other orders, merged, in parts, in every form of file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis.converters.native import Native
from elvis.formats import FormatError, read, write
from elvis.formats.dataset import Dataset
from elvis.formats.sampling import sample
from elvis.formats.strict import findings
from elvis.formats.testing import approximated, curved, mixed_plane, mixed_volume, ripple, shuffled
from elvis.plugins.conversion import PyramidSpace
from elvis.plugins.converting import Settings, convert
from elvis.plugins.testing import check

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "nektar"
CASES = (
    "gen_allelem_n4",
    "gen_allelem_ortho",
    "gen_allelem_var_h5",
    "kova_varp",
    "hex_gll8",
    "sphere_manifold",
    "tet_small",
)


def files(case):
    found = sorted(DATA.joinpath(case).iterdir())
    meshes = [path for path in found if path.suffix == ".xml"]
    return [*meshes, *[path for path in found if path.suffix in (".fld", ".rst", ".chk")][:1]]


def same_values(one, other, points):
    """Values of u and v, at all points that both have inside."""
    old, new = (sample(each, ["u", "v"], points).values for each in (one, other))
    assert np.isfinite(old).all(axis=0 if old.shape[0] == 2 else 1).mean() > 0.9
    assert np.array_equal(np.isfinite(old), np.isfinite(new))
    assert np.nanmax(np.abs(old - new)) < 1e-11


@pytest.fixture
def volume(tmp_path):
    dataset = Dataset(curved(shuffled(mixed_volume(3), 1), ripple(0.05), 3))
    functions = {"u": lambda x: x[:, 0] ** 2 + x[:, 1] * x[:, 2], "v": lambda x: np.sin(x[:, 0] - x[:, 2])}
    fields = tuple(approximated(dataset, name, function, 5) for name, function in functions.items())
    return write(replace(dataset, fields=fields, time=0.5, metadata={"Kinvis": "2"}), tmp_path / "volume.xml")


@pytest.mark.parametrize("case", CASES)
def test_real_files_come_back_exactly(case, tmp_path):
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    conversion = check(Native, files(case))
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    written = write(conversion.dataset, tmp_path / "a.xml")
    assert [str(each) for each in findings(*written) if "Jacobian" not in each.sentence] == []


def test_values_stay_at_their_places(volume):
    conversion = check(Native, volume)
    points = np.random.default_rng(1).uniform([0, 0.1, 0.1], [3, 0.9, 0.9], (200, 3))
    same_values(read(*volume), conversion.dataset, points)
    assert conversion.dataset.time == 0.5
    assert conversion.dataset.metadata["Kinvis"] == "2"


@pytest.mark.parametrize("order", [4, 6])
def test_higher_orders_are_exact(volume, order):
    report = convert(Native(volume), Settings(order=order)).report
    assert {measure.name: measure.state for measure in report.fields} == {"u": "exact", "v": "exact"}


def test_lower_orders_are_measured(volume):
    reports = [convert(Native(volume), Settings(order=order)).report for order in (1, 2, 3)]
    assert {measure.state for report in reports for measure in report.fields} == {"projected"}
    errors = np.array([[measure.relative for measure in report.fields] for report in reports])
    assert (errors[1:] < 0.6 * errors[:-1]).all()


def test_files_are_merged(volume, tmp_path):
    dataset = read(*volume)
    parts = []
    for field in dataset.fields:
        parts += write(
            replace(dataset, fields=(field,)), field_path=tmp_path / f"{field.name}.fld", field_format="hdf5"
        )
    merged = convert(Native([volume[0], *parts])).dataset
    assert [field.name for field in merged.fields] == ["u", "v"]
    same_values(dataset, merged, np.random.default_rng(2).uniform(0.1, 0.9, (50, 3)))


@pytest.mark.parametrize("form", ["text", "compressed", "hdf5"])
def test_the_command_takes_parts_and_forms(elvis, volume, tmp_path, form):
    elvis("convert", *volume, "-o", tmp_path / "part.xml", "--fields", "v", "--format", form, "--max-error", "1e-12")
    written = [tmp_path / "part.xml", tmp_path / "part.fld"]
    assert [field.name for field in read(*written).fields] == ["v"]
    assert findings(*written) == ()
    first = [path.read_bytes() for path in written]
    elvis("convert", *volume, "-o", tmp_path / "part.xml", "--fields", "v", "--format", form)
    assert [path.read_bytes() for path in written] == first


def test_composites_keep_their_names(tmp_path):
    mesh = mixed_plane(1)
    named = tuple(replace(c, name=f"part {c.id}") for c in mesh.composites)
    paths = write(Dataset(replace(mesh, composites=named)), tmp_path / "plane.xml")
    found = convert(Native(paths)).dataset.mesh
    assert {c.name for c in found.composites} == {c.name for c in named}
    sizes = {c.name: sum(len(ids) for _, ids in c.parts) for c in found.composites}
    assert sizes == {c.name: sum(len(ids) for _, ids in c.parts) for c in named}


def test_a_geometry_map_stays_the_map(solvers, tmp_path):
    from elvis.converters.hopr import Hopr

    source = convert(Hopr([solvers / "hopr_flexi" / "convcurved_N4_State.h5"]))
    assert source.report.has_map
    paths = write(source.dataset, tmp_path / "a.xml")
    again = check(Native, paths)
    assert again.report.geometry.state == "exact"
    assert {field.name for field in again.dataset.fields} == {field.name for field in source.dataset.fields}


def test_pyramids_keep_their_family():
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    spaces = {b.pyramid for b in Native(files("gen_allelem_ortho")).blocks if b.shape.label == "Pyramid"}
    assert spaces == {PyramidSpace.POLYNOMIAL}


def test_what_it_does_not_take(tmp_path):
    (tmp_path / "other.xml").write_text("<VTKFile/>")
    assert not Native.opens([tmp_path / "other.xml"])
    assert not Native.opens([tmp_path / "missing.xml"])
    if DATA.is_dir():
        with pytest.raises(FormatError, match="Fourier"):
            Native(files("triquad_h1d"))
