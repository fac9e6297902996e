"""What is installed is what was tested: the wheel in an environment of its own, used from an empty folder."""

import os
import re
import subprocess
import sys
import sysconfig
import zipfile

import pytest

#: tests to repeat on the installed modules: quick ones that reach every area
AGAINST_THE_WHEEL = (
    "tests/formats/commands/test_norms.py",
    "tests/formats/test_points.py",
    "tests/plugins/test_registry.py",
    "tests/plugins/test_runtime_tutorial.py::test_the_command_that_the_page_shows_draws_the_case",
)


def run(command, **options):
    process = subprocess.run(command, capture_output=True, text=True, timeout=600, **options)
    assert process.returncode == 0, process.stdout[-3000:] + process.stderr[-3000:]
    return process.stdout


@pytest.fixture(scope="module")
def wheel(root, tmp_path_factory):
    """The built wheel."""
    folder = tmp_path_factory.mktemp("dist")
    run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, root], cwd=folder)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel, tmp_path_factory):
    """The ``bin`` of an environment that holds the wheel; the packages it depends on come from this environment.

    A path in a ``.pth`` file adds that folder but not the ``.pth`` files in it, so the editable install stays outside.
    """
    folder = tmp_path_factory.mktemp("environment")
    run([sys.executable, "-m", "venv", "--without-pip", folder])
    python = folder / "bin" / "python"
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = run([python, "-c", ask]).strip()
    paths = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    with open(os.path.join(site, "dependencies.pth"), "w") as file:
        file.write("\n".join(sorted(paths)) + "\n")
    run([sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel])
    return folder / "bin"


def test_every_file_of_the_areas_is_in_the_wheel(root, wheel, project_files):
    inside = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        path.relative_to(root).as_posix().partition("/")[2]
        for path in project_files
        if path.relative_to(root).parts[1:2] == ("elvis",)
    }
    assert not wanted - inside
    assert any(name.endswith(".slang") for name in wanted)
    assert sum(name.endswith("py.typed") for name in wanted) == 10


def test_the_wheel_contains_nothing_else(wheel):
    others = {name for name in zipfile.ZipFile(wheel).namelist() if not name.startswith(("elvis/", "elvis_viz-"))}
    assert not others


def test_the_installed_modules_match_the_wheel(environment, tmp_path):
    code = "import elvis.core.base.errors as e, elvis.plugins as p; print(e.__file__); print(p.__file__)"
    for line in run([environment / "python", "-c", code], cwd=tmp_path).splitlines():
        assert line.startswith(str(environment.parent))


def test_every_module_of_the_wheel_imports(environment, tmp_path):
    code = (
        "import elvis, importlib, pkgutil\n"
        "for module in pkgutil.walk_packages(elvis.__path__, 'elvis.'): importlib.import_module(module.name)"
    )
    run([environment / "python", "-W", "error", "-c", code], cwd=tmp_path)


def test_every_command_shows_its_help(environment, tmp_path):
    listing = run([environment / "elvis", "--help"], cwd=tmp_path)
    names = [line.split()[0] for line in listing.partition("Commands:\n")[2].splitlines() if line[2:3].strip()]
    assert {"info", "norms", "probe", "plugins"} <= set(names)
    code = (
        "import sys\nfrom elvis.plugins.command.command import elvis\n"
        "for name in sys.argv[1:]: elvis([name, '--help'], prog_name='elvis', standalone_mode=False)"
    )
    helped = run([environment / "python", "-c", code, *names], cwd=tmp_path)
    assert re.findall(r"Usage: elvis ([\w-]+)", helped) == names


@pytest.mark.thorough
def test_a_picture_is_drawn(environment, page_folder):
    drawn = ["--field", "p", "--plane", "0,0,0.4:0,0,1", "--size", "80x60", "-o", "wing.png"]
    run([environment / "elvis", "render", "wing.xml", "wing.fld", *drawn], cwd=page_folder)
    assert (page_folder / "wing.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_the_tests_pass_against_the_wheel(root, environment, tmp_path):
    configuration = tmp_path / "pytest.ini"
    configuration.write_text("[pytest]\naddopts = --import-mode=importlib\nfilterwarnings = error\n")
    where = ["-c", configuration, "--rootdir", tmp_path, "-p", "no:cacheprovider"]
    chosen = [root / folder for folder in AGAINST_THE_WHEEL]
    environ = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHONPATH"))}
    run([environment / "python", "-m", "pytest", "-q", "-x", *where, *chosen], cwd=tmp_path, env=environ)
