"""The viewer in a notebook, without a notebook: what its cell gets, and messages of a page that is played."""

import base64
import time
from dataclasses import replace

import pytest
from driving import PATIENCE

from elvis import Dataset, Shape, read, render, view, write
from elvis.core.testing import approximated, grid
from elvis.scene import SceneError

pytest.importorskip("anywidget")


@pytest.fixture(scope="module")
def opened(scene):
    """A viewer whose messages to its page are retained."""
    own = view(read(*scene.data), scene)
    own.sent = []

    def send(content, buffers=None):
        """To a page that shows every picture at once, drafts, too."""
        own.sent.append((content, buffers))
        if content["type"] == "frame":
            own._receive(None, {"type": "shown"}, None)

    own._widget.send = send
    yield own
    own.close()


@pytest.fixture
def viewer(opened, scene):
    """The viewer as it was at first, whatever has been done with it before, and a page that has just been opened."""

    async def open_page():
        opened.sent.clear()
        await opened._answer({"type": "hello"})

    opened._receive(None, {"type": "size", "size": list(scene.size)}, None)
    opened.scene = scene
    opened._call(opened._session.whole_message(PATIENCE), PATIENCE + 10)
    opened._call(open_page())
    return opened


def final(viewer, after=-1):
    """The whole picture after a revision, as the page gets it."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for content, buffers in list(viewer.sent):
            if content["type"] == "frame" and content["final"] and content["revision"] > after:
                return content, bytes(buffers[0])
        time.sleep(0.05)
    raise AssertionError("no picture came")


def test_a_page_receives_its_state_and_the_picture(viewer, tmp_path):
    facts, file = final(viewer)
    kinds = [content["type"] for content, _ in viewer.sent]
    assert kinds[0] == "schema"
    assert "state" in kinds
    viewer.save(tmp_path / "own.png")
    assert file == (tmp_path / "own.png").read_bytes()
    assert facts["field"] == "u"


def test_a_static_notebook_has_the_picture(viewer):
    bundle = viewer._repr_mimebundle_()
    bundle = bundle[0] if isinstance(bundle, tuple) else bundle
    assert base64.b64decode(bundle["image/png"]) == final(viewer)[1]
    assert "application/vnd.jupyter.widget-view+json" in bundle


def test_the_scene_changes_both_ways(viewer):
    before = viewer._session.revision
    viewer.scene = replace(viewer.scene, palette="magma")
    final(viewer, before)
    assert viewer.scene.palette == "magma"
    viewer._receive(None, {"type": "change", "changes": {"title": "mine", "palette": None}}, None)
    final(viewer, before + 1)
    assert (viewer.scene.title, viewer.scene.palette) == ("mine", "viridis")
    assert (viewer.frame.rgb == render(read(*viewer.scene.data), viewer.scene).rgb).all()


def test_files_are_sent_to_the_page(viewer, tmp_path):
    """In any size and with any samples, as `save` writes them."""
    how = {"size": (48, 31), "samples": 2}
    for number, suffix in ((7, ".toml"), (8, ".exe"), (9, ".png")):
        viewer._receive(None, {"type": "save", "id": number, "suffix": suffix, "content": how}, None)
    end = time.monotonic() + PATIENCE
    found = {}
    while time.monotonic() < end and len(found) < 3:
        found = {content["id"]: (content, buffers) for content, buffers in viewer.sent if "id" in content}
        time.sleep(0.05)
    assert b'field = "u"' in found[7][1][0]
    assert "expected a name that ends in" in found[8][0]["text"]
    viewer.save(tmp_path / "own.png", **how)
    assert bytes(found[9][1][0]) == (tmp_path / "own.png").read_bytes()
    wanted = render(scene=replace(viewer.scene, **how))
    wanted.save(tmp_path / "wanted.png")
    assert (tmp_path / "wanted.png").read_bytes() == (tmp_path / "own.png").read_bytes()
    with pytest.raises(SceneError, match="size"):
        viewer.save(tmp_path / "none.png", size=(0, 31))


#: a cell of a notebook: what anywidget gives to the module
CELL = """async () => {
  const { default: module } = await import("/viewer.js");
  const handlers = [];
  const on = (_, handler) => handlers.push(handler);
  const model = { get: () => 300, on, off: () => {}, send: (message) => toPython(message) };
  window.deliver = (content, text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    for (const handler of handlers) handler(content, text ? [new DataView(bytes.buffer)] : []);
  };
  module.render({ model, el: document.querySelector("#cell") });
}"""


def test_the_module_shows_and_changes_the_scene_in_a_cell(browser, viewer):
    """In a browser, with a page that plays the notebook; what it draws is the picture that Python sent."""
    page, asked, begun, told = browser.new_page(), [], len(viewer.sent), []
    page.set_default_timeout(1000 * PATIENCE)
    page.on("pageerror", lambda error: told.append(str(error)))
    module, cell = viewer._widget._esm, "<!doctype html><div id=cell></div>"
    page.route("http://cell.test/", lambda route: route.fulfill(content_type="text/html", body=cell))
    page.route(
        "http://cell.test/viewer.js", lambda route: route.fulfill(content_type="text/javascript", body=str(module))
    )
    page.expose_function("toPython", lambda message: asked.append(message))
    page.goto("http://cell.test/")
    page.evaluate(CELL)

    def until(holds):
        nonlocal begun
        end = time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < end, told
            while asked:
                viewer._receive(None, asked.pop(0), None)
            for content, buffers in viewer.sent[begun:]:
                page.evaluate(
                    "([content, text]) => deliver(content, text)",
                    [content, base64.b64encode(b"".join(buffers or ())).decode()],
                )
                begun += 1
            page.wait_for_timeout(50)

    def shown():
        return page.locator(".elvis").get_attribute("data-final")

    until(lambda: shown() == str(viewer._session.revision))
    before = viewer._session.revision
    page.get_by_title("View +x").click()
    until(lambda: viewer._session.revision > before and shown() == str(viewer._session.revision))
    assert viewer.scene.camera == "+x"
    assert not page.get_by_label("save", exact=True).locator("option", has_text="copy link").count()
    assert not told
    page.close()


def answers(viewer, wanted):
    """The answers that the page receives to messages with these numbers."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = {content["id"]: content for content, _ in list(viewer.sent) if content.get("id") in wanted}
        if len(found) == len(wanted):
            return [found[number] for number in wanted]
        time.sleep(0.05)
    raise AssertionError("no answer came")


