"""Films: frames are what render draws, kept ones are not drawn again, animations hold all of them."""

import json
import os
import re
from concurrent.futures import CancelledError
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from time import sleep

import numpy as np
import pytest
from click import UsageError
from click.testing import CliRunner
from PIL import Image

from elvis import Camera, Dataset, ElvisError, Renderer, Scene, render, write
from elvis.core.shapes import Shape
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid
from elvis.plugins.command import workers
from elvis.plugins.command.command import elvis as group
from elvis.plugins.series.series import Series
from elvis.renderer.asking import series_range
from elvis.renderer.film import workers as film_workers
from elvis.renderer.film.animation import Film, orbited
from elvis.renderer.film.motions import Key
from elvis.renderer.frame.rendering import Pictures
from elvis.scene.cameras.view import fit_camera, named_camera
from elvis.scene.model.errors import AbsentError, SceneError

SIZE = ("--size", "8x6", "--plain")
FAST = (*SIZE, "--device", "reference")


def run(*arguments):
    outcome = CliRunner().invoke(group, [str(argument) for argument in arguments], standalone_mode=False)
    if outcome.exception:
        raise outcome.exception
    return outcome.output


def moving(time, points):
    return (1 + time) * points[:, 0] - time * points[:, 1] ** 2


@pytest.fixture
def files(tmp_path):
    mesh = grid(Shape.QUADRILATERAL, 1)
    for number, time in enumerate((0.0, 1.0, 3.0)):
        field = approximated(Dataset(mesh), "u", partial(moving, time), 3)
        write(Dataset(mesh, (field,), time), tmp_path / "m.xml", tmp_path / f"m_{number}.chk")
    for path in tmp_path.iterdir():
        os.utime(path, (1e9, 1e9))
    return [tmp_path / "m.xml", *(tmp_path / f"m_{number}.chk" for number in range(3))]


@pytest.fixture
def drawn(monkeypatch):
    """The scenes that were drawn, in place of pictures: one grey for each zoom."""
    scenes = []

    class Sketch:
        def __init__(self, scene):
            self.scene, self.stats = scene, {}

        def save(self, path, plain):
            Image.new("RGB", (int(9 + self.scene.zoom), 7), (int(40 * self.scene.zoom),) * 3).save(path)

    def draw(_, scene):
        scenes.append(scene)
        return Sketch(scene)

    monkeypatch.setattr("elvis.renderer.film.animation.Pictures.draw", draw)
    return scenes


def pictures(folder):
    return [path.read_bytes() for path in sorted(folder.glob("frame-*.png"))]


def test_the_next_step_is_read_while_one_is_drawn(files, drawn, monkeypatch):
    """By a thread of its own, once; a step that is requested out of turn is read all the same."""
    asked, at_moment = [], Series.at_moment
    monkeypatch.setattr(Series, "at_moment", lambda own, moment: asked.append(moment.step) or at_moment(own, moment))
    scene = Scene("u", data=tuple(map(str, files)), step=0, device="reference")
    steps = [replace(scene, step=step) for step in range(3)]
    with Film(scene, is_kept=False) as film:
        film.draw(steps[0], steps[1])
        film._next[1].result()
        assert asked == [0, 1]
        film.draw(steps[1])
        assert asked == [0, 1]
        film.draw(steps[0], steps[1])
        film.draw(steps[2])
    assert asked[:3] == [0, 1, 0]
    assert asked[-1] == 2
    assert [own.step for own in drawn] == [0, 1, 0, 2]


