"""What goes wrong around a viewer costs one sentence, and nothing else."""

import asyncio
import json
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace

import pytest
from driving import PATIENCE, finished

from elvis.core.base.errors import ElvisError
from elvis.renderer.device.errors import DeviceError
from elvis.scene import Scene
from elvis.viewer import drawer, drawing_process, session
from elvis.viewer.viewers import MAX_QUESTIONS, UNCONFIRMED, Viewer
from elvis.viewer.watching import WatchedFiles


class Tab:
    """A page without a browser: what it was sent; it confirms pictures where it ``answers``."""

    def __init__(self, socket, answers=True):
        self.socket, self.answers = socket, answers
        self.pictures, self.states, self.sentences = [], [], []

    async def listen(self):
        async for message in self.socket:
            if isinstance(message.data, bytes):
                length = struct.unpack("<I", message.data[:4])[0]
                self.pictures.append((json.loads(message.data[4 : 4 + length]), message.data[4 + length :]))
                if self.answers:
                    await self.socket.send_str('{"type": "shown"}')
            else:
                content = json.loads(message.data)
                (self.sentences if content["type"] == "error" else self.states).append(content)

    def has(self, revision):
        return any(facts["final"] and facts["revision"] >= revision for facts, _ in self.pictures)


def looking(viewer, work, count=1, silent=0):
    """What becomes of ``work(tabs)``, by some tabs, the first of which are silent."""
    import aiohttp

    async def main():
        async with aiohttp.ClientSession() as client:
            token = viewer.server.token
            sockets = [await client.ws_connect(f"{viewer.root}socket?token={token}") for _ in range(count)]
            tabs = [Tab(socket, number >= silent) for number, socket in enumerate(sockets)]
            listening = [asyncio.create_task(tab.listen()) for tab in tabs]
            await asyncio.wait_for(work(tabs), PATIENCE)
            for task in listening:
                task.cancel()

    finished(main())


async def until(holds):
    while not holds():
        await asyncio.sleep(0.02)


def test_two_pictures_at_most_are_on_their_way():
    """While something moves, pictures without room are dropped; the last one at rest is retained for later."""

    async def work():
        sent, most = [], 0

        async def send(message):
            sent.append(message)

        page = session.Viewer(send)
        for number in range(1, 40):
            await page.take(number, b"%d" % number, number % 10 == 0)
            most = max(most, page.sent - page.confirmed)
            if number % 5 == 0:
                await page.confirm()
                most = max(most, page.sent - page.confirmed)
        while page.confirmed < page.sent:
            await page.confirm()
        await page.confirm()
        assert page.sent == page.confirmed == len(sent)
        return sent, most

    sent, most = finished(work())
    assert most == UNCONFIRMED
    assert {b"10", b"20", b"30"} <= set(sent)
    assert sent == sorted(sent, key=int)


def test_ten_tabs_see_the_same(viewer):
    """One of them confirms nothing, gets two pictures, and holds up none of the others."""

    async def work(tabs):
        for number, palette in enumerate(("magma", "plasma", "inferno", "viridis")):
            change = {"type": "change", "changes": {"palette": palette}}
            await tabs[number].socket.send_str(json.dumps(change))
            wanted = number + 1
            await until(lambda wanted=wanted: all(tab.has(wanted) for tab in tabs[1:]))
        assert len({tab.pictures[-1][1] for tab in tabs[1:]}) == 1
        assert len(tabs[0].pictures) == UNCONFIRMED
        assert not any(tab.sentences for tab in tabs)
        # it gets the last one as soon as it can
        await tabs[0].socket.send_str('{"type": "shown"}')
        await until(lambda: tabs[0].has(4))
        assert tabs[0].pictures[-1][1] == tabs[1].pictures[-1][1]

    looking(viewer, work, count=10, silent=1)


