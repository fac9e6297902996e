"""Who may look, and what the server gives."""

import asyncio
import errno
import json
import os
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest
from driving import PATIENCE, finished

from elvis.core.base.errors import ElvisError
from elvis.scene.model.files import read_scene
from elvis.viewer import access
from elvis.viewer.access import is_known_host
from elvis.viewer.server import Server, serve


def fetch(address, **headers):
    """Status, headers and content of an address."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=PATIENCE) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


@pytest.mark.parametrize("path", ["", "viewer.js", "viewer.css", "socket", "save/scene.toml"])
@pytest.mark.parametrize("token", ["", "?token=", "?token=wrong", "?token=%C3%A4"])
def test_the_token_is_required(viewer, path, token):
    assert fetch(f"{viewer.root}{path}{token}")[0] == 403


@pytest.mark.parametrize("path", ["", "socket", "save/scene.toml"])
def test_pages_of_other_origins_are_rejected(viewer, path):
    token = viewer.server.token
    assert fetch(f"{viewer.root}{path}?token={token}", Origin="http://elsewhere.example")[0] == 403


def test_other_schemes_are_other_origins(viewer):
    authority = urlsplit(viewer.root).netloc
    assert fetch(viewer.address, Origin=f"http://{authority}")[0] == 200
    assert fetch(viewer.address, Origin=f"https://{authority}")[0] == 200  # a proxy encrypts
    assert fetch(viewer.address, Origin=f"ftp://{authority}")[0] == 403
    assert fetch(viewer.address, **{"Origin": f"http://{authority}", "X-Forwarded-Proto": "https"})[0] == 403


def test_unknown_host_names_are_rejected(viewer):
    status, _, content = fetch(viewer.address, Host="elsewhere.example:80")
    assert status == 403
    assert b"--allow-host elsewhere.example" in content
    port = urlsplit(viewer.root).port
    for host in (f"localhost:{port}", "127.0.0.1", "[::1]:80", socket.gethostname()):
        assert fetch(viewer.address, Host=host)[0] == 200
    assert is_known_host("hub.example", ["Hub.example"])


def test_connections_without_a_request_end(viewer, monkeypatch):
    monkeypatch.setattr(access, "REQUEST_SECONDS", 0.3)
    monkeypatch.setattr(access, "MAX_UNFINISHED", 3)
    parts = urlsplit(viewer.root)
    waiting = [socket.create_connection((parts.hostname, parts.port), timeout=PATIENCE) for _ in range(4)]
    for own in waiting:
        with own, suppress(ConnectionResetError):
            assert own.recv(1) == b""
    assert fetch(viewer.address)[0] == 200


def test_connections_of_rejected_requests_end(viewer):
    """Else another user of the machine could hold all connections open that a process may have."""
    parts = urlsplit(viewer.root)
    with socket.create_connection((parts.hostname, parts.port), timeout=PATIENCE) as own:
        own.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\nGET /")
        answer = b"".join(iter(lambda: own.recv(1000), b""))
    assert answer.startswith(b"HTTP/1.1 403 ")


def test_malformed_requests_do_not_print_the_token(viewer, capfd, caplog):
    parts = urlsplit(viewer.address)
    with socket.create_connection((parts.hostname, parts.port), timeout=PATIENCE) as own:
        own.sendall(f"GET /?{parts.query}{'x' * 20_000} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        assert b"400" in own.recv(1000)
    assert viewer.server.token not in "".join(capfd.readouterr()) + caplog.text


def test_the_first_page_is_readable_only_by_its_owner(tmp_path):
    with access.private_page("http://localhost:1/?token=a&b", tmp_path / "view") as page:
        path = Path(urlsplit(page).path)
        assert "token" not in page
        assert path.stat().st_mode & 0o777 == 0o600
        assert path.parent.stat().st_mode & 0o777 == 0o700
        assert 'content="0;url=http://localhost:1/?token=a&amp;b"' in path.read_text()
    assert not path.exists()


def test_the_page_runs_only_its_code(viewer):
    status, headers, content = fetch(viewer.address)
    assert status == 200
    assert "script-src 'self'" in headers["Content-Security-Policy"]
    assert b"<script>" not in content
    assert b"http://" not in content
    assert b"https://" not in content


def test_the_scene_is_saved(viewer, scene, tmp_path):
    status, _, content = fetch(f"{viewer.root}save/scene.toml?token={viewer.server.token}")
    assert status == 200
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    found = read_scene(path)
    assert (found.field, found.plane, found.camera) == (scene.field, scene.plane, scene.camera)


@pytest.mark.parametrize(
    ("how", "expected"),
    [
        ("size=90x", "expected size=WIDTHxHEIGHT"),
        ("size=90", "size"),
        ("size=9000x90", "at most 8192 pixels"),
        ("size=0x90", "size"),
        ("samples=17", "samples"),
        ("samples=two", "samples=NUMBER"),
    ],
)
def test_pictures_of_other_sizes_give_a_one_line_error(viewer, how, expected):
    status, _, content = fetch(f"{viewer.root}save/a.png?token={viewer.server.token}&{how}")
    assert status == 400
    assert expected in content.decode()


@pytest.mark.parametrize("name", ["scene.exe", "scene", "..%2Fscene.toml.py"])
def test_other_files_are_not_served(viewer, name):
    status, _, content = fetch(f"{viewer.root}save/{name}?token={viewer.server.token}")
    assert status == 400
    assert b"expected a name that ends in" in content


def test_meaningless_messages_get_a_one_line_answer(viewer):
    from elvis.viewer.viewers import Viewer

    answers = []

    async def send(message):
        answers.append(message)

    one = Viewer(send)
    for message in (
        {},
        {"type": 3},
        {"type": "change"},
        {"type": "change", "changes": {"camera": "up"}},
        {"type": "pick", "id": 1},
    ):
        viewer.call(viewer.session.receive(one, message))
    found = [json.loads(answer) for answer in answers]
    assert [each["type"] for each in found] == ["error"] * 5
    assert all(each["text"] for each in found)


def asked(viewer, **message):
    """The answer to a message of a page."""
    from elvis.viewer.viewers import Viewer

    answers = []

    async def send(text):
        answers.append(json.loads(text))

    viewer.call(viewer.session.receive(Viewer(send), {"id": 1, **message}))
    return answers[0]


def test_pages_write_only_permitted_files(viewer, tmp_path):
    """In the folder of the data or below, not over inputs, and over others once that was confirmed."""
    viewer.session.may_write = False
    assert "--allow-writes" in asked(viewer, type="write", content={"name": "a.png"})["text"]

    viewer.session.may_write = True
    home = Path(viewer.session.scene.data[0]).parent
    (home / "below").mkdir()
    (home / "out").symlink_to(tmp_path)
    (home / "name.xml.png").symlink_to(home / "wave.xml")
    refused = {
        "../a.png": "next to the scene or in a folder below",
        str(home / "a.png"): "next to the scene or in a folder below",
        "out/a.png": "without links out",
        "wave.xml": "a name that ends in .png",
        "name.xml.png": "it is the input",
        "none/a.png": "there is no folder",
        "a\0.png": "without zeros",
        "": "a name that ends in",
        7: "does not understand",
    }
    for name, part in refused.items():
        answer = asked(viewer, type="write", content={"name": name, "confirmed": True})
        assert answer["type"] == "error", name
        assert part in answer["text"], name
    assert not list(tmp_path.iterdir())
    assert (home / "wave.xml").read_bytes().startswith(b"<")

    for name in ("a.png", "below/scene.toml"):
        assert asked(viewer, type="write", content={"name": name})["content"] == {"wrote": str(home / name)}
        before = (home / name).stat().st_ino
        assert "already exists" in asked(viewer, type="write", content={"name": name})["content"]["question"]
        assert (home / name).stat().st_ino == before
        assert "wrote" in asked(viewer, type="write", content={"name": name, "confirmed": True})["content"]
        assert (home / name).stat().st_ino != before
    assert read_scene(home / "below" / "scene.toml").data == viewer.session.scene.data


def test_a_full_disk_is_reported_to_the_page(viewer, monkeypatch):
    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    viewer.session.may_write = True
    home = Path(viewer.session.scene.data[0]).parent
    (home / "full.toml").write_text("before")
    monkeypatch.setattr(os, "fsync", full)
    answer = asked(viewer, type="write", content={"name": "full.toml", "confirmed": True})
    assert answer["type"] == "error"
    assert answer["text"].endswith("full.toml: cannot be written: No space left on device")
    assert (home / "full.toml").read_text() == "before"
    assert not list(home.glob(".elvis-*"))


#: Ctrl-C before the loop begins, and while its task waits; in a main thread, in which no browser's loop runs
INTERRUPTED = """
import asyncio, signal
from elvis.viewer.server import run_until_interrupted