def test_each_step_is_read_once(files, tmp_path, drawn, monkeypatch):
    """The range of all steps reads each once before that.  Steps that can't be read are left out."""
    steps, whole = [], Series._read
    monkeypatch.setattr(Series, "_read", lambda own, step: steps.append(step.time) or whole(own, step))
    run("animate", *files, *FAST, "-o", tmp_path / "frames")
    assert steps == [0.0, 1.0, 3.0]
    run("animate", *files, *FAST, "--range", "series", "-o", tmp_path / "ranged")
    assert steps[3:] == 2 * [0.0, 1.0, 3.0]
    files[2].write_text(re.sub(r"(<ELEMENTS[^>]*>).{40}", r"\1", files[2].read_text()))
    run("animate", *files, *FAST, "--key", "zoom=1:3", "-o", tmp_path / "film.webp")
    assert [path.name for path in sorted((tmp_path / "film-frames").glob("*.png"))] == [
        "frame-00000.png",
        "frame-00002.png",
    ]
    with Image.open(tmp_path / "film.webp") as film:
        assert film.n_frames == 2
    for path in files[1:]:
        path.write_text(re.sub(r"(<ELEMENTS[^>]*>).{40}", r"\1", path.read_text()))
    with pytest.raises(ElvisError, match="expected a step that can be drawn, found none among 3"):
        run("animate", *files, *FAST, "-o", tmp_path / "none")


def still(files, path, **options):
    render(*files, size=(8, 6), plain=True, output=str(path), **options)
    return path.read_bytes()


def test_frames_are_stills_byte_for_byte(files, tmp_path):
    run("animate", *files, *SIZE, "--times", "0:3:3", "-o", tmp_path / "frames")
    found = pictures(tmp_path / "frames")
    assert found == [still(files, tmp_path / f"{t}.png", time=t) for t in (0.0, 1.5, 3.0)]
    assert len(set(found)) == 3
    # without --times they go from the first step to the last
    run("animate", *files, *SIZE, "--frames", "3", "-o", tmp_path / "frames")
    assert pictures(tmp_path / "frames") == found


def test_every_step_is_a_frame_of_an_animation_in_one_range(files, tmp_path):
    run("animate", *files, *FAST, "--range", "series", "-o", tmp_path / "film.webp")
    found = pictures(tmp_path / "film-frames")
    # u = (1 + t) x - t y^2 on the unit square: from -3 to 4 over all steps, which quadratic coefficients bound tightly
    tables = json.loads((tmp_path / "film-frames" / "film.json").read_text())["frames"]
    assert all(np.allclose(table["range"], (-3, 4), rtol=0, atol=1e-9) for table in tables)
    assert found[1] == still(files, tmp_path / "1.png", step=1, range="series", device="reference")
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.n_frames, film.size) == (3, (8, 6))
        for number, path in enumerate(sorted((tmp_path / "film-frames").glob("*.png"))):
            film.seek(number)
            assert np.array_equal(film.convert("RGB"), Image.open(path).convert("RGB"))


def test_cubic_frames_are_stills_in_a_range_over_derivatives(files, tmp_path):
    how = {"between": "cubic", "field": "d(u,t)", "range": "series"}
    options = [text for name, value in how.items() for text in (f"--{name}", value)]
    run("animate", *files, *FAST, *options, "--times", "0:3:3", "-o", tmp_path / "frames")
    found = pictures(tmp_path / "frames")
    assert found == [still(files, tmp_path / f"{t}.png", time=t, device="reference", **how) for t in (0.0, 1.5, 3.0)]
    table = json.loads((tmp_path / "frames" / "film.json").read_text())["frames"][0]
    assert np.allclose(table["range"], (-1, 1), rtol=0, atol=1e-9)  # of x - y^2, at all times


def test_a_range_over_all_steps_is_remembered(files, tmp_path, drawn, monkeypatch):
    """As long as the data are what they were."""
    searched, whole = [], series_range.range_over
    monkeypatch.setattr(series_range, "range_over", lambda *given: searched.append(given[0]) or whole(*given))

    def film(*more):
        run("animate", *files, "--range", "series", "-o", tmp_path / "frames", *more)
        return len(searched), drawn[-1].range

    first = film("--field", "u")
    (tmp_path / "frames" / "frame-00001.png").unlink()
    assert film("--field", "u") == (1, first[1])
    assert [scene.step for scene in drawn] == [0, 1, 2, 1]
    (tmp_path / "frames" / "frame-00001.png").unlink()
    assert film("--field", "2*u")[0] == 2
    os.utime(files[1], (2e9, 2e9))
    assert film("--field", "2*u")[0] == 3


