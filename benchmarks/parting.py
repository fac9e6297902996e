"""What several processes tell one another for one picture, for 2 to 64 of them: messages and bytes, counted here.

python benchmarks/parting.py [--cells 28] [--ranks 2,8,64]      one process that works in place of all

Each rank finds the elements of its part that a scene depends on (`elvis.renderer.parts.parts`); those that decide go by
way of the first one to all, those of a band of rows to the rank that draws it (`elvis.renderer.frame.rank_pictures`).
Sizes are those of messages.  The camera is given: each small picture that finds one sends about as much again.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from time import thread_time

from cases import FIELD, million
from tables import Table, mebibytes, seconds

from elvis.core.data.dataset import Dataset
from elvis.core.portions import Portion, along_curve
from elvis.core.testing.played_ranks import PlayedRanks, played
from elvis.renderer.asking.completing import completed
from elvis.renderer.frame.rank_pictures import RankPicture
from elvis.renderer.parts.parts import RankPart, what_matters
from elvis.scene import Camera, CutSurface, Faces, Isosurface, Plane, Scene, Transfer, VolumeRendering

CAMERA = Camera((2.5, -1.5, 2.0), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.8)
OBJECTS = {
    "plane": CutSurface(Plane((0.5, 0.45, 0.52), (0.3, 0.2, 1.0))),
    "outer faces": Faces(("all",)),
    "isosurface": Isosurface((1.0,)),
    "volume": VolumeRendering(Transfer((0.0, 1.0), (0.0, 3.0))),
}
#: bytes of a pixel of a picture alone: three colours, a status
OF_PIXEL, SIZE = 4, (1000, 1000)


@dataclass(frozen=True)
class Told:
    """What one rank has sent and got.

    elements  that it draws of
    finding, dealing  processor seconds: for those that matter of its part, and for those of its rows
    """

    sent: list[int]
    messages: int
    elements: int
    finding: float
    dealing: float


def counted(dataset: Dataset, scene: Scene, count: int) -> list[str]:
    """A row of the table: a scene drawn by so many ranks."""
    whole = Portion.whole(dataset)
    parts = [whole.of(ids) for ids in along_curve(dataset, count)]

    def work(ranks: PlayedRanks) -> Told:
        start = thread_time()
        own, parts[ranks.rank] = what_matters(parts[ranks.rank], [scene]), None
        found = thread_time()
        part = RankPart(own, ranks, {}, dataset.mesh.corners)
        drawn, _ = RankPicture(part, completed(dataset, scene), _never).elements()
        elements = sum(map(len, drawn.mesh.elements.values()))
        return Told(ranks.sent, ranks.messages, elements, found - start, thread_time() - found)

    every = played(count, work)
    received = [sum(told.sent[rank] for told in every) for rank in range(count)]
    return [
        str(count),
        f"{min(told.elements for told in every):,} to {max(told.elements for told in every):,}",
        mebibytes(received[0]),
        mebibytes(sum(every[0].sent)),
        mebibytes(max(sum(told.sent) for told in every[1:])) if count > 1 else "",
        mebibytes(max(received[1:])) if count > 1 else "",
        mebibytes(OF_PIXEL * SIZE[0] * SIZE[1] * (count - 1) // count),
        str(sum(told.messages for told in every)),
        seconds(max(told.finding for told in every)),
        seconds(max(told.dealing for told in every)),
    ]


def _never(*_: object) -> None:
    """No small picture is drawn, as the camera is given."""
    raise AssertionError


def main() -> None:
    """Print a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=28, help="along each side of a cube, six tetrahedra each (28)")
    parser.add_argument("--ranks", default="1,2,8,32,64", help="numbers of processes, with commas between (1 to 64)")
    parser.add_argument("--scenes", default=",".join(OBJECTS), help="some of them, with commas between (all)")
    asked = parser.parse_args()
    case = million(cells=asked.cells)
    dataset = case.dataset()
    columns = [
        "ranks",
        "elements of a rank",
        "to the first, MiB",
        "from it, MiB",
        "from another, MiB",
        "to another, MiB",
        "rows, MiB",
        "messages",
        "to find, CPU s",
        "to send, CPU s",
    ]
    for name in asked.scenes.split(","):
        scene = Scene(FIELD, objects=(OBJECTS[name],), camera=CAMERA, size=SIZE)
        table = Table(f"{name}, {case.label}", columns)
        table.rows += [counted(dataset, scene, int(count)) for count in asked.ranks.split(",")]
        print(table.text(), flush=True)


if __name__ == "__main__":
    main()
