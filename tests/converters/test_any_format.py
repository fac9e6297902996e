"""Every command takes the files of every format: they are converted in memory, and one sentence tells the error."""

import shutil

import click
import numpy as np
import pytest

from elvis import ElvisError, FormatError, render
from elvis.converters.pyfr.pyfr import PyFR
from elvis.plugins import read
from elvis.plugins.command.command import elvis as group

FORMATS = {
    "cgns": ["cgns/gmsh_mixed_o2.cgns"],
    "exodus": ["exodus/simple-cube-multi-element-order2.e"],
    "gmf": ["gmf/ball_tetP3_sol4.meshb", "gmf/ball_tetP3_sol4.solb"],
    "gmsh": ["gmsh/mixed_o3.msh"],
    "hopr": ["hopr_flexi/convcurved_N4_State.h5"],
    "mfem": ["mfem/escher_p3.mesh", "mfem/escher_p3.u.gf"],
    "nek": ["nek5000/ethier.nek5000"],
    "ngsolve": ["ngsolve/hexprism_p3_hex.elems.npz"],
    "pyfr": ["pyfr/mixed3d_p3.pyfrm", "pyfr/mixed3d_p3-01.pyfrs"],
    "vtk": ["vtk/dealii_shell_p4.vtu"],
}
NOTE = "converted in memory, "