def test_valid_frames_are_reused(files, tmp_path, drawn):
    folder = tmp_path / "frames"

    def steps(*more):
        drawn.clear()
        run("animate", *files, "-o", folder, *more)
        return [scene.step for scene in drawn]

    assert steps() == [0, 1, 2]
    assert steps() == []
    (folder / "frame-00001.png").unlink()  # as if it had been killed
    assert steps() == [1]
    assert steps("--zoom", "2") == [0, 1, 2]
    os.utime(files[2])
    assert steps("--zoom", "2") == [0, 1, 2]
    assert steps("--zoom", "2", "--times", "0:3:2") == [None, None]
    assert len(pictures(folder)) == 2
    (folder / "film.json").unlink()
    with pytest.raises(ElvisError, match=r"found frame-00000\.png without a complete film\.json"):
        steps()
    assert len(pictures(folder)) == 2


def test_steps_without_the_field_are_skipped(files, tmp_path, drawn):
    """Without --field that which comes first at first is shown; what no step has is rejected."""
    files[1].write_text(files[1].read_text().replace('FIELDS="u"', 'FIELDS="v"'))
    for more, left, lacking in ((("--field", "u"), [1, 2], "step 0"), ((), [0], "step 2")):
        drawn.clear()
        told = run("animate", *files, *more, "-o", tmp_path / f"frames{len(more)}")
        assert [scene.step for scene in drawn] == left
        assert f"{lacking} has no frame: " in told
    with pytest.raises(SceneError, match="there is no 'w'"):
        run("animate", *files, "--field", "w", "-o", tmp_path / "none")


def test_steps_in_which_nothing_is_visible_have_no_frame(files, tmp_path, monkeypatch, drawn):
    """As the first ones of a run, where an isosurface isn't there yet; of one state it is an error."""
    draw = Pictures.draw

    def later(pictures, scene):
        if scene.step != 2:
            raise AbsentError("values of an isosurface: 'u' lies between 0 and 1, found 2")
        return draw(pictures, scene)

    monkeypatch.setattr(Pictures, "draw", later)
    told = run("animate", *files, "-o", tmp_path / "frames")
    assert len(pictures(tmp_path / "frames")) == 1
    for step in (0, 1):
        assert f"step {step} has no frame: values of an isosurface: 'u' lies between 0 and 1, found 2" in told
    with pytest.raises(SceneError, match="values of an isosurface"):
        run("animate", *files[:2], "--key", "zoom=1:2", "--frames", "2", "-o", tmp_path / "still")
    with pytest.raises(ElvisError, match="expected a step that can be drawn, found none among 2"):
        run("animate", *files[:3], "-o", tmp_path / "none")
    assert [name for name in ("frames", "still", "none") if (tmp_path / name).exists()] == ["frames"]


def test_workers_draw_the_frames_that_are_missing(files, tmp_path, drawn):
    """Those of a scheduler in this very process; each tells what it found."""
    distributed = pytest.importorskip("distributed")
    scheduling = pytest.importorskip("distributed.scheduler")
    files[2].write_text(re.sub(r"(<ELEMENTS[^>]*>).{40}", r"\1", files[2].read_text()))
    os.utime(files[2], (1e9, 1e9))
    how = {"dashboard_address": None, "scheduler_kwargs": workers._STATUS}
    with distributed.LocalCluster(1, processes=False, threads_per_worker=1, **how) as cluster:
        arguments = ["animate", *files, "-o", tmp_path / "frames", "--scheduler", cluster.scheduler_address]
        assert run(*arguments).count("m_1.chk can't be read and is skipped") == 1
        assert sorted(scene.step for scene in drawn) == [0, 2]
        (tmp_path / "frames" / "frame-00002.png").unlink()
        run(*arguments)
        assert sorted(scene.step for scene in drawn) == [0, 2, 2]
    with pytest.raises(ElvisError, match=r"expected a Dask scheduler at nowhere, found none: "):
        run(*arguments[:-1], "nowhere")

    class Ended:
        def gather(self, _):
            raise scheduling.KilledWorker("draw_block", None, 0)

    class Gone:
        def gather(self, _):
            raise CancelledError

    with pytest.raises(ElvisError, match=r"a worker was killed, .*: frames stay"):
        workers.results(Ended(), [], "frames stay")
    with pytest.raises(ElvisError, match="the Dask scheduler is gone: frames stay"):
        workers.results(Gone(), [], "frames stay")


