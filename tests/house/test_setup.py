"""The set-up script for Vulkan, in a tree where every command that it calls is a stand-in."""

import os
import shutil
import subprocess

import pytest

MIRROR = "http://mirror.example/debian/"
INSTALL = "install -y --no-install-recommends {}mesa-vulkan-drivers libvulkan1 libx11-6 libatomic1"


@pytest.fixture
def machine(root, tmp_path):
    """Run the script on a machine of that release; answers what it said and the calls of apt-get."""
    commands, calls = tmp_path / "bin", tmp_path / "calls"
    for folder in (commands, tmp_path / "tools", tmp_path / ".venv" / "bin"):
        folder.mkdir(parents=True)
    shutil.copy(root / "tools" / "vulkan.sh", tmp_path / "tools")

    def command(path, body):
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(0o755)

    def run(codename, user, apt="exit 0", targets="", works="false"):
        (tmp_path / "os-release").write_text(f"VERSION_CODENAME={codename}\n")
        command(tmp_path / ".venv" / "bin" / "python", f"if {works}; then echo llvmpipe; else exit 1; fi")
        command(commands / "id", f"echo {user}")
        answer = f'if [ "$1" = indextargets ]; then printf "{codename} {MIRROR}\\n{targets}"; exit; fi'
        command(commands / "apt-get", f'{answer}\necho "$*" >>{calls}\n{apt}')
        path = f"{commands}:{os.environ['PATH']}"
        environ = os.environ | {"PATH": path, "OS_RELEASE": str(tmp_path / "os-release")}
        process = subprocess.run(
            ["sh", tmp_path / "tools" / "vulkan.sh"], env=environ, capture_output=True, text=True, check=True
        )
        return process.stderr, calls.read_text().splitlines() if calls.exists() else []

    run.calls = calls
    return run


def test_a_working_driver_is_unchanged(machine):
    said, calls = machine("bookworm", user=0, works="true")
    assert said == "setup: Vulkan device: llvmpipe\n"
    assert calls == []


@pytest.mark.parametrize("codename", ["trixie", "noble"])
def test_root_gets_the_ordinary_driver(machine, codename):
    said, calls = machine(codename, user=0, works=f"[ -e {machine.calls} ]")
    assert calls == ["update", INSTALL.format("")]
    assert said.endswith("setup: Vulkan device: llvmpipe\n")


def test_debian_12_takes_the_driver_of_its_backports(machine):
    _, calls = machine("bookworm", user=0, targets=f"bookworm-backports {MIRROR}\\n")
    assert calls == ["update", INSTALL.format("-t bookworm-backports ")]


def test_without_root_the_command_is_printed(machine):
    said, calls = machine("bookworm", user=1000)
    entry = f"echo 'deb {MIRROR} bookworm-backports main' >/etc/apt/sources.list.d/bookworm-backports.list"
    install = INSTALL.format("-t bookworm-backports ")
    assert f'sudo sh -c "{entry} && apt-get update && apt-get {install}"' in said
    assert calls == []


def test_a_failure_is_reported_and_setup_continues(machine):
    said, calls = machine("noble", user=0, apt='echo "E: Could not get lock" >&2; exit 100')
    assert calls == ["update"]
    assert "E: Could not get lock" in said
    assert "make setup" in said
