import pytest

from elvis.plugins.command import registry
from elvis.plugins.command.registry import PluginError


@pytest.fixture(autouse=True)
def _installed(miniature):
    pass


def test_a_plugin_of_another_distribution_is_found_and_loaded():
    assert registry.load("elvis.volumes", "wavelets") == "text"
    assert registry.plugins("elvis.volumes")["wavelets"].distribution == "miniature 1.2"


def test_names_are_sorted():
    names = list(registry.plugins("elvis.commands"))
    assert names == sorted(names)


def test_plugins_are_imported_on_request():
    import sys

    registry.plugins("elvis.commands")
    assert "miniature" not in sys.modules


def test_broken_plugins_do_not_affect_others():
    found = registry.plugins("elvis.commands")
    assert {"absent", "raises", "hello"} <= set(found)
    assert found["hello"].load().name == "hello"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("raises", "RuntimeError: the licence of raises has expired"),
        ("absent", "ModuleNotFoundError: No module named 'no_such_module_anywhere'"),
    ],
)
def test_a_broken_plugin_is_named_with_the_reason(name, reason):
    with pytest.raises(PluginError) as failure:
        registry.load("elvis.commands", name)
    assert f"'{name}'" in str(failure.value)
    assert "miniature 1.2" in str(failure.value)
    assert reason in str(failure.value)


def test_an_unknown_plugin_is_reported_with_the_known_ones():
    with pytest.raises(PluginError, match=r"no elvis\.volumes plugin 'splines'; there are: .*wavelets"):
        registry.load("elvis.volumes", "splines")


def test_the_builtin_plugin_wins_and_the_other_is_listed():
    assert registry.plugins("elvis.commands")["plugins"].distribution.startswith("elvis-viz ")
    sharing = [p.distribution for p in registry.every_plugin("elvis.commands") if p.name == "plugins"]
    assert len(sharing) == 2
    assert sharing[1] == "miniature 1.2"


def test_plugins_installed_or_removed_meanwhile_are_detected(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    before = registry.plugins("elvis.volumes")
    assert registry.plugins("elvis.volumes") == before

    distribution = tmp_path / "late-3.dist-info"
    distribution.mkdir()
    (distribution / "METADATA").write_text("Metadata-Version: 2.1\nName: late\nVersion: 3\n")
    (distribution / "entry_points.txt").write_text("[elvis.volumes]\nlate = json:dumps\n")
    assert registry.plugins("elvis.volumes")["late"].distribution == "late 3"

    distribution.rename(tmp_path / "gone")
    assert registry.plugins("elvis.volumes") == before
