"""The process that draws: it reads the data, keeps the device, and answers one request after the other.

It is a process of its own since drawing holds the interpreter, up to 0.3 s for a picture, while the server must answer.
Requests and answers go through a pipe as tuples (name, number, content); errors come back as sentences.
"""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from elvis.core.dataset import Dataset
    from elvis.plugins.opening import PluginData
    from elvis.scene import Scene
    from elvis.scene.frame import Frame

#: quality of pictures while something moves, of 100
JPEG_QUALITY = 85
#: colours of pixels by status, over the picture: ambiguous, failed
PROOF_COLORS = {2: (255, 0, 200), 3: (255, 60, 0)}
#: points of a line plot
LINE_POINTS = 401
Table = dict[str, Any]


@dataclass(frozen=True)
class Source:
    """What is looked at: files and how they become data, or data at hand, which the process gets a copy of.

    device  as of ``elvis render``
    """

    files: tuple[str, ...] = ()
    data: Dataset | PluginData | None = None
    plugin: str | None = None
    reader: tuple[str, ...] = ()
    is_kept: bool = True
    device: str = "auto"


def run(pipe: Connection, newest: Any, source: Source) -> None:
    """Serve requests until the pipe closes.

    newest  a shared number: a request for a picture of a smaller one is obsolete, and left
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server ends this process
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        _serve(pipe, newest, source)


def _serve(pipe: Connection, newest: Any, source: Source) -> None:
    from elvis.core.errors import ElvisError

    drawing: _Drawing | None = None
    while True:
        name, number, content = pipe.recv()
        try:
            drawing = drawing or _Drawing(source, newest)
            answer = drawing.answer(name, number, content)
        except ElvisError as error:
            pipe.send((_failure(error), number, str(error)))
        except MemoryError:
            pipe.send(("error", number, "there is not enough memory for this picture"))
        else:
            pipe.send((name, number, answer))


def _failure(error: Exception) -> str:
    from elvis.scene.time_limit import ObsoleteError

    return "obsolete" if isinstance(error, ObsoleteError) else "error"


class _Drawing:
    """Data, pictures of them, and the last one."""

    def __init__(self, source: Source, newest: Any) -> None:
        from elvis.plugins.data import Reading, open_data, pairs
        from elvis.renderer.rendering import Pictures

        reading = Reading(source.plugin, pairs(source.reader), source.is_kept)
        self._data = source.data if source.data is not None else open_data(tuple(map(Path, source.files)), reading)
        self._pictures = Pictures(self._data, source.device)
        self._newest = newest
        self._frame: Frame | None = None
        self._answers: dict[str, Callable[[int, Any], Any]] = {
            "facts": self._facts,
            "draw": self._draw,
            "pick": self._pick,
            "line": self._line,
            "check": self._check,
            "save": self._save,
        }

    def answer(self, name: str, number: int, content: Any) -> Any:
        """The answer to a request; ElvisError where there is none."""
        return self._answers[name](number, content)

    def _facts(self, _: int, __: Any) -> Table:
        """What the page offers: quantities, boundaries, the box around the data."""
        import numpy as np

        from elvis.core.dataset import Dataset
        from elvis.core.distances.boundaries import boundaries
        from elvis.core.picturing import Kind
        from elvis.core.quantities import Names
        from elvis.plugins.serving import names_of

        names: Names = names_of(self._data)
        facts: Table = {
            "fields": list(names.fields),
            "quantities": [*names.fields, *names.flow.available, *"xyz"[: names.dimension]],
            "boundaries": [],
            "kind": "solid",
            "box": None,
        }
        if isinstance(self._data, Dataset):
            mesh = self._data.mesh
            facts["kind"] = Kind.of(self._data).name.lower()
            facts["boundaries"] = list(boundaries(mesh))
            points = np.concatenate([mesh.vertices, mesh.edge_curves.points, mesh.face_curves.points])
            facts["box"] = [points.min(axis=0).tolist(), points.max(axis=0).tolist()]
            facts["remarks"] = list(self._data.remarks)
        return facts

    def _draw(self, number: int, content: Table) -> tuple[Table, bytes]:
        """A picture: facts about it, and its file.

        content  the scene's ``table``; ``part`` of the full size each way; ``proof`` shows what is not certain
        """
        from elvis.scene.tables import scene_of
        from elvis.scene.time_limit import stopped_when

        start = perf_counter()
        scene = scene_of(content["table"])
        is_final = content["part"] == 1.0 and not content["is_moving"]
        if content["is_moving"]:
            scene = _while_moving(scene, content["part"])
        with stopped_when(lambda: self._newest.value > number):
            frame = self._pictures.draw(scene)
        drawn = perf_counter()
        if is_final:
            self._frame = frame
        file, corner, size = _lossless(frame) if is_final else _lossy(frame)
        if content["proof"]:
            file = _with_proof(file, frame, corner)
        facts = _facts_of(frame, corner, size)
        facts["seconds"] = {"draw": drawn - start, "encode": perf_counter() - drawn}
        return {**facts, "final": is_final}, file

    def _pick(self, _: int, content: Table) -> Table:
        """What the last picture shows at a column and row of its pixels."""
        from elvis.core.errors import ElvisError
        from elvis.scene.frame import Status

        frame = self._frame
        if frame is None:
            raise ElvisError("there is no picture yet")
        row, column = int(content["row"]), int(content["column"])
        height, width = frame.element.shape
        if not (0 <= row < height and 0 <= column < width):
            raise ElvisError("this lies outside of the picture")
        status = Status(int(frame.status[row, column])).name.lower()
        if not frame.seen[row, column]:
            return {"status": status, "element": -1}
        position = [float(value) for value in frame.position[row, column]]
        return {
            "status": status,
            "element": int(frame.element[row, column]),
            "field": frame.scene.field,
            "value": _number(float(frame.field[row, column])),
            "position": position,
            **self._known_of(position),
        }

    def _known_of(self, position: list[float]) -> Table:
        """Order and Jacobian determinant of the element at a point, where the data tell."""
        import numpy as np

        from elvis.core.errors import ElvisError

        sampler = self._element_sampler
        if sampler is None:
            return {}
        with suppress(ElvisError):
            found = sampler.sample(np.array([position]))
            return {name: _number(float(found[name][0])) for name in ("order", "jacobian")}
        return {}

    @cached_property
    def _element_sampler(self) -> Any:
        """What finds elements and tells of them, made once; None for the data of runtime plugins."""
        from elvis.core.dataset import Dataset
        from elvis.core.quantities import Expression, evaluator
        from elvis.plugins.serving import names_of

        if not isinstance(self._data, Dataset):
            return None
        names = names_of(self._data)
        return evaluator.Sampler(self._data, [Expression.parse(text, names) for text in ("order", "jacobian")])

    def _line(self, _: int, content: Table) -> Table:
        """Exact values of quantities at points from one place to another."""
        from elvis.core.dataset import Dataset
        from elvis.core.errors import ElvisError
        from elvis.core.sampling import line

        if not isinstance(self._data, Dataset):
            raise ElvisError("lines of values need a dataset; a runtime plugin's data have pictures alone")
        samples = line(self._data, content["quantities"], content["start"], content["end"], LINE_POINTS)
        return {
            "names": list(samples.names),
            "points": samples.points.tolist(),
            "values": [[_number(value) for value in row] for row in samples.values.T.tolist()],
            "elements": samples.location.element_id.tolist(),
        }

    def _check(self, _: int, text: str) -> str:
        """Nothing; ElvisError where a text names no quantity."""
        from elvis.core.quantities import Expression
        from elvis.plugins.serving import names_of

        Expression.parse(text, names_of(self._data))
        return ""

    def _save(self, _: int, content: Table) -> bytes:
        """The file of a scene: a picture or a record, as ``elvis render`` writes it."""
        from elvis.scene.tables import scene_of

        suffix = content["suffix"]
        scene = replace(scene_of(content["table"]), outputs=(f"picture{suffix}",))
        frame = self._pictures.draw(scene)
        return _file(frame, suffix)


def _while_moving(scene: Scene, part: float) -> Scene:
    """The scene with fewer pixels and one sample for each."""
    assert scene.size is not None
    width, height = (max(16, round(part * side)) for side in scene.size)
    return replace(scene, size=(width, height), samples=1)


def _file(frame: Frame, suffix: str) -> bytes:
    """What `save` writes."""
    with tempfile.TemporaryDirectory(prefix="elvis-") as folder:
        path = Path(folder, f"picture{suffix}")
        frame.save(path, plain=frame.scene.plain)
        return path.read_bytes()


def _lossless(frame: Frame) -> tuple[bytes, tuple[int, int], tuple[int, int]]:
    """The PNG file that ``elvis render`` writes, where the image begins on it, and its size.

    A figure's layout is matplotlib's: its image is taken to fill the page.
    """
    from elvis.scene.figure import needs_figure
    from elvis.scene.picture import page

    file = _file(frame, ".png")
    if needs_figure(frame, ".png"):
        width, height = _size_of(file)
        return file, (0, 0), (width, height)
    own = page(frame, plain=frame.scene.plain or frame.scene.is_clear)
    return file, own.corner, (own.width, own.height)


def _lossy(frame: Frame) -> tuple[bytes, tuple[int, int], tuple[int, int]]:
    """The image alone as JPEG."""
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(frame.rgb, "RGB").save(stream, "JPEG", quality=JPEG_QUALITY)
    height, width = frame.element.shape
    return stream.getvalue(), (0, 0), (width, height)


def _size_of(file: bytes) -> tuple[int, int]:
    """Width and height of a picture in a file."""
    from PIL import Image

    with Image.open(BytesIO(file)) as image:
        return image.size


def _with_proof(file: bytes, frame: Frame, corner: tuple[int, int]) -> bytes:
    """The picture in grey, with what is not certain in colours."""
    import numpy as np
    from PIL import Image

    with Image.open(BytesIO(file)) as image:
        grey = np.asarray(image.convert("L").convert("RGB")).copy()
    status = frame.line_status
    rows = slice(corner[1], corner[1] + status.shape[0])
    columns = slice(corner[0], corner[0] + status.shape[1])
    part: NDArray[np.uint8] = grey[rows, columns]
    for value, color in PROOF_COLORS.items():
        part[status[: part.shape[0], : part.shape[1]] == value] = color
    stream = BytesIO()
    Image.fromarray(grey, "RGB").save(stream, "PNG")
    return stream.getvalue()


def _facts_of(frame: Frame, corner: tuple[int, int], size: tuple[int, int]) -> Table:
    """What the page knows of a picture: its camera, where the image lies in it, counts, ranges, remarks."""
    from elvis.scene.tables import table_of

    height, width = frame.element.shape
    legends = [legend for legend in frame.legends if legend.palette is not None]
    return {
        "camera": table_of(frame.view.camera),
        "image": [*corner, width, height],
        "size": list(size),
        "counts": frame.counts(),
        "remarks": list(frame.remarks),
        "ranges": {own.title: [own.palette.low, own.palette.high] for own in legends if own.palette},
        "field": frame.scene.field,
    }


def _number(value: float) -> float | None:
    """The number, None for what JSON has no word for."""
    return value if abs(value) < float("inf") else None


def spawn(source: Source) -> tuple[Any, Connection, Any]:
    """The process, its pipe and the number of the newest request."""
    from multiprocessing import get_context

    context = get_context("spawn")
    here, there = context.Pipe()
    newest = context.Value("Q", 0, lock=False)
    process = context.Process(target=run, args=(there, newest, source), daemon=True, name="elvis-drawing")
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    process.start()
    there.close()
    return process, here, newest