def handle(*_):
    raise KeyboardInterrupt

async def work():
    print("begun")
    signal.raise_signal(signal.SIGINT)
    await asyncio.sleep(60)
    print("not cancelled")

class Loop(asyncio.SelectorEventLoop):
    def create_task(self, *given, **options):
        if early and early.pop():
            signal.raise_signal(signal.SIGINT)
        return super().create_task(*given, **options)

class Policy(asyncio.DefaultEventLoopPolicy):
    def new_event_loop(self):
        return Loop()

signal.signal(signal.SIGINT, handle)
asyncio.set_event_loop_policy(Policy())
for early in ([False], [True]):
    run_until_interrupted(work)
    print("restored" if signal.getsignal(signal.SIGINT) is handle else "lost")
"""


def test_an_interrupt_cancels_and_is_not_raised_in_a_task():
    """Ctrl-C while a request is answered, and before the loop has begun."""
    found = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["begun", "restored", "restored"]
    assert not found.stderr


def test_nan_is_sent_to_the_page_as_null():
    """JSON has no word for them, and browsers refuse what Python would write."""
    from elvis.viewer.drawing_process import _number

    assert json.dumps([_number(value) for value in (float("nan"), float("inf"), -1.5)]) == "[null, null, -1.5]"


def test_idle_seconds_count_from_the_last_closed_page(monkeypatch):
    """Somebody looks, leaves, looks again, and leaves: what was counted before is no more."""

    async def main():
        loop = asyncio.get_running_loop()
        later, timers = loop.call_later, []
        monkeypatch.setattr(loop, "call_later", lambda *given: timers.append(later(*given)) or timers[-1])
        server = SimpleNamespace(session=SimpleNamespace(viewers=set()), token="")
        server.start = server.close = lambda *_: asyncio.sleep(0)
        serving = asyncio.create_task(serve(server, "localhost", 0, lambda address: server.on_empty(), 1000.0))
        while len(timers) < 2:
            await asyncio.sleep(0)
        found = [timer.cancelled() for timer in timers]
        serving.cancel()
        return found

    assert finished(main()) == [True, False]


def test_an_address_of_another_machine_gives_a_one_line_error():
    with pytest.raises(ElvisError, match=r"on 192\.0\.2\.1:0: not an address of this machine; see --host and --port"):
        finished(Server(None).start("192.0.2.1", 0))