def test_a_second_dataset_is_sent_in_parts(scene, viewer, tmp_path):
    """Its difference from the first one, which is in memory, is that of files; bad files change nothing."""
    bare = Dataset(grid(Shape.HEXAHEDRON, 1))
    field = approximated(bare, "u", lambda x: x[:, 0] ** 2, 3)
    files = write(Dataset(bare.mesh, (field,)), tmp_path / "second.xml")

    def send(number, kind, content=None, part=None):
        buffers = [] if part is None else [memoryview(part)]
        viewer._receive(None, {"type": kind, "id": number, "content": content}, buffers)

    send(20, "upload", {"name": "bad.vtu", "first": True, "offset": 0}, b"nothing")
    send(21, "compare")
    assert "bad.vtu" in answers(viewer, [21])[0]["text"]
    for place, path in enumerate(files):
        content = path.read_bytes()
        half = len(content) // 2
        send(30 + 2 * place, "upload", {"name": path.name, "first": not place, "offset": 0}, content[:half])
        send(31 + 2 * place, "upload", {"name": path.name, "first": not place, "offset": half}, content[half:])
    send(40, "compare")
    assert [each["type"] for each in answers(viewer, [30, 31, 32, 33, 40])] == ["answer"] * 5
    assert viewer._session.facts["others"] == ["other"]
    before = viewer._session.revision
    viewer.scene = replace(viewer.scene, field="u - other:u")
    _, file = final(viewer, before)
    wanted = render(read(*scene.data).with_others(other=read(*files)), viewer.scene)
    wanted.save(tmp_path / "wanted.png")
    viewer.save(tmp_path / "own.png")
    assert file == (tmp_path / "wanted.png").read_bytes() == (tmp_path / "own.png").read_bytes()


def test_a_notebook_runs_and_stores_the_picture(scene, tmp_path):
    """By a kernel of its own, as `jupyter execute` does it: the widget, and the picture of what was shown last."""
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    nbformat = pytest.importorskip("nbformat")
    options = {"plane": (scene.plane.point, scene.plane.normal), "camera": "iso", "size": scene.size}
    cells = [
        f"import elvis.viewer.widget\nelvis.viewer.widget.PATIENCE = {PATIENCE}",
        f"from elvis import view\nviewer = view(*{scene.data}, 'u', **{options})\nviewer",
        "from dataclasses import replace\nviewer.scene = replace(viewer.scene, palette='magma')\nviewer",
        "viewer.save('own.png')\nviewer.close()",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in cells])
    nbclient.NotebookClient(notebook, timeout=PATIENCE, resources={"metadata": {"path": str(tmp_path)}}).execute()
    nbformat.validate(notebook)
    shown = [cell.outputs[0]["data"] for cell in notebook.cells[1:3]]
    assert all("application/vnd.jupyter.widget-view+json" in data for data in shown)
    pictures = [base64.b64decode(data["image/png"]) for data in shown]
    assert pictures[0] != pictures[1] == (tmp_path / "own.png").read_bytes()
