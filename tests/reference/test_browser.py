"""The page of a report in a real browser: it opens from disk, pictures load, the wipe works, nothing complains."""

import json
import re
import subprocess

import pytest

from elvis import Plane, Scene
from elvis.reference.picture import render
from elvis.reference.report.writing import write_report
from elvis.reference.study import compare_scene

#: set the slider, choose another picture, drag; then say in the page what came of it
PROBE = """
<script>
window.addEventListener("load", function () {
  var said = {}, wipe = document.getElementById("wipe"), at = document.getElementById("at");
  var images = wipe.getElementsByTagName("img"), right = document.getElementById("right");
  at.value = 25;
  at.dispatchEvent(new Event("input"));
  said.clip = getComputedStyle(images[1]).clipPath;
  right.selectedIndex = right.options.length - 1;
  right.dispatchEvent(new Event("change"));
  said.shown = images[1].getAttribute("src");
  var box = wipe.getBoundingClientRect();
  wipe.dispatchEvent(new PointerEvent("pointerdown", { clientX: box.left + 0.75 * box.width, buttons: 1 }));
  said.dragged = Number(at.value);
  said.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  setTimeout(function () {
    said.broken = Array.from(document.images, function (own) { own.loading = "eager"; return own; })
      .filter(function (own) { return own.complete && !own.naturalWidth; }).map(function (own) { return own.src; });
    said.pictures = Array.from(document.images).filter(function (own) { return own.naturalWidth > 0; }).length;
    document.body.setAttribute("data-said", JSON.stringify(said));
  }, 500);
});
</script>
"""


@pytest.fixture(scope="module")
def report(blocks, tmp_path_factory):
    """A report whose page ends in the probe."""
    scene = Scene("wave", Plane((1.5, 0.5, 0.45), (0.1, 0.2, 1.0)), size=(90, 60))
    study = compare_scene(
        blocks, scene, (0, 1), 1 << 30, draw=lambda data, own, device: render(data, own), validation_size=0
    )
    folder = tmp_path_factory.mktemp("browser") / "report"
    write_report(study, folder)
    page = folder / "index.html"
    page.write_text(page.read_text().replace(' loading="lazy"', "").replace("</body>", f"{PROBE}</body>"))
    return folder


def opened(browser, folder, tmp_path, *options):
    """What the browser says on its error stream, and what it prints, for the page of a folder."""
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += [
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--enable-logging=stderr",
        "--virtual-time-budget=5000",
        *options,
    ]
    done = subprocess.run([*command, f"file://{folder}/index.html"], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stderr, done.stdout


@pytest.mark.parametrize("width", [1200, 390])
def test_the_page_works_from_disk(browser, report, tmp_path, width):
    errors, page = opened(browser, report, tmp_path, "--dump-dom", f"--window-size={width},900")
    assert "CONSOLE" not in errors
    said = json.loads(re.search(r'data-said="([^"]*)"', page).group(1).replace("&quot;", '"'))
    assert said["clip"] == "inset(0px 0px 0px 25%)"
    assert said["shown"] == "pictures/vtk.png"
    assert said["dragged"] == 75
    assert said["broken"] == []
    assert said["pictures"] == page.count("<img")
    assert said["wide"] <= 0


def test_a_broken_page_would_be_detected(browser, report, tmp_path):
    """The test above sees missing pictures and errors of scripts."""
    folder = tmp_path / "report"
    folder.mkdir()
    text = (report / "index.html").read_text().replace("<script>", "<script>undefinedFunction();</script><script>", 1)
    (folder / "index.html").write_text(text)
    errors, page = opened(browser, folder, tmp_path, "--dump-dom")
    assert "undefinedFunction is not defined" in errors
    assert '"broken":[]'.replace('"', "&quot;") not in page


def test_it_prints(browser, report, tmp_path):
    pdf = tmp_path / "report.pdf"
    opened(browser, report, tmp_path, f"--print-to-pdf={pdf}")
    assert pdf.read_bytes().startswith(b"%PDF")
