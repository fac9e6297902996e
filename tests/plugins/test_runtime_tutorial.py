"""The tutorial of docs/howto/runtime-plugin.md, word for word: tried from its folder, and installed."""

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis import Faces, Scene
from elvis.plugins.runtime.opening import PluginData, plugin_named
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import interface_folder
from elvis.plugins.testing import check_volume
from elvis.reference.picture import render as render_reference

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "runtime-plugin.md"
SECTORS = np.array([[1, 2, a, a + np.pi / 3, 0, 1] for a in np.arange(6) * np.pi / 3])
ELVIS = [sys.executable, "-c", "from elvis.plugins.command.command import main; main()"]


def section():
    """The blocks of the section on runtime plugins, by language."""
    text = PAGE.read_text(encoding="utf-8")
    text = text[text.index("\n## A runtime plugin") :].split("\n## ")[1]
    return dict(re.findall(r"^```(\w+)\n(.*?)^```$", text, re.M | re.S))


@pytest.fixture
def folder(tmp_path):
    """The tutorial's files, and a case."""
    texts = section()
    for name, language in (("rings.slang", "slang"), ("rings.py", "python"), ("pyproject.toml", "toml")):
        (tmp_path / name).write_text(texts[language], encoding="utf-8")
    values = np.tile([0.5, 1.0, 2.0], (6, 1))
    np.savez(tmp_path / "case.npz", sectors=SECTORS, value_p=values, time=0.5)
    return tmp_path


def truth(points):
    """The case in closed form."""
    radius, angle = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    return 0.5 + np.log(radius) + 2 * np.cos(3 * angle) * np.exp(-points[:, 2])


def run(command, **options):
    process = subprocess.run(command, capture_output=True, text=True, timeout=600, **options)
    assert process.returncode == 0, process.stdout + process.stderr
    return process


def check_picture(path):
    """Covered but for pixels of its borders, and exact."""
    with np.load(path) as record:
        seen = record["status"] == 1
        points, field = record["position"][seen], record["field"][seen]
    radius = np.hypot(points[:, 0], points[:, 1])
    assert len(points) > 5000
    assert ((radius > 1 - 1e-9) & (radius < 2 + 1e-9)).all()
    assert np.abs(field - truth(points)).max() < 1e-11 * 4
    return len(points)


@pytest.mark.thorough
def test_the_command_that_the_page_shows_draws_the_case(folder):
    line = next(line for line in PAGE.read_text(encoding="utf-8").splitlines() if "--plugin rings.py" in line)
    arguments = re.split(r"\s{2,}", line.strip())[0].replace("-o p.png", "-o p.png -o p.npz").split()[1:]
    process = run([*ELVIS, *arguments, "--size", "150x150"], cwd=folder)
    assert process.stderr == ""
    count = check_picture(folder / "p.npz")
    with np.load(folder / "p.npz") as record:
        radius = np.hypot(record["position"][..., 0], record["position"][..., 1])
        assert count == (record["status"] == 1).sum()
        assert np.nanmin(radius) < 1.05
    assert (folder / "p.png").stat().st_size > 1000


@pytest.mark.thorough
def test_it_is_found_once_it_is_installed(folder, tmp_path_factory):
    site = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    run([*pip, "--target", site, folder], cwd=folder)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site), *filter(None, sys.path)])}
    command = [*ELVIS, "render", folder / "case.npz", "--plane", "0,0,0.5:0,0,1", "--size", "150x150", "-o", "p.npz"]
    run(command, cwd=elsewhere, env=environment)
    check_picture(elsewhere / "p.npz")
    rows = run([*ELVIS, "plugins"], cwd=elsewhere, env=environment).stdout.splitlines()
    assert any(row.split() == ["volumes", "rings", "rings", "1.0", "rings:Rings", "ok"] for row in rows)


