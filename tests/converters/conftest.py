from pathlib import Path

import numpy as np
import pytest

from elvis.core.shapes import Shape
from elvis.plugins.conversion.discovery import Candidate
from elvis.plugins.conversion.plugin import Converter, Elements, SourceField
from elvis.plugins.testing import positions_at, values_at, values_found

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers"


@pytest.fixture(scope="session")
def solvers():
    """The folder of solvers' own files, which lies next to the repository."""
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    return DATA


@pytest.fixture(scope="session")
def findings():
    """The folder of unusual and damaged files, which lies there too."""
    folder = DATA.parent / "findings"
    if not folder.is_dir():
        pytest.skip(f"there is no {folder}")
    return folder


class Truth:
    """The solver's own evaluation at points: by element and reference point, and by place."""

    def __init__(self, path):
        with np.load(path) as file:
            self.data = {name: file[name] for name in file.files}
        self.xyz, self.elem, self.ref, self.shape = (self.data[name] for name in ("xyz", "elem", "ref", "shape"))

    def column(self, name, index=0):
        """(n,) one component of the field ``f_name``."""
        return self.data[f"f_{name}"].reshape(len(self.xyz), -1)[:, index]

    def at(self, conversion, field, blocks, places=lambda block, ref: ref):
        """(n,) converted values by element: ``blocks`` maps a shape's name to the number of the source's block.

        places  from a block's number and reference points (n, d) of the truth to points as the converter takes them
        """
        return self._each(blocks, lambda *where: values_at(conversion, field, *where), places, ())

    def positions_at(self, conversion, blocks, places=lambda block, ref: ref):
        """(n, 3) converted coordinates by element, likewise."""
        return self._each(blocks, lambda *where: positions_at(conversion, *where), places, (3,))

    def _each(self, blocks, evaluate, places, tail):
        found = np.full((len(self.xyz), *tail), np.nan)
        for name in np.unique(self.shape):
            here = np.flatnonzero(self.shape == name)
            block = blocks[str(name)]
            found[here] = evaluate(block, self.elem[here], places(block, self.ref[here]))
        return found

    def found(self, dataset, field):
        """(n,) converted values by place."""
        return values_found(dataset, field, self.xyz)


@pytest.fixture
def truth():
    """``truth(path)`` opens a truth file."""
    return Truth


@pytest.fixture
def near():
    """``near(found, wanted, tolerance)``: whether values agree to ``tolerance`` of the range of the wanted ones."""

    def compare(found, wanted, tolerance=1e-10):
        spread = np.ptp(wanted) or np.abs(wanted).max()
        assert np.abs(found - wanted).max() <= tolerance * spread
        return True

    return compare


@pytest.fixture(scope="module")
def ngsolve():
    return pytest.importorskip("ngsolve")


@pytest.fixture(scope="module")
def disk(ngsolve):
    """NGSolve's mesh of the unit disk, curved of order 4."""
    occ = pytest.importorskip("netgen.occ")
    face = occ.WorkPlane().Circle(0, 0, 1).Face()
    face.edges.name = "rim"
    mesh = ngsolve.Mesh(occ.OCCGeometry(face, dim=2).GenerateMesh(maxh=0.5))
    mesh.Curve(4)
    return mesh


class Moving(Converter):
    """A square whose right side may move; a field of its time."""

    format = "squares"

    @classmethod
    def opens(cls, paths):
        return len(paths) == 1

    def __init__(self, paths):
        self.width, self.time = map(float, paths[0].read_text().split())
        self.blocks = [Elements(Shape.QUADRILATERAL, 1)]
        self.fields = [SourceField("u", 1)]

    def positions(self, block, points):
        return ((1 + points) / 2 * [self.width, 1.0])[None]

    def sample(self, block, field, points):
        return np.full((1, len(points)), self.time)


@pytest.fixture
def squares(tmp_path, monkeypatch):
    """Write three steps of squares, which move or stand still, at times 0, 0.25 and 0.5; the pattern of their names."""
    for name in ("series.finding", "data.data"):
        monkeypatch.setattr(f"elvis.plugins.{name}.installed_converters", lambda: [Candidate("squares", Moving)])

    def written(moves):
        for number in range(3):
            (tmp_path / f"s{number}.square").write_text(f"{1 + moves * number} {number / 4}")
        return tmp_path / "s*.square"

    return written