#: pieces of work that go on
GOING = []


def goes_on(number):
    """How many do at the end of one."""
    GOING.append(number)
    sleep(0.02)
    found = len(GOING)
    GOING.remove(number)
    return found


def test_a_worker_with_several_threads_does_one_thing_at_a_time():
    """It has one folder and one device: what threads drew at once was wrong."""
    distributed = pytest.importorskip("distributed")
    how = {"dashboard_address": None, "scheduler_kwargs": workers._STATUS}
    with (
        distributed.LocalCluster(1, processes=False, threads_per_worker=3, **how) as cluster,
        distributed.Client(cluster) as client,
    ):
        pieces = [(number,) for number in range(6)]
        assert workers.results(client, workers.begun(client, goes_on, pieces), "") == [1] * 6


@pytest.fixture
def asked(monkeypatch):
    """Two workers that are this process; what they are requested."""
    pytest.importorskip("distributed")
    asked = []

    class Done:
        status, done = "finished", lambda self: True

        def __init__(self, found):
            self.found = found

    class Here:
        def submit(self, into, folder, work, base, *piece, pure):
            asked.append((work.__name__, *map(len, piece[:-1])))
            return Done(into(folder, work, base, *piece))

        def gather(self, futures):
            return [future.found for future in futures]

        def run(self, work, *arguments):
            work(*arguments)

    monkeypatch.setattr(film_workers, "is_any_kept", lambda: True)
    monkeypatch.setattr(workers.Workers, "prepare", lambda self, module: None)
    monkeypatch.setattr(workers.Workers, "client", lambda self: nullcontext(Here()))
    return asked


@pytest.mark.parametrize("is_kept", [False, True])
def test_workers_find_the_camera_and_draw_ever_less_at_a_time(files, tmp_path, monkeypatch, asked, is_kept):
    """Where kernels are to be compiled, the first one that draws goes before all others."""
    # what finds the camera keeps its kernels, of which there are more
    answers = iter([is_kept, True, True])
    monkeypatch.setattr(film_workers, "is_any_kept", lambda: next(answers))
    arguments = ["animate", *files[:2], *FAST, "--camera", "iso", "--orbit", "40", "--frames", "9"]
    run(*arguments, "--workers", "2", "-o", tmp_path / "two")
    assert not film_workers._OPEN
    run(*arguments, "-o", tmp_path / "one")
    assert pictures(tmp_path / "two") == pictures(tmp_path / "one")
    sizes = [2, *[1] * 7] if is_kept else [1, 2, *[1] * 6]
    assert asked == [("camera_of_first", 9)] * (1 + is_kept) + [("draw_block", size) for size in sizes]