def test_damaged_or_changed_data_are_reported_and_read_again(wave, start, tmp_path, monkeypatch, capsys):
    """The terminal hears of it where nobody looks yet."""
    monkeypatch.setattr(session, "WATCH", 0.1)
    mesh = tmp_path / "mesh.xml"
    whole = Path(wave[0]).read_bytes()
    mesh.write_bytes(whole[: len(whole) // 2])
    viewer = start(Scene("u", data=(str(mesh), wave[1]), size=(64, 64)))
    finished(until(lambda: f"elvis: warning: {mesh}: " in capsys.readouterr().err))

    async def work(tabs):
        await until(lambda: tabs[0].sentences)
        assert str(mesh) in tabs[0].sentences[-1]["text"]
        mesh.write_bytes(whole)
        await until(lambda: tabs[0].pictures)

        await tabs[0].socket.send_str('{"type": "change", "changes": {"camera": "+x"}}')
        await until(lambda: tabs[0].has(1))
        mesh.write_bytes(whole + b"\n")
        await until(lambda: tabs[0].states[-1]["stale"])
        assert tabs[0].states[-1]["stale"] == f"{mesh} has changed on disk; the picture shows the previous contents"
        await tabs[0].socket.send_str('{"type": "read again"}')
        await until(lambda: tabs[0].has(2))
        assert tabs[0].states[-1]["stale"] == ""
        assert tabs[0].states[-1]["table"]["camera"] == "+x"

    looking(viewer, work)


def test_changed_or_removed_files_are_reported(tmp_path):
    names = [tmp_path / "a.xml", tmp_path / "parts"]
    names[1].mkdir()
    inner = names[1] / "P0.xml"
    for path in (names[0], inner):
        path.write_text("1")
    files = WatchedFiles(map(str, names))
    files.note(files.stamps())
    assert files.sentence() == ""
    inner.write_text("12")
    assert f"{inner} has changed on disk" in files.sentence() or f"{names[1]} has changed" in files.sentence()
    files.note(files.stamps())
    assert files.sentence() == ""
    names[0].unlink()
    assert f"{names[0]} was removed" in files.sentence()


def test_a_failed_picture_does_not_end_the_session(monkeypatch):
    """Faults and devices that are lost for good come back as sentences; the next picture is drawn."""
    faults = [ValueError("odd"), DeviceError("the device failed: ERROR_DEVICE_LOST"), MemoryError()]

    def answer(name, number, content):
        if faults:
            raise faults.pop(0)
        return content

    monkeypatch.setattr(drawing_process, "_Drawing", lambda source, newest: SimpleNamespace(answer=answer))
    asked, answers = iter([("draw", number, "a picture") for number in range(4)]), []

    def receive():
        try:
            return next(asked)
        except StopIteration:
            raise EOFError from None

    opened = drawing_process._OpenedOnce(drawing_process.Source(()), None)
    drawing_process._serve(SimpleNamespace(recv=receive, send=answers.append), opened)
    assert [kind for kind, _, _ in answers] == ["error", "error", "error", "draw"]
    sentences = [text for _, _, text in answers]
    assert sentences[0] == "unexpected ValueError: odd; this is a bug in ElVis"
    assert sentences[1:] == [
        "the device failed: ERROR_DEVICE_LOST",
        "not enough memory for this picture; reduce its size or its samples",
        "a picture",
    ]


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C of a terminal is another thing there")
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_the_end_is_quiet(wave, kind, tmp_path):
    """Ctrl-C, which all processes of a terminal get, or SIGTERM, as soon as the address is there; no file is left."""
    command = [sys.executable, "-m", "elvis", "view", *wave]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "start_new_session": True}
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "BROWSER": "true"}
    pages = tmp_path / "elvis" / "view"

    def heed_interrupts():
        """Tests that run in a shell's background inherit that Ctrl-C is ignored."""
        signal.signal(signal.SIGINT, signal.default_int_handler)

    with subprocess.Popen(command, **pipes, env=env, preexec_fn=heed_interrupts) as process:
        told = ""
        while "to stop" not in told:
            line = process.stdout.readline()
            assert line, told
            told += line
        while not (pages.is_dir() and any(pages.iterdir())):
            time.sleep(0.02)
        (os.killpg if kind == signal.SIGINT else os.kill)(process.pid, kind)
        # the pipe ends with the last process that holds it
        told += process.communicate(timeout=PATIENCE)[0]
    assert process.returncode == 0
    assert re.fullmatch(r"http://localhost:\d+/\?token=\S+\nPress Ctrl-C to stop\n", told)
    assert not list(pages.iterdir())


