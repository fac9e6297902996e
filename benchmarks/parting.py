"""What several processes tell one another for one picture, for 2 to 64 of them: messages and bytes, counted here.

python benchmarks/parting.py [--cells 28] [--ranks 64]      one process that works in place of all

Each rank sends the elements of its part that a scene depends on to the first one, and that one sends all of them to
each (`elvis.renderer.parts`); ranges go the same way, and rows to the first one (`elvis.renderer.rank_rows`).  Sizes
are those of what is sent, pickled.
"""

from __future__ import annotations

import argparse
import pickle

from cases import FIELD, million
from measuring import once
from tables import Table, mebibytes, seconds

from elvis.core.dataset import Dataset
from elvis.core.portions import Portion, along_curve, unite
from elvis.renderer.parts import what_matters
from elvis.scene import CutSurface, Faces, Isosurface, Plane, Scene

SCENES = {
    "plane": Scene(FIELD, objects=(CutSurface(Plane((0.5, 0.45, 0.52), (0.3, 0.2, 1.0))),)),
    "outer faces": Scene(FIELD, objects=(Faces(("all",)),)),
    "isosurface": Scene(FIELD, objects=(Isosurface((1.0,)),)),
}
#: bytes of a pixel of a picture alone: three colours, a status
OF_PIXEL, PIXELS = 4, 1_000_000


def counted(dataset: Dataset, scene: Scene, count: int) -> list[str]:
    """A row of the table: a scene drawn by so many ranks."""
    whole = Portion.whole(dataset)
    parts = [whole.of(ids) for ids in along_curve(dataset, count)]
    works = [once(lambda part=part: what_matters(part, [scene])) for part in parts]
    found = [portion for portion, _ in works]
    sizes = [len(pickle.dumps(portion)) for portion in found]
    united, uniting = once(lambda: unite(found))
    elements = sum(map(len, united.dataset.mesh.elements.values()))
    rows = OF_PIXEL * PIXELS * (count - 1) // count
    return [
        str(count),
        f"{elements:,}",
        mebibytes(sum(sizes[1:])),
        mebibytes((count - 1) * sum(sizes)),
        mebibytes(rows),
        str(5 * (count - 1)),
        seconds(max(timing.effort for _, timing in works)),
        seconds(uniting.effort),
    ]


def main() -> None:
    """Print a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=28, help="along each side of a cube, six tetrahedra each (28)")
    parser.add_argument("--ranks", type=int, default=64, help="the most processes (64)")
    asked = parser.parse_args()
    case = million(cells=asked.cells)
    dataset = case.dataset()
    columns = [
        "ranks",
        "elements",
        "to the first, MiB",
        "from it, MiB",
        "rows, MiB",
        "messages",
        "to find, CPU s",
        "to unite",
    ]
    for name, scene in SCENES.items():
        table = Table(f"{name}, {case.label}", columns)
        count = 1
        while count <= asked.ranks:
            table.rows.append(counted(dataset, scene, count))
            count *= 2
        print(table.text(), flush=True)


if __name__ == "__main__":
    main()
