"""What the distribution says of itself agrees with itself; workflows, recipes and the citation can be read.

Recipes and workflows can't be run here; `packaging/try_wheels.py` installs what can be, one of its trials is here.
"""

import re
import runpy
import sys
from pathlib import Path

import pytest
import yaml

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
#: what conda calls packages by other names
CONDA = {"matplotlib": "matplotlib-base", "openexr": "openexr-python"}


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def wheels():
    return runpy.run_path(str(ROOT / "packaging" / "try_wheels.py"))


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=lambda path: path.name)
def test_workflows_run_commands_that_exist(path):
    """YAML takes the key ``on`` for a truth."""
    text = path.read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    steps = [step for job in jobs.values() for step in job["steps"]]
    commands = "\n".join(step["run"] for step in steps if "run" in step)
    assert all("run" in step or "uses" in step for step in steps)
    for file in re.findall(r"[\w./-]+\.(?:py|sh)\b|\.ci/run", commands):
        assert (ROOT / file).is_file(), file
    assert "not been run yet" in text


def requirements(lines):
    """Lower-case names and bounds of requirements, without markers and spaces."""
    found = (re.match(r"([\w-]+)\s*(>=[\d.]+)?", line.split(";")[0]).groups() for line in lines)
    return {(name.lower(), bound or "") for name, bound in found}


def test_the_recipe_has_the_requirements_of_the_wheel(project):
    recipe = (ROOT / "packaging" / "conda" / "elvis-viz" / "recipe.yaml").read_text(encoding="utf-8")
    needs = yaml.safe_load(recipe)["requirements"]
    wanted = {(CONDA.get(name, name), bound) for name, bound in requirements(project["dependencies"])}
    (slangpy,) = requirements(project["optional-dependencies"]["draw"])
    wanted = {each for each in wanted if each[0] != "slangpy"} | {("python", project["requires-python"])}
    assert requirements(needs["run"]) == wanted
    assert requirements(needs["run_constraints"]) == {slangpy}
    assert f'version: "{project["version"]}"' in recipe
    assert yaml.safe_load((ROOT / "packaging" / "conda" / "slangpy" / "recipe.yaml").read_text(encoding="utf-8"))


def test_the_oldest_slangpy_that_draws_is_one(project):
    from elvis.renderer.device.drawing import OLDEST

    assert project["optional-dependencies"]["draw"] == [f"slangpy>={OLDEST[0]}.{OLDEST[1]}"]


def test_the_citation_is_of_this_version(project):
    """Keys and kinds as the format's version 1.2.0 asks for."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    assert (cited["cff-version"], cited["version"]) == ("1.2.0", project["version"])
    assert [author["name"] for author in cited["authors"]] == [author["name"] for author in project["authors"]]
    assert re.fullmatch(r"10\.\d{4,9}(\.\d+)?/\S+", cited["references"][0]["doi"])


def test_extras_named_in_messages_exist(project, project_files):
    extras = set(project["optional-dependencies"])
    named = set()
    for path in project_files:
        if path.suffix in (".py", ".md", ".toml"):
            text = path.read_text(encoding="utf-8")
            named |= {name for names in re.findall(r"elvis-viz\[([\w,]+)\]", text) for name in names.split(",")}
    assert {"draw", "distances", "figures"} <= named <= extras


def test_commands_work_without_driver_and_home(wheels, tmp_path):
    """A trial in this environment: what is not to be had is said, and all else works."""
    generate = runpy.run_path(str(ROOT / "examples" / "generate.py"))
    generate["write_sample"]("blocks", tmp_path)
    generate["eddies"](tmp_path / "eddies0.f00000")
    environ = wheels["isolated"](tmp_path) | wheels["NO_DRIVER"]
    # the CPU target takes long to compile its kernels: a search path without a compiler hides it
    environ["PATH"] = "/nonexistent"
    seconds, fault = wheels["work"](Path(sys.executable).parent, tmp_path, environ)
    assert fault == ""
    assert (seconds["picture"], seconds["no driver"]) == ("says why", "says why")
    assert (tmp_path / "c.png").is_file()
    assert (tmp_path / "eddies.xml").is_file()
    assert not (tmp_path / "a.png").exists()
