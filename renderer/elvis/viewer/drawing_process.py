"""The process that draws: it reads the data, keeps the device, and answers requests.

It is a process of its own since drawing holds the interpreter, up to 0.3 s for a picture, while the server must answer.
Requests and answers go through pipes as tuples (name, number, content); errors come back as sentences.  The main thread
serves the first pipe: pictures, and whatever changes the data.  Each of the other pipes has a thread for `QUESTIONS`,
which only read the data, so that a long picture or a long question of one page doesn't delay the answers to others.
"""

from __future__ import annotations

import os
import signal
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from multiprocessing.connection import Connection
from threading import Lock, Thread
from time import perf_counter
from typing import TYPE_CHECKING, Any

from elvis.scene.model.permissions import HTML
from elvis.viewer.encoding import bare, file_of, lossless, png, with_proof
from elvis.viewer.other_pictures import OtherPictures
from elvis.viewer.picture_facts import facts_of

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.core.distances.boundaries import Bodies
    from elvis.plugins.data.data import Opening, Reading
    from elvis.plugins.runtime.opening import PluginData
    from elvis.renderer.asking.deformed_data import DeformedData
    from elvis.renderer.parts.bricks import Bricks
    from elvis.scene.model.whole import Scene
    from elvis.scene.record.frame import Frame

#: cuts of each linear element, at most
MOST_CUTS = 5
#: points of a line plot
LINE_POINTS = 401
#: requests that only read the data and the last picture; without those that take arrays of the size of a picture
QUESTIONS = frozenset(("pick", "line", "section", "check", "histogram", "extrema", "history", "series range"))
#: questions that are answered at the same time, at most
QUESTION_THREADS = 4
Table = dict[str, Any]


@dataclass(frozen=True)
class Source:
    """Source of the data: files, or data in memory, of which the process gets a copy.

    reading  options for reading the files, None for the defaults
    device   as of ``elvis render``
    is_live  whether the files belong to a running solver, whose newest step is shown
    opening  function that opens the files of one state, None for `elvis.plugins.data.data.open_data`
    """

    files: tuple[str, ...] = ()
    data: Dataset | PluginData | None = None
    reading: Reading | None = None
    device: str = "auto"
    is_live: bool = False
    opening: Opening[Dataset | PluginData | Bricks] | None = None


@dataclass(frozen=True)
class Process:
    """The process, as the server has it.

    pipes   the first one for the source and for pictures, the others for questions
    newest  the shared number of the newest request for a picture
    """

    own: Any
    pipes: tuple[Connection, ...]
    newest: Any


def run(pipes: tuple[Connection, ...], newest: Any) -> None:
    """Get ready, take the source from the first pipe, and serve requests until the pipes close.

    newest  a shared number: a request for a picture of a smaller one is obsolete, and left
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server ends this process
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        _import_ahead()
        opened = _OpenedOnce(pipes[0].recv(), newest)
        for pipe in pipes[1:]:
            Thread(target=_serve, args=(pipe, opened), daemon=True).start()
        _serve(pipes[0], opened)


def _import_ahead() -> None:
    """Import the modules of every picture while the server still processes the command."""
    import elvis.plugins.data.data
    import elvis.renderer.frame.rendering
    import elvis.scene.figure.saving  # noqa: F401
    from elvis.renderer.device.kernels.elsewhere import compile_elsewhere

    # questions are answered while kernels are compiled
    compile_elsewhere()


class _OpenedOnce:
    """The data of a source, opened by the first request that needs them."""

    def __init__(self, source: Source, newest: Any) -> None:
        self._source, self._newest = source, newest
        self._lock = Lock()
        self._drawing: _Drawing | None = None

    def drawing(self) -> _Drawing:
        """The data; ElvisError if they can't be opened, and the next request tries again."""
        with self._lock:
            if self._drawing is None:
                self._drawing = _Drawing(self._source, self._newest)
            return self._drawing


def _serve(pipe: Connection, opened: _OpenedOnce) -> None:
    """Answer the requests of a pipe until it closes."""
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            pipe.send(_answered(opened, *pipe.recv()))