@pytest.fixture(scope="module", autouse=True)
def home(tmp_path_factory):
    """A cache for all of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(params=FORMATS)
def files(request, solvers):
    return [solvers / name for name in FORMATS[request.param]]


@pytest.mark.sampled(least=5, free=("files",))
def test_read_and_commands_report_the_same(files, elvis, elvis_json, capsys, tmp_path):
    dataset = read(*files)
    (remark,) = dataset.remarks
    assert remark.startswith(", ".join(file.name for file in files) + ": " + NOTE)
    facts = elvis_json("info", *files)
    assert sum(facts["mesh"]["elements"].values()) == len(dataset.mesh.domain_ids())
    assert elvis_json("norms", *files)["x"]["L2"] > 0
    elvis("probe", *files, "--line", "0,0,0:0.1,0.2,0.3", "-n", "3", "--field", "x+2*y", "-o", tmp_path / "p.npz")
    capsys.readouterr()
    with np.load(tmp_path / "p.npz") as found:
        inside, wanted = found["status"] == 1, found["x"] + 2 * found["y"]
        assert np.allclose(found["x+2*y"][inside], wanted[inside], rtol=0, atol=1e-10)
        assert np.isnan(found["x+2*y"][~inside]).all()


@pytest.mark.thorough
@pytest.mark.sampled(least=2, free=("name",))
@pytest.mark.parametrize("name", ["vtk", "gmsh", "mfem", "cgns"])
def test_pictures_of_files_and_of_what_convert_writes_are_equal(name, solvers, elvis, tmp_path):
    files = [solvers / part for part in FORMATS[name]]
    elvis("convert", *files, "-o", tmp_path / "a.xml")
    options = {"field": "x*y", "camera": "iso", "size": (12, 8), "device": "reference"}
    direct, by_hand = render(files, **options), render(read(*sorted(tmp_path.glob("a.*"))), **options)
    assert direct.status.any()
    for key in ("field", "element", "position", "status"):
        assert np.array_equal(getattr(direct, key), getattr(by_hand, key), equal_nan=True)
    assert [NOTE in remark for remark in direct.stats["remarks"]].count(True) == 1


def test_a_picture_has_one_note(solvers, elvis, tmp_path):
    from click.testing import CliRunner

    from elvis.plugins.command.command import elvis as group

    options = [
        "--faces",
        "all",
        "--camera",
        "3,-2,1.6:0,0,0",
        "--size",
        "12x8",
        "--device",
        "reference",
        "-o",
        tmp_path / "a.png",
    ]
    arguments = ["render", solvers / FORMATS["vtk"][0], *options, "--save-scene", tmp_path / "a.toml"]
    done = CliRunner().invoke(group, list(map(str, arguments)), standalone_mode=False)
    assert done.exception is None
    assert done.stderr.count(NOTE) == 1
    assert done.stderr.startswith("elvis: note: dealii_shell_p4.vtu: converted in memory, exact")
    assert "reader" not in (tmp_path / "a.toml").read_text()


@pytest.mark.thorough
def test_compare_accepts_any_format(solvers, elvis, capsys):
    elvis("compare", solvers / FORMATS["vtk"][0], "--faces", "all", "--camera", "iso", "--size", "16x12",
          "--refinements", "0", "--validate", "0")  # fmt: skip


def test_export_accepts_any_format(solvers, elvis, tmp_path):
    pytest.importorskip("gmsh")
    elvis("export", solvers / FORMATS["vtk"][0], "-o", tmp_path / "a.msh")
    assert [field.name for field in read(tmp_path / "a.msh").fields] == ["u", "w"]


def test_options_of_converters(solvers, elvis, elvis_json, tmp_path):
    pytest.importorskip("ngsolve")
    files = [solvers / "ngsolve" / "ballbox_p4.vol", solvers / "ngsolve" / "ballbox_p4.u.gfu"]
    with pytest.raises(ElvisError, match=r"--reader spaces=H1:5,L2:4"):
        read(*files)
    spaces = {"spaces": "H1:5"}
    assert read(*files, reader=spaces).fields[0].name == "u"
    facts = elvis_json("info", *files, "--reader", "spaces=H1:5")
    assert facts["fields"][0]["name"] == "u"
    with pytest.raises(ElvisError, match=r"NGSolve has no option 'space'; its options are: spaces"):
        read(*files, reader={"space": "H1:5"})
    with pytest.raises(ElvisError, match=r"as NAME=VALUE, found 'spaces'"):
        read(*files, reader=["spaces"])
    with pytest.raises(ElvisError, match=r"there is no converter 'netgen'"):
        read(*files, reader={"from": "netgen"})


def test_the_map_is_geometry_and_no_field(solvers, elvis, elvis_json):
    files = [solvers / part for part in FORMATS["pyfr"]]
    names = ["rho", "rhou", "rhov", "rhow", "E"]
    dataset = read(*files)
    assert dataset.map_names == ("map_x", "map_y", "map_z")
    assert [field.name for field in dataset.solution] == names
    assert "map_x" not in repr(dataset) + dataset._repr_html_()
    assert [field["name"] for field in elvis_json("info", *files)["fields"]] == names
    assert list(elvis_json("norms", *files)) == ["x", "y", "z", *names]
    assert (
        elvis("probe", *files, "--line", "0,0,0:1,1,1", "-n", "2")
        .splitlines()[0]
        .endswith(",status," + ",".join(names))
    )
    with pytest.raises(ElvisError, match="the fields are rho, rhou, rhov, rhow, E;") as told:
        elvis("norms", *files, "--field", "map_u")
    assert "map_x" not in str(told.value)


def test_the_report_of_a_conversion_is_a_table(solvers, elvis, elvis_json):
    files = [solvers / part for part in FORMATS["pyfr"]]
    shown = elvis("info", *files)
    assert "converted from mixed3d_p3.pyfrm, mixed3d_p3-01.pyfrs (PyFR mesh and solution (.pyfrm, .pyfrs))" in shown
    rows = {line.split()[0]: line.split() for line in shown.partition("converted from")[2].splitlines() if line}
    assert rows["rho"][1:3] == ["3", "exact"]
    assert float(rows["coordinates"][3]) < 1e-13
    assert "{" not in shown
    assert elvis_json("info", *files)["conversion"]["fields"]["rho"]["order"] == 3


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100000, '{"geometry": 1}', '{"geometry": {"order": 1e999}}'])
def test_a_text_that_is_not_a_report_is_printed_unchanged(text):
    from elvis.plugins.conversion.report import RecordedReport

    assert RecordedReport.of({"ConversionReport": text}) is None


def test_native_files_are_unchanged(solvers, elvis, tmp_path):
    elvis("convert", solvers / FORMATS["vtk"][0], "-o", tmp_path / "a.xml")
    native = read(tmp_path / "a.xml", tmp_path / "a.fld")
    assert native.remarks == ()
    part = read(tmp_path / "a.xml", tmp_path / "a.fld", reader=["from=native"])
    assert len(part.remarks) == 1


def test_a_converter_in_a_file(elvis_json, tmp_path):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom elvis.core.shapes import Shape\n"
        "from elvis.plugins.conversion.plugin import Converter, Elements\n\n\n"
        "class Mine(Converter):\n"
        "    @classmethod\n    def opens(cls, paths):\n        return True\n\n"
        "    def __init__(self, paths):\n        self.blocks = [Elements(Shape.TETRAHEDRON, 1)]\n\n"
        "    def positions(self, block, points):\n        return points[None]\n"
    )
    (tmp_path / "a.mine").write_text("one tetrahedron")
    facts = elvis_json("info", tmp_path / "a.mine", "--plugin", tmp_path / "mine.py")
    assert facts["mesh"]["elements"] == {"tetrahedron": 1}


def test_unrecognised_files(solvers, tmp_path):
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(ElvisError, match=r"a\.txt: expected a file of a known format \(cgns, .*vtx\), found a text"):
        read(tmp_path / "a.txt")
    with pytest.raises(ElvisError, match=r": expected a file of a known .*without files of a known format$"):
        read(tmp_path)
    shutil.copy(solvers / FORMATS["vtk"][0], tmp_path)
    with pytest.raises(ElvisError, match=r"found a folder: pass files from it, such as .*dealii_shell_p4\.vtu$"):
        read(tmp_path)
    with pytest.raises(FormatError, match="there is no such file"):
        read(tmp_path / "none.vtu")


def test_roles_and_steps(solvers, nektar, tmp_path):
    with pytest.raises(ElvisError, match=r"found only grid functions: give the \.mesh file"):
        read(solvers / "mfem" / "escher_p3.u.gf")
    steps = [solvers / "pyfr" / f"mixed3d_p3{name}" for name in (".pyfrm", "-00.pyfrs", "-01.pyfrs")]
    with pytest.raises(FormatError, match="found 1 and 2; of the steps of a series give one solution"):
        PyFR(steps)
    assert read(*steps).time == read(steps[0], steps[2]).time
    chk = nektar / "hex_chk" / "Hex_channel_m3_0.chk"
    with pytest.raises(
        FormatError, match=r"where only fields are; also give the mesh file, perhaps .*Hex_channel_m3\.xml$"
    ):
        read(chk)
    (tmp_path / "conditions.xml").write_text("<NEKTAR><CONDITIONS><P>x</P></CONDITIONS></NEKTAR>")
    with pytest.raises(FormatError, match=r"where only conditions are; also give the mesh file$"):
        read(tmp_path / "conditions.xml")


@pytest.mark.parametrize("name", ["vtk/dealii_shell_p4.vtu", "pyfr/mixed3d_p3-01.pyfrs", "gmsh/mixed_o3.msh"])
def test_damaged_files_give_a_one_line_error(solvers, tmp_path, name):
    whole = (solvers / name).read_bytes()
    for end in (len(whole) // 7, len(whole) // 2):
        path = tmp_path / name.rpartition("/")[2]
        path.write_bytes(whole[:end])
        with pytest.raises(ElvisError) as told:
            read(path)
        assert "\n" not in str(told.value)


#: a unit square with two fields
SQUARE = """# vtk DataFile Version 3.0
square
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 4 double
0 0 0 1 0 0 1 1 0 0 1 0
CELLS 1 5
4 0 1 2 3
CELL_TYPES 1
9
POINT_DATA 4
SCALARS u double
LOOKUP_TABLE default
0 1 1 0
SCALARS v double
LOOKUP_TABLE default
0 0 1 1
"""


def test_every_command_reads_some_fields_on_request(elvis, elvis_json, tmp_path):
    """The option has one meaning, whatever the format."""
    (tmp_path / "a.vtk").write_text(SQUARE)
    elvis("convert", tmp_path / "a.vtk", "-o", tmp_path / "a.xml")
    for files in ([tmp_path / "a.vtk"], [tmp_path / "a.xml", tmp_path / "a.fld"]):
        assert list(read(*files)) == ["u", "v"]
        assert list(read(*files, reader={"fields": "v"})) == ["v"]
        assert [field["name"] for field in elvis_json("info", *files, "--fields", "v")["fields"]] == ["v"]
        header = elvis("probe", *files, "--point", "0,0", "--fields", "v").split()[0]
        assert header == "point,x,y,z,element,status,v"
        for command, *rest in (["integrate", "--field", "u"], ["render", "--field", "u", "-o", tmp_path / "a.png"]):
            with pytest.raises(ElvisError, match="there is no 'u'; the fields are v"):
                elvis(command, *files, "--fields", "v", *rest)
        with pytest.raises(ElvisError, match="'q'"):
            elvis("norms", *files, "--fields", "q")
    context = click.Context(group)
    names = [names_of(group.get_command(context, name)) for name in group.list_commands(context)]
    assert sum("reader" in own for own in names) > 10
    assert all("fields" in own for own in names if "reader" in own)


def names_of(command):
    """The names of the parameters of a command."""
    return {parameter.name for parameter in command.get_params(click.Context(command))}