def test_a_page_closed_during_sending_is_not_a_fault(viewer, caplog):
    loop = viewer.loop
    for error in (ConnectionResetError("Cannot write to closing transport"), ValueError("odd")):
        loop.call_soon_threadsafe(loop.call_exception_handler, {"message": "lost", "exception": error})
    asyncio.run_coroutine_threadsafe(asyncio.sleep(0), loop).result(PATIENCE)
    assert [str(record.exc_info[1]) for record in caplog.records] == ["odd"]


def test_missing_files_are_reported_at_once():
    from click.testing import CliRunner

    from elvis.plugins.command.command import elvis

    outcome = CliRunner().invoke(elvis, ["view", "none.xml", "--no-browser", "--idle", "0"], standalone_mode=False)
    assert str(outcome.exception) == "none.xml: there is no such file"


class _Silent:
    """A pipe to a process that never answers, and the process: reading ends with it."""

    def __init__(self):
        self.ended, self.reading, self.closed_while_read = threading.Event(), threading.Event(), None
        self.terminate = self.ended.set

    def send(self, request):
        pass

    def recv(self):
        self.reading.set()
        self.ended.wait()
        time.sleep(0.05)
        self.reading.clear()
        raise EOFError

    def join(self, seconds):
        self.ended.wait(seconds)

    def is_alive(self):
        return False

    def close(self):
        self.closed_while_read = self.reading.is_set()


def test_an_unread_pipe_is_closed(monkeypatch):
    silent = _Silent()
    monkeypatch.setattr(
        drawer, "spawn", lambda: drawing_process.Process(silent, (silent, silent), SimpleNamespace(value=0))
    )

    async def main():
        shut = drawer.Drawer(drawing_process.Source(()))
        asked = asyncio.create_task(shut.ask("picture"))
        await asyncio.to_thread(silent.reading.wait)
        shut.close()
        with pytest.raises(drawer.DiedError):
            await asked

    finished(main())
    assert silent.closed_while_read is False


class _Answering:
    """A process and its pipe: it answers with its name once it may, or with an error."""

    def __init__(self, name, kind="facts"):
        self.name, self.kind, self.may_answer, self.is_ended = name, kind, threading.Event(), False
        self.pid = os.getpid()

    def send(self, request):
        self.request = request

    def recv(self):
        self.may_answer.wait()
        return self.kind, 0, self.name

    def terminate(self):
        self.is_ended = True

    def join(self, seconds):
        pass

    def is_alive(self):
        return False

    def close(self):
        pass


def test_the_previous_process_answers_until_the_next_has_read(monkeypatch):
    """A process that can't read the data is ended, and nothing changes."""
    processes = [_Answering("old"), _Answering("damaged", "error"), _Answering("new")]
    old, damaged, new = processes
    old.may_answer.set()
    damaged.may_answer.set()
    waiting = iter(processes)

    def start():
        process = next(waiting)
        return drawing_process.Process(process, (process, process), SimpleNamespace(value=0))

    monkeypatch.setattr(drawer, "spawn", start)

    async def main():
        source = drawing_process.Source(())
        own = drawer.Drawer(source)
        assert await own.ask("pick") == "old"
        with pytest.raises(ElvisError, match="damaged"):
            await own.read_again(source)
        assert damaged.is_ended
        reading = asyncio.create_task(own.read_again(source))
        for _ in range(3):
            assert await own.ask("pick") == "old"
        assert not reading.done()
        new.may_answer.set()
        assert await reading == await own.ask("pick") == "new"
        await until(lambda: old.is_ended)
        own.close()
        assert new.is_ended

    finished(main())


class _Paused:
    """A pipe whose answers come once they may."""

    def __init__(self):
        self.requests, self.may_answer = [], threading.Event()

    def send(self, request):
        self.requests.append(request)

    def recv(self):
        self.may_answer.wait()
        name, number, content = self.requests[-1]
        return name, number, content

    def close(self):
        pass


def _with_pipes(monkeypatch, count):
    """A drawing process with pipes, and its number of the newest picture."""
    pipes, newest = [_Paused() for _ in range(count)], SimpleNamespace(value=0)
    own = SimpleNamespace(terminate=lambda: None, join=lambda seconds=None: None, is_alive=lambda: False)
    monkeypatch.setattr(drawer, "spawn", lambda: drawing_process.Process(own, tuple(pipes), newest))
    return pipes, newest