def _answered(opened: _OpenedOnce, name: str, number: int, content: Any) -> tuple[str, int, Any]:
    """The answer to a request, or the reason why there is none."""
    from elvis.core.base.errors import fault_sentence

    try:
        return name, number, opened.drawing().answer(name, number, content)
    except MemoryError:
        return "error", number, "not enough memory for this picture; reduce its size or its samples"
    except Exception as error:  # noqa: BLE001 - a fault of one picture must not end all
        return _failure(error), number, fault_sentence(error)


def _failure(error: Exception) -> str:
    from elvis.scene.model.errors import AbsentError
    from elvis.scene.model.time_limit import ObsoleteError

    if isinstance(error, AbsentError):
        return "absent"
    return "obsolete" if isinstance(error, ObsoleteError) else "error"


class _Drawing:
    """Data, pictures of them, and the last one."""

    def __init__(self, source: Source, newest: Any) -> None:
        from elvis.renderer.frame.rendering import Pictures
        from elvis.viewer.moments import Moments

        self._moments = Moments(source)
        self._data = self._moments.data
        self._pictures = Pictures(self._data, source.device)
        self._newest = newest
        self._states: DeformedData | None = None
        #: the last whole picture, and the number of its request
        self._whole: tuple[Frame, int] | None = None
        #: the last picture of any quality, and whether it is a draft
        self._last: tuple[Frame, bool] | None = None
        self._other_pictures = OtherPictures(source.device)
        #: answers about the current data: threads take this table before they look at the data
        self._known: Table = {}
        self._answers: dict[str, Callable[[int, Any], Any]] = {
            "facts": self._facts,
            "draw": self._draw,
            "try": self._try,
            "pick": self._pick,
            "seen": self._seen,
            "depths": self._depths,
            "line": self._line,
            "section": self._section,
            "check": self._check,
            "histogram": self._histogram,
            "extrema": self._extrema,
            "linear": self._linear,
            "other": self._other,
            "save": self._save,
            "follow": self._follow,
            "history": self._history,
            "series range": self._series_range,
        }

    def answer(self, name: str, number: int, content: Any) -> Any:
        """The answer to a request; ElvisError where there is none."""
        return self._answers[name](number, content)

    @property
    def _few(self) -> Dataset | PluginData:
        """The data, a few elements where they come in bricks."""
        from elvis.renderer.parts.bricks import Bricks

        return self._data.dataset if isinstance(self._data, Bricks) else self._data

    def _dataset(self, what: str) -> Dataset:
        """The dataset; ElvisError, which says what needs one, where there is none at hand."""
        from elvis.core.base.errors import ElvisError
        from elvis.core.data.dataset import Dataset
        from elvis.renderer.parts.bricks import Bricks

        if isinstance(self._data, Bricks):
            raise ElvisError(f"{what} need all elements, which --memory does not allow: start elvis view without it")
        if not isinstance(self._data, Dataset):
            raise ElvisError(f"{what} need a dataset; data of a runtime plugin only have pictures")
        return self._data

    def _facts(self, _: int, __: Any) -> Table:
        """Choices that the page offers: quantities, boundaries, bounding box of the data."""
        from elvis.core.data.axis_planes import box_of
        from elvis.core.data.dataset import Dataset
        from elvis.core.deformed.copied_domains import periods
        from elvis.core.distances.boundaries import bodies, names_of_boundaries
        from elvis.core.summary.picturing import Kind
        from elvis.plugins.runtime.serving import names_of
        from elvis.renderer.parts.bricks import Bricks
        from elvis.viewer.contents import contents_of, grouped_names, wall_field

        data = self._few
        names = names_of(data)
        facts: Table = {
            "fields": list(names.fields),
            "quantities": grouped_names(names, isinstance(data, Dataset)),
            "periods": {},
            "boundaries": [],
            "bodies": [],
            "body_size": 0.0,
            "body_box": None,
            "wall_field": None,
            "kind": "solid",
            "box": None,
            "times": self._moments.times,
            "complex": list(names.complexes) if isinstance(data, Dataset) else [],
            "others": list(data.others) if isinstance(data, Dataset) else [],
        }
        if isinstance(data, Dataset):
            facts["kind"] = Kind.of(data).name.lower()
            facts["periods"] = periods(data)
            facts["boundaries"] = names_of_boundaries(data.mesh)
            if not isinstance(self._data, Bricks):
                facts.update(_facts_of_bodies(bodies(data.mesh)))
                facts["wall_field"] = wall_field(names.fields)
                facts["contents"] = contents_of(data)
            facts["box"] = (self._data.corners if isinstance(self._data, Bricks) else box_of(data)).tolist()
            facts["remarks"] = list(data.remarks)
        return facts

    def _draw(self, number: int, content: Table) -> tuple[Table, bytes]:
        """A picture: facts about it, and its file.

        content  the scene's ``table``; ``part`` of the full size each way; whether it ``is_draft``, and ``is_lean`` for
                 few bytes; ``proof`` shows what is not certain

        The file of a draft is followed by the numbers of `motion_of`.
        """
        from elvis.renderer.device.drafts import drafted
        from elvis.scene.figure.picture import square_of_arrows
        from elvis.scene.model.tables import scene_of
        from elvis.scene.model.time_limit import stopped_when
        from elvis.viewer.depths import motion_of
        from elvis.viewer.sizing import draft_of

        start = perf_counter()
        scene = scene_of(content["table"])
        is_final = not content["is_draft"]
        self._take(self._in_state(scene))
        if content["is_draft"]:
            scene = draft_of(scene, content["part"])
        # statistics request the proved status of contours
        scene = replace(scene, stats="proof.json") if content["proof"] and is_final else scene
        # at full size lines are as sharp as pixels, and cost less there; for a slow line fewer bytes count more
        is_lean = content["is_lean"]
        kind = nullcontext() if is_final else drafted(segments=content["part"] < 1.0 and not is_lean)
        with stopped_when(lambda: self._newest.value > number), kind:
            frame = self._pictures.draw(scene)
        drawn = perf_counter()
        self._last = frame, not is_final
        if is_final:
            self._whole = frame, number
        file, layout = lossless(frame) if is_final else bare(frame, is_lean)
        if content["proof"]:
            file = with_proof(file, frame, layout.corner)
        facts = facts_of(frame, layout)
        if is_final:
            facts["arrows"] = square_of_arrows(frame)
        else:
            motion, numbers = motion_of(frame, is_lean)
            facts["motion"] = {**motion, "begin": len(file)}
            file += numbers
        facts["seconds"] = {"draw": drawn - start, "encode": perf_counter() - drawn}
        return {**facts, "number": number, "final": is_final}, file

    def _try(self, number: int, content: Table) -> bool:
        """Whether a draft, which nobody sees, was drawn to the end: for its duration.

        content  as of ``draw``
        """
        from elvis.core.base.errors import ElvisError
        from elvis.scene.model.time_limit import ObsoleteError

        last = self._last
        try:
            self._draw(number, content)
        except ObsoleteError:
            raise
        except ElvisError:
            pass  # a small picture may miss all visible points
        finally:
            self._last = last
        return True

    def _in_state(self, scene: Scene) -> Dataset | PluginData | Bricks:
        """The data at the moment of a scene, at its phase and on its geometry: all answers are about these."""
        from elvis.renderer.asking.deformed_data import DeformedData
        from elvis.renderer.parts.bricks import Bricks

        data = self._moments.at(scene.moment)
        if isinstance(data, Bricks):
            return data
        if self._states is None or self._states.data is not data:
            self._states = DeformedData(data, True)
        return self._states.of(scene)

    def _take(self, data: Dataset | PluginData | Bricks) -> None:
        """Show these data from now on."""
        if data is self._data:
            return
        self._data = data
        self._pictures.show(data)
        self._known = {}
        self._other_pictures.clear()
        self.__dict__.pop("_linear_pictures", None)

    def _follow(self, _: int, __: Any) -> bool:
        """Whether a run has a newer step than the last one reported."""
        return self._moments.look()

    def _history(self, _: int, content: Table) -> Table:
        """Exact values of a quantity at a place over all steps, or over as many as there is time for."""
        return self._moments.history(content["quantity"], content["place"])

    def _series_range(self, _: int, text: str) -> list[float]:
        """Certified bounds of a quantity over all steps."""
        frame, _ = self._last_picture()
        return self._moments.range_of(text, frame.scene)

    def _last_picture(self) -> tuple[Frame, int]:
        """The last whole picture, and its number; ElvisError before the first."""
        from elvis.core.base.errors import ElvisError

        if self._whole is None:
            raise ElvisError("no picture has been drawn yet")
        return self._whole

    def _pick(self, _: int, content: Table) -> Table | None:
        """Value of the last complete picture at a column and row of its pixels.

        content  ``row``, ``column``; ``number`` of the picture that the page shows: None if it is another one
        """
        from elvis.core.base.errors import ElvisError
        from elvis.scene.record.frame import Status

        frame, own = self._last_picture()
        if content.get("number", own) != own:
            return None
        row, column = int(content["row"]), int(content["column"])
        height, width = frame.element.shape
        if not (0 <= row < height and 0 <= column < width):
            raise ElvisError("the point lies outside the picture")
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

    def _seen(self, _: int, __: Any) -> list[list[float]] | None:
        """Minimum and maximum coordinates of what the last whole picture shows; None where that is nothing."""
        frame = self._whole[0] if self._whole else None
        if frame is None or not frame.seen.any():
            return None
        points = frame.position[frame.seen]
        ends = [points.min(axis=0), points.max(axis=0)]
        return [[float(value) for value in end] for end in ends]

    def _depths(self, _: int, __: Any) -> Table | None:
        """Depths of the last whole picture, and its number."""
        from elvis.viewer.depths import depths_of

        if self._whole is None:
            return None
        frame, number = self._whole
        return {"number": number, **depths_of(frame)}

    def _known_of(self, position: list[float]) -> Table:
        """Order and Jacobian determinant of the element at a point, if the data provide them."""
        import numpy as np

        from elvis.core.base.errors import ElvisError

        known = self._known
        if "sampler" not in known:
            known["sampler"] = self._element_sampler()
        sampler = known["sampler"]
        if sampler is None:
            return {}
        with suppress(ElvisError):
            found = sampler.sample(np.array([position]))
            return {name: _number(float(found[name][0])) for name in ("order", "jacobian")}
        return {}

    def _element_sampler(self) -> Any:
        """A sampler that locates and describes elements; None for the data of runtime plugins."""
        from elvis.core.data.dataset import Dataset
        from elvis.core.quantities import Expression, evaluator
        from elvis.plugins.runtime.serving import names_of

        if not isinstance(self._data, Dataset):
            return None
        names = names_of(self._data)
        return evaluator.Sampler(self._data, [Expression.parse(text, names) for text in ("order", "jacobian")])

    def _line(self, _: int, content: Table) -> Table:
        """Exact values of quantities at points from one place to another."""
        from elvis.core.numbers.sampling import line

        dataset = self._dataset("lines of values")
        samples = line(dataset, content["quantities"], content["start"], content["end"], LINE_POINTS)
        return {
            "names": list(samples.names),
            "points": samples.points.tolist(),
            "values": [[_number(value) for value in row] for row in samples.values.T.tolist()],
            "elements": samples.location.element_id.tolist(),
        }

    def _section(self, _: int, content: Table) -> Table:
        """Exact values of quantities along the wall at a place."""
        from elvis.viewer.wall_sections import wall_section

        dataset = self._dataset("wall sections")
        found = wall_section(dataset, content["place"], content["quantities"], content.get("axis"))
        columns = {name: [_number(value) for value in own] for name, own in found["columns"].items()}
        return {**found, "columns": columns}

    def _linear(self, number: int, content: Table) -> Table:
        """The last picture with linear elements, as the file of its image in base64.

        content  ``level``: refinement of each element
        """
        from elvis.scene.model.time_limit import stopped_when

        frame, _ = self._last_picture()
        with stopped_when(lambda: self._newest.value > number):
            image, simplices = self._linear_pictures.draw(frame, min(max(int(content["level"]), 0), MOST_CUTS))
        return {"file": b64encode(png(image)).decode(), "simplices": simplices}

    def _other(self, number: int, content: Table) -> Table | None:
        """The last picture drawn from another dataset, see `OtherPictures`; None before there is one.

        content  ``name`` of the other dataset
        """
        from elvis.scene.model.time_limit import stopped_when

        dataset = self._dataset("comparisons")
        if self._last is None:
            return None
        with stopped_when(lambda: self._newest.value > number):
            return self._other_pictures.draw(dataset, content["name"], *self._last)

    @cached_property
    def _linear_pictures(self) -> Any:
        """The renderer of linear elements, made on first use; ElvisError if the data are not a dataset."""
        from elvis.plugins.command.registry import load

        dataset = self._dataset("linear elements")
        pictures: Any = load("elvis.comparisons", "linear")
        return pictures(dataset)

    def _histogram(self, _: int, text: str) -> Table:
        """How much of the volume has which values of a quantity; counted once."""
        from elvis.core.numbers.histogram import histogram
        from elvis.core.quantities import Expression

        known = self._known
        dataset = self._dataset("histograms")
        key = f"histogram {text}"
        if key not in known:
            found = histogram(dataset, Expression.of(dataset, text))
            known[key] = {
                "low": float(found.ends[0]),
                "high": float(found.ends[-1]),
                "shares": found.shares.tolist(),
                "sample": f"{found.points} points of {found.elements} of {found.total} elements",
            }
        answer: Table = known[key]
        return answer

    def _extrema(self, _: int, text: str) -> list[Table]:
        """The minimum and the maximum value of a quantity over all elements, and where they are."""
        from elvis.core.bounds.quantity_extrema import quantity_extrema
        from elvis.core.quantities import Expression

        dataset = self._dataset("extrema")
        ends = quantity_extrema(dataset, Expression.of(dataset, text))
        found = zip(("minimum", "maximum"), ends, strict=True)
        keys = ("field", "value", "position", "element", "status")
        return [dict(zip(keys, (text, own.value, list(own.position), own.element, n), strict=True)) for n, own in found]

    def _check(self, _: int, text: str) -> str:
        """Nothing; ElvisError where a text names no quantity."""
        from elvis.core.quantities import Expression
        from elvis.plugins.runtime.serving import names_of

        Expression.parse(text, names_of(self._few))
        return ""

    def _save(self, number: int, content: Table) -> bytes:
        """The file of a scene: a picture or a record, as ``elvis render`` writes it; left if somebody needs a picture.

        content  ``table`` and ``suffix``; ``directions`` and ``all_steps`` of a page
        """
        from elvis.scene.model.tables import scene_of
        from elvis.scene.model.time_limit import stopped_when
        from elvis.viewer.page_files import page_file

        suffix = content["suffix"]
        scene = replace(scene_of(content["table"]), outputs=(f"picture{suffix}",))
        times = self._moments.times if content.get("all_steps") else []
        directions = content.get("directions", 1)
        with stopped_when(lambda: self._newest.value > number):
            if suffix != HTML or (directions < 2 and len(times) < 2):
                return file_of(self._drawn(scene), suffix)
            return page_file(
                scene, directions, times, lambda views, first: views.cameras(first, self._state(first)), self._drawn
            )

    def _state(self, scene: Scene) -> Any:
        """The data at the moment of a scene, which pictures show from now on."""
        self._take(self._in_state(scene))
        return self._data

    def _drawn(self, scene: Scene) -> Frame:
        """The picture of a scene at its moment."""
        self._state(scene)
        return self._pictures.draw(scene)


def _facts_of_bodies(found: Bodies) -> Table:
    """Names, relative size and box of the boundaries that others surround."""
    box = None if found.box is None else found.box.tolist()
    return {"bodies": list(found.names), "body_size": found.size, "body_box": box}


def _number(value: float) -> float | None:
    """The number, None for what JSON has no word for."""
    return value if abs(value) < float("inf") else None


def spawn() -> Process:
    """Start the process; the first thing that it is to be sent is its source."""
    from multiprocessing import get_context

    context = get_context("spawn")
    here, there = zip(*(context.Pipe() for _ in range(1 + QUESTION_THREADS)), strict=True)
    newest = context.Value("Q", 0, lock=False)
    process = context.Process(target=run, args=(there, newest), daemon=True, name="elvis-drawing")
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    with _without_interrupts():
        process.start()
    for pipe in there:
        pipe.close()
    return Process(process, here, newest)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes that start here never get what Ctrl-C sends to all of a terminal: it is meant for the server."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
