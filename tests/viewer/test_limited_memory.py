"""``elvis view --memory``: the process that draws reads bricks, and tells what it tells of the whole."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from elvis import Dataset, Shape, write
from elvis.core.base.errors import ElvisError
from elvis.core.portions.portion import Portion
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.formats.nektar.dataset_parts import DatasetParts
from elvis.renderer.parts.bricks import Bricks
from elvis.scene import Plane, Scene
from elvis.scene.model.tables import table_of
from elvis.viewer.drawing_process import _Drawing
from elvis.viewer.moments import source_of


@pytest.fixture
def limited(tmp_path):
    """A scene with a limit of memory, of curved hexahedra in files that are read by bricks."""
    bare = Dataset(curved(grid(Shape.HEXAHEDRON, 5), ripple(0.05), n=3))
    data = Dataset(bare.mesh, (approximated(bare, "u", lambda x: x[:, 0] * x[:, 1], 3),))
    files = write(data, tmp_path / "bent.xml", mesh_format="hdf5", field_format="hdf5")
    names = tuple(str(path) for path in files if path.suffix != ".nekg")
    memory = 3.0 * Portion.whole(data).bytes
    return Scene("u", plane=Plane((0.5, 0.5, 0.4), (0.0, 0.0, 1.0)), data=names, size=(64, 64), memory=memory)


def told(scene, source):
    """Facts, a picture and what is at its middle; the data."""
    drawing = _Drawing(source, SimpleNamespace(value=1))
    content = {"table": table_of(scene), "part": 1.0, "is_draft": False, "is_lean": False, "proof": False}
    try:
        facts = drawing.answer("facts", 1, None)
        _, file = drawing.answer("draw", 1, content)
        picked = drawing.answer("pick", 1, {"row": 32, "column": 32})
        return facts, file, picked, drawing
    finally:
        drawing._pictures.close()


@pytest.mark.own_devices
def test_bricks_report_the_same_as_the_whole(limited, monkeypatch):
    monkeypatch.setattr("elvis.renderer.parts.bricks.ELEMENTS", 3)
    known, of = [], DatasetParts.of
    monkeypatch.setattr(DatasetParts, "of", lambda own, chosen: known.append(chosen.mean()) or of(own, chosen))
    facts, file, picked, drawing = told(limited, source_of(limited))
    assert isinstance(drawing._data, Bricks)
    assert max(known) < 0.8
    whole_facts, whole_file, whole_picked, whole = told(
        replace(limited, memory=None), source_of(replace(limited, memory=None))
    )
    # a part has other numbers of elements than the whole
    assert whole_facts.pop("contents")["elements"] == {"hexahedron": 125}
    assert facts == whole_facts
    assert "u" in facts["quantities"]["fields"]
    assert {"h", "composite", "quality"} <= set(facts["quantities"]["mesh"])
    assert "nx" not in facts["quantities"]["mesh"]
    assert file == whole_file
    assert whole_picked.items() > picked.items()
    assert picked["status"] == "certain"

    assert drawing.answer("check", 2, "u*x") == ""
    ask = {"quantities": ["u"], "start": [0, 0, 0], "end": [1, 1, 1]}
    for name, content in (("line", ask), ("histogram", "u"), ("extrema", "u"), ("linear", {"level": 0})):
        assert whole.answer(name, 2, content)
        with pytest.raises(
            ElvisError, match="need all elements, which --memory does not allow: start elvis view without"
        ):
            drawing.answer(name, 2, content)