def test_long_pictures_and_questions_delay_no_other_page(monkeypatch):
    """Page 1 waits for a picture, page 2 for many questions: the question of page 3 is answered at once."""
    (picture, *questions), _ = _with_pipes(monkeypatch, 3)
    answers = []

    async def main():
        own = drawer.Drawer(drawing_process.Source(()))
        pages = [Viewer(None) for _ in range(2)]

        async def ask(page, content):
            async with page.question():
                answers.append(await own.ask("line", content))

        waiting = [asyncio.create_task(own.ask("draw", 1))]
        waiting += [asyncio.create_task(ask(pages[0], n)) for n in range(MAX_QUESTIONS)]
        await until(lambda: len(picture.requests) == 2 and questions[0].requests)
        with pytest.raises(ElvisError, match="100 questions of this page are still waiting"):
            await ask(pages[0], "one too many")
        questions[1].may_answer.set()
        await ask(pages[1], "quick")
        assert answers == ["quick"]
        for pipe in (picture, *questions):
            pipe.may_answer.set()
        await asyncio.gather(*waiting)
        own.close()

    finished(main())
    assert answers[1:] == list(range(MAX_QUESTIONS))


def test_a_picture_that_is_saved_is_left_when_another_is_needed(monkeypatch):
    """Nor does it begin while another one is wanted."""
    (pipe, _), newest = _with_pipes(monkeypatch, 2)

    async def main():
        own = drawer.Drawer(drawing_process.Source(()))
        saving = asyncio.create_task(own.ask("save"))
        await until(lambda: len(pipe.requests) == 2)
        number = newest.value
        drawing = [asyncio.create_task(own.ask("draw"))]
        await until(lambda: newest.value > number)
        second = asyncio.create_task(own.ask("save", "second"))
        await asyncio.sleep(0)
        drawing.append(asyncio.create_task(own.ask("draw")))
        await asyncio.sleep(0)
        pipe.may_answer.set()
        await asyncio.gather(saving, *drawing)
        assert await second is None
        own.close()

    finished(main())
    assert [name for name, _, _ in pipe.requests[1:]] == ["save", "draw", "draw"]


@pytest.mark.parametrize("times", [3, session.MAX_SAVES])
def test_a_picture_that_was_left_is_saved_once_nothing_else_is_drawn(scene, times):
    """After too many times the page gets the reason."""
    found = iter([*[None] * times, b"picture"])
    waits = []

    async def ask(name, content):
        return next(found)

    async def settle():
        waits.append(1)

    async def main():
        own = session.Session(scene, drawing_process.Source(scene.data))
        own._drawer, own._settle = SimpleNamespace(ask=ask), settle
        return await own.content_of(".png")

    if times < session.MAX_SAVES:
        assert finished(main()) == b"picture"
    else:
        with pytest.raises(ElvisError, match="other pictures were needed while this one was drawn; save it again"):
            finished(main())
    assert len(waits) == times


def test_questions_are_answered_while_a_picture_is_drawn(monkeypatch):
    may_end, pipes = threading.Event(), [Pipe() for _ in range(3)]

    def answer(name, number, content):
        if name == "draw":
            may_end.wait(PATIENCE)
        return content

    monkeypatch.setattr(drawing_process, "_Drawing", lambda source, newest: SimpleNamespace(answer=answer))
    monkeypatch.setattr(drawing_process, "signal", SimpleNamespace(signal=lambda *_: None, SIGINT=0, SIG_IGN=0))
    there = tuple(pipe for _, pipe in pipes)
    process = threading.Thread(target=drawing_process.run, args=(there, None))
    process.start()
    (picture, first, second) = (pipe for pipe, _ in pipes)
    picture.send(drawing_process.Source(()))
    picture.send(("draw", 1, "picture"))
    for number, pipe in enumerate((first, second, first)):
        pipe.send(("line", number, "values"))
        assert pipe.recv() == ("line", number, "values")
    assert not picture.poll()
    may_end.set()
    assert picture.recv() == ("draw", 1, "picture")
    for pipe in (picture, first, second):
        pipe.close()
    process.join(PATIENCE)
    assert not process.is_alive()
