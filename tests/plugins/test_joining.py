"""Expressions of several fields of a plugin: its module stands once for each, with globals of its own."""

import re
from pathlib import Path

import numpy as np
import pytest

from elvis.plugins.runtime.joining import join_fields
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import volume_of
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import PartsVolume, basis_part, boxes_between

#: names that begin with the name of a global are other names
MODULE = """module scaled;
import differentiated;
public {declared} corners;
public {declared} scales;
static const double scales_all = 2.0lf;
public struct Cube : IBasis
{{
    uint element;
    public __init(uint element) {{ this.element = element; }}
    [ForwardDifferentiable]
    public double3 world(double3 r) {{ return r + double3(corners[element], 0.0lf, 0.0lf); }}
    [ForwardDifferentiable]
    public double value(double3 r) {{ return scales_all * scales[element] * r.x; }}
    public static double margin(double3 r) {{ return min(min3(r), min3(1.0lf - r)); }}
    public static double3 center() {{ return 0.5lf; }}
    public static double3 nearest(double3 r) {{ return clamp(r, 0.0lf, 1.0lf); }}
    static double min3(double3 r) {{ return min(r.x, min(r.y, r.z)); }}
}}
"""
SCALES = {"a": np.array([1.0, 2.0, 3.0]), "b": np.array([5.0, 7.0, 11.0]), "c": np.array([-13.0, 17.0, 19.0])}
DECLARED = ("StructuredBuffer<double>", "uniform double*")


class Scaled(VolumeSource):
    """Three unit cubes in a row, with fields that grow along x in each by a number of its own."""

    fields = tuple(SCALES)
    folder = Path()

    @classmethod
    def opens(cls, paths):
        return False

    def __init__(self, paths):
        pass

    def volume(self, field):
        low = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
        buffers = {"corners": low[:, 0], "scales": SCALES[field]}
        return PartsVolume([basis_part("scaled", "Cube", boxes_between(low, low + 1), buffers)], self.folder)


@pytest.fixture
def scaled(tmp_path):
    """The plugin's data, its globals declared in one of the ways that there are."""

    def make(declared):
        (tmp_path / "scaled.slang").write_text(MODULE.format(declared=declared))
        return PluginData("scaled", type("Own", (Scaled,), {"folder": tmp_path})([]))

    return make


@pytest.mark.parametrize("declared", DECLARED)
def test_only_whole_names_of_declared_globals_change(scaled, tmp_path, declared):
    source = scaled(declared).source
    parts = [source.volume(name).parts[0] for name in "ab"]
    _, text, buffers = join_fields(parts, tmp_path)
    assert buffers.keys() == {"corners_of_0", "corners_of_1", "scales_of_0", "scales_of_1", "element_boxes"}
    assert [buffers[f"scales_of_{m}"].tolist() for m in (0, 1)] == [SCALES[name].tolist() for name in "ab"]
    assert not re.search(r"\b(?:corners|scales)\b", text)
    for m in (0, 1):
        own = text.partition(f"namespace field{m}")[2].partition("\nnamespace ")[0].partition("\nstruct Joined")[0]
        assert set(re.findall(r"\w+_of_\d", own)) == {f"corners_of_{m}", f"scales_of_{m}"}
        assert "scales_all * scales_of" in own


@pytest.mark.sampled
@pytest.mark.parametrize("device", ["vulkan", "cpu"])
@pytest.mark.parametrize("declared", DECLARED)
def test_each_field_has_separate_globals(scaled, renderer, device, declared):
    text = "a + 100*b - 10*c"
    drawing = renderer(device)
    drawing.show(volume_of(scaled(declared), ["a", text]))
    elements = np.repeat(np.arange(3), 20)
    points = np.random.default_rng(1).uniform(-1, 1, (60, 3))
    found = drawing.sample_elements(0, elements, points, text)
    wanted = 2 * (SCALES["a"] + 100 * SCALES["b"] - 10 * SCALES["c"])[elements] * (found.position[:, 0] - elements)
    assert np.abs(found.value - wanted).max() < 1e-11 * np.abs(wanted).max()