def test_every_other_command_accepts_it(folder):
    """Points, norms and facts, against analytic expressions; what the page shows, as it stands there."""
    shown = [line.split("#")[0].strip() for line in PAGE.read_text(encoding="utf-8").splitlines()]
    shown = {line.split()[1]: line.split()[1:] for line in shown if line.startswith("elvis ") and "rings.py" in line}
    assert {"render", "probe", "norms", "info"} <= set(shown)
    rows = run([*ELVIS, *_arguments(shown["probe"])], cwd=folder).stdout.splitlines()
    assert rows[0] == "point,x,y,z,element,status,sqrt(p^2 + x)"
    table = np.array([[float(number) for number in row.split(",")] for row in rows[1:]])
    assert table.shape == (5, 7)
    wanted = np.sqrt(truth(table[:, 1:4]) ** 2 + table[:, 1])
    assert np.abs(table[:, 6] - wanted).max() < 1e-13 * 4

    found = json.loads(run([*ELVIS, *shown["norms"], "--json"], cwd=folder).stdout)
    assert list(found) == ["x", "y", "z", "p"]
    assert abs(found["x"]["L2"] - np.sqrt(np.pi * 15 / 4)) < 1e-12 * 4
    assert abs(found["z"]["L2"] - np.sqrt(np.pi)) < 1e-12 * 4
    facts = json.loads(run([*ELVIS, *shown["info"], "--json"], cwd=folder).stdout)
    assert (facts["plugin"], facts["time"], sum(facts["elements"].values())) == ("Rings", 0.5, 6)
    assert facts["jacobian"]["minimum"] > 0


def _arguments(words):
    """The words of a command line, those in quotes together."""
    return shlex.split(" ".join(words))


@pytest.mark.thorough
def test_kernels_and_the_reference_draw_the_same_faces(folder, renderer):
    ((name, plugin),) = plugin_named(str(folder / "rings.py")).items()
    opened = PluginData(name, plugin([folder / "case.npz"]))
    drawing, scene = renderer("vulkan"), Scene("p", objects=(Faces(),), camera="iso", size=(80, 60))
    drawing.show(opened.volume("p"))
    drawn = drawing.render(scene)
    wanted = render_reference(opened, replace(scene, camera=drawn.view.camera))
    assert np.array_equal(drawn.element, wanted.element)
    seen = drawn.seen
    assert seen.sum() > 1000
    assert np.abs(drawn.field[seen] - truth(drawn.position[seen])).max() < 1e-11 * 4
    assert np.abs(drawn.field[seen] - wanted.field[seen]).max() < 1e-11 * 4
    assert np.abs(drawn.position[seen] - wanted.position[seen]).max() < 1e-10 * 4
    x, y, z = drawn.position[seen].T
    off = np.min(np.abs([np.hypot(x, y) - 1, np.hypot(x, y) - 2, z, z - 1]), axis=0)
    assert off.max() < 1e-13


def test_an_author_writes_less_than_a_third_of_the_first_elvis_interface():
    text = (interface_folder() / "differentiated.slang").read_text(encoding="utf-8")
    basis = text[text.index("interface IBasis") :].split("\n}\n")[0]
    slang = re.findall(r"^    (?:static )?(?:double3? \w+|__init)\(", basis, re.M)
    assert len(slang) == 6
    assert (len(slang) + len(VolumeSource.__abstractmethods__) + 1) * 3 < 3 + 18 + 11


@pytest.mark.parametrize("device", ["vulkan", "cpu"])
def test_it_passes_the_test_kit(folder, renderer, device):
    ((name, plugin),) = plugin_named(str(folder / "rings.py")).items()
    assert name == "Rings"
    source = plugin([folder / "case.npz"])
    assert (tuple(source.fields), source.time) == (("p",), 0.5)
    check_volume(source.volume("p"), renderer(device))


def test_the_page_contains_exactly_the_code_of_the_plugin():
    assert set(section()) == {"slang", "python", "toml"}