@pytest.mark.parametrize("moves", [("--orbit", "40"), ("--key", "zoom=1:2")])
def test_only_workers_read_data(files, tmp_path, monkeypatch, asked, drawn, moves):
    readers, show = [], Film._show
    monkeypatch.setattr(Film, "_show", lambda film, data, moment: readers.append(film) or show(film, data, moment))
    camera = ("--camera", "2,2,2:0.5,0.5,0:0,0,1:30")
    run("animate", *files[:2], *FAST, *camera, *moves, "--frames", "4", "--workers", "2", "-o", tmp_path / "frames")
    assert asked[:2] == [("open_film",)] * 2
    assert len(readers) == 1
    files[1].write_text(re.sub(r"(<ELEMENTS[^>]*>).{40}", r"\1", files[1].read_text()))
    with pytest.raises(ElvisError, match=r"m_0\.chk"):
        run("animate", *files[:2], *FAST, *camera, *moves, "--frames", "4", "--workers", "2", "-o", tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_the_first_camera_is_found_without_a_picture(files, monkeypatch):
    scene = Scene("u", data=tuple(map(str, files[:2])), camera="iso", size=(40, 30))
    with Film(scene, is_kept=False) as film:
        camera = film.draw(scene).view.camera
    monkeypatch.setattr(Renderer, "render", None)
    with Film(scene, is_kept=False) as film:
        assert film.first_camera([scene]) == camera


def test_blocks_of_frames_get_smaller():
    blocks = [*film_workers.blocks(range(200), 2)]
    assert [len(block) for block in blocks[:5]] == [50, 37, 28, 21, 16]
    assert [number for block in blocks for number in block] == [*range(200)]
    assert len(blocks[-1]) == 1
    assert [*film_workers.blocks([], 2)] == []


def test_keys_of_the_scene_move(files, tmp_path, drawn):
    run("animate", *files[:2], "--key", "zoom=1:3:1", "--frames", "5", "-o", tmp_path / "zoomed.webp")
    assert [scene.zoom for scene in drawn] == [1.0, 2.0, 3.0, 2.0, 1.0]
    with Image.open(tmp_path / "zoomed.webp") as film:
        assert (film.n_frames, film.size) == (5, (12, 7))
    key = Key.of("camera.eye", "[0,0,1]:[2,4,1]")
    assert json.loads(key.at(0.25)[1]) == [0.5, 1.0, 1.0]
    for text in ("1", "a:b", "1:[1,2]", "0:inf"):
        with pytest.raises(SceneError, match="--key zoom: expected two or more numbers with colons between them"):
            Key.of("zoom", text)
    with pytest.raises(SceneError, match=r"--key objects\[3\]\.style\.opacity: the scene has no such key"):
        run("animate", *files[:2], "--key", "objects[3].style.opacity=0:1", "-o", tmp_path / "none")


def test_the_camera_traverses_the_whole_path(files, tmp_path):
    path = ["--path", "iso", "--path", "2,2,2:0.5,0.5,0:0,0,1:30", "--camera", "iso"]
    with pytest.raises(SceneError, match="all in perspective, or none"):
        run("animate", *files[:2], *FAST, *path, "-o", tmp_path / "none")
    path = ["--path", "iso", "--path", "top", "--path", "iso"]
    run("animate", *files[:2], *FAST, *path, "--frames", "5", "-o", tmp_path / "frames")
    found = pictures(tmp_path / "frames")
    assert found[0] == found[4] != found[1]
    cameras = [one["camera"] for one in json.loads((tmp_path / "frames" / "film.json").read_text())["frames"]]
    assert cameras[1]["eye"] == pytest.approx(cameras[3]["eye"], abs=1e-12)
    with pytest.raises(UsageError, match="expected --orbit or --path, found both"):
        run("animate", *files[:2], *FAST, *path, "--orbit", "90", "-o", tmp_path / "none")


def test_orbits_rotate_the_eye_about_the_up_direction():
    camera = Camera((3.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    assert np.allclose(orbited(camera, 90).eye, (1.0, 2.0, 1.0), rtol=0, atol=1e-15)
    assert np.allclose(orbited(camera, 360).eye, camera.eye, rtol=0, atol=1e-15)
    assert orbited(camera, 40).at == camera.at


@pytest.mark.parametrize(("view", "level"), [("iso", -(3**-0.5)), ("left", 0.0)])
def test_orbits_of_fitted_views_stay_level(view, level):
    box = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    camera = fit_camera(named_camera(view, None), (40, 30), box[:, :2], box)
    seen = [orbited(camera, angle).basis()[2][2] for angle in (0, 50, 180)]
    assert np.allclose(seen, level, rtol=0, atol=1e-12)
