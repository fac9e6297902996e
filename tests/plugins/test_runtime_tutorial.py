"""The tutorial of plugins/README.md, word for word: tried from its folder, and installed as a distribution."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elvis.plugins.opening import named
from elvis.plugins.testing import check_volume

PAGE = Path(__file__).resolve().parents[2] / "plugins" / "README.md"
SECTORS = np.array([[1, 2, a, a + np.pi / 3, 0, 1] for a in np.arange(6) * np.pi / 3])
ELVIS = [sys.executable, "-c", "from elvis.plugins.command import main; main()"]


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
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, **options)
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


@pytest.mark.parametrize("device", ["vulkan", "cpu"])
def test_it_keeps_what_the_kit_asks(folder, renderer, device):
    ((name, plugin),) = named(str(folder / "rings.py")).items()
    assert name == "Rings"
    source = plugin([folder / "case.npz"])
    assert (tuple(source.fields), source.time) == (("p",), 0.5)
    check_volume(source.volume("p"), renderer(device))


def test_the_page_has_what_a_plugin_needs_and_nothing_else():
    assert set(section()) == {"slang", "python", "toml"}
