"""A second dataset next to the first: its files, the difference, and the same view of it."""

import asyncio
import base64
import errno
import io
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driving import finished, picture, settled
from PIL import Image
from test_page import as_rendered

from elvis import Dataset, Shape, read, render, write
from elvis.core.base.errors import ElvisError
from elvis.core.testing import approximated, grid
from elvis.plugins.data.data import Reading
from elvis.viewer import second_data
from elvis.viewer.drawing_process import Source
from elvis.viewer.second_data import MAX_FILES, SentFiles, plain_name, received, sources_with

PIXELS = "elvis.beside.canvas.toDataURL().split(',')[1]"


@pytest.fixture(scope="module")
def finer(tmp_path_factory):
    """Files of the same cube on more elements, with another function."""
    bare = Dataset(grid(Shape.HEXAHEDRON, 3))
    fields = (approximated(bare, "u", lambda x: np.cos(2 * x[:, 0]), 4),)
    return tuple(map(str, write(Dataset(bare.mesh, fields), tmp_path_factory.mktemp("finer") / "finer.xml")))


def test_names_of_sent_files_are_plain():
    assert plain_name("../a b,c.fld") == "a_b_c.fld"
    assert plain_name("C:\\data\\.x.vtu") == "x.vtu"
    with pytest.raises(ElvisError, match="expected a name"):
        plain_name("..")


def test_sent_files_are_limited_and_private(monkeypatch):
    monkeypatch.setattr(second_data, "MAX_BYTES", 10)
    data = SentFiles()
    for number in range(MAX_FILES):
        data.open(f"{number}.fld")
    with pytest.raises(ElvisError, match="expected at most 100 files"):
        data.open("more.fld")
    data.append(b"0123456789")
    with pytest.raises(ElvisError, match="the files are larger than"):
        data.append(b"a")
    folder = data.files[0].parent
    assert folder.stat().st_mode & 0o077 == 0
    data.remove()
    assert not folder.exists()


class _Part:
    """A file of a multipart request, in chunks."""

    def __init__(self, name, *chunks):
        self.filename, self._chunks = name, [*chunks, b""]

    async def read_chunk(self, size):
        await asyncio.sleep(0)
        return self._chunks.pop(0)


async def _parts(*parts):
    for part in parts:
        yield part


def test_files_that_two_pages_send_at_the_same_time_stay_apart():
    async def main():
        sending = [received(_parts(_Part("a.vtu", *[own] * 50), _Part("b.vtu", own))) for own in (b"1", b"2")]
        return await asyncio.gather(*sending)

    for sent, own in zip(finished(main()), (b"1", b"2"), strict=True):
        assert [path.read_bytes() for path in sent.files] == [own * 50, own]
        sent.remove()


def test_a_full_disk_leaves_no_files(monkeypatch, tmp_path):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(Path, "touch", full)
    with pytest.raises(ElvisError, match=r"^the files can't be stored: No space left on device$"):
        finished(received(_parts(_Part("a.vtu", b"1"))))
    assert not list(tmp_path.iterdir())


def test_fields_without_a_mesh_use_the_first_one():
    source = Source(("wing.xml", "wing.fld"), reading=Reading(others=("ref=a.vtu", "other=b.vtu")))
    found = [each.reading.others for each in sources_with(source, [Path("/tmp/c.fld")])]
    assert found == [("ref=a.vtu", "other=/tmp/c.fld"), ("ref=a.vtu", "other=wing.xml,/tmp/c.fld")]
    with pytest.raises(ElvisError, match="needs data in files"):
        sources_with(Source(("run",), is_live=True), [Path("c.fld")])


def test_a_second_dataset_is_compared(page, viewer, finer, tmp_path):
    """The difference equals that of elvis render; next to the first picture is that of the second data."""
    camera = {"eye": [2, 1.5, 3], "at": [0.5, 0.5, 0.4], "up": [0, 1, 0], "height": 1.6}
    page.evaluate("(camera) => elvis.change({ camera })", camera)
    page.get_by_label("files of a second dataset").set_input_files(finer)
    page.get_by_role("separator", name="divider").wait_for()
    settled(page, viewer)
    second = page.get_by_label("second dataset", exact=True)
    assert second.input_value() == "divider: other"
    second.select_option("side by side: other")
    settled(page, viewer)
    page.wait_for_function("elvis.beside.isApart && !elvis.beside.canvas.hidden")
    image = page.evaluate("elvis.picture.image.slice(2)")
    assert image[0] < page.evaluate("elvis.stage.clientWidth") / 2
    pixels = np.array(Image.open(io.BytesIO(base64.b64decode(page.evaluate(PIXELS)))).convert("RGB"))
    ends = tuple(page.evaluate("elvis.picture.ranges.u"))
    scene = replace(viewer.session.current, data=finer, others=(), size=tuple(image), range=ends)
    assert np.array_equal(pixels, render(read(*finer), scene).image)

    second.select_option("difference: other")
    page.wait_for_function("Array.isArray(elvis.table.range)")
    settled(page, viewer)
    low, high = viewer.session.table["range"]
    assert low == -high
    assert viewer.session.table["field"] == "u - other:u"
    assert picture(viewer) == as_rendered(viewer, tmp_path)
    second.select_option("compare: off")
    settled(page, viewer)
    assert viewer.session.table["field"] == "u"
    assert not {"palette", "range"} & viewer.session.table.keys()


def test_unreadable_files_change_nothing(page, viewer, tmp_path):
    (tmp_path / "broken.vtu").write_text("nothing")
    before = viewer.session.source
    page.get_by_label("files of a second dataset").set_input_files(tmp_path / "broken.vtu")
    page.get_by_role("alert").filter(has_text="broken.vtu").wait_for()
    settled(page, viewer)
    assert viewer.session.source == before
