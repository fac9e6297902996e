"""Who may look, and what the server gives."""

import json
import urllib.error
import urllib.request

import pytest

from elvis.scene.files import read_scene


def fetch(address, **headers):
    """Status, headers and content of an address."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=60) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


@pytest.mark.parametrize("path", ["", "viewer.js", "viewer.css", "socket", "save/scene.toml"])
@pytest.mark.parametrize("token", ["", "?token=", "?token=wrong", "?token=%C3%A4"])
def test_nobody_enters_without_the_token(viewer, path, token):
    assert fetch(f"{viewer.root}{path}{token}")[0] == 403


@pytest.mark.parametrize("path", ["", "socket", "save/scene.toml"])
def test_pages_of_other_origins_are_refused(viewer, path):
    token = viewer.server.token
    assert fetch(f"{viewer.root}{path}?token={token}", Origin="http://elsewhere.example")[0] == 403


def test_the_page_runs_its_own_code_alone(viewer):
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


@pytest.mark.parametrize("name", ["scene.exe", "scene", "..%2Fscene.toml.py"])
def test_other_files_are_not(viewer, name):
    status, _, content = fetch(f"{viewer.root}save/{name}?token={viewer.server.token}")
    assert status == 400
    assert b"expected a name that ends in" in content


def test_messages_that_say_nothing_are_answered_with_a_sentence(viewer):
    from elvis.viewer.session import Viewer

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


def test_numbers_that_are_none_go_to_the_page_as_null():
    """JSON has no word for them, and browsers refuse what Python would write."""
    from elvis.viewer.drawing_process import _number

    assert json.dumps([_number(value) for value in (float("nan"), float("inf"), -1.5)]) == "[null, null, -1.5]"
