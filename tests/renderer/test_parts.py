"""Pictures of data in parts are those of the whole, to the byte, however the data are cut."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import write
from elvis.core.data.dataset import Dataset
from elvis.core.portions import Portion, along_curve, portions, unite
from elvis.core.portions.portion import is_even
from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved, ripple
from elvis.core.testing.fields import approximated, with_field
from elvis.core.testing.meshes import grid, mixed_volume
from elvis.core.testing.played_ranks import played
from elvis.formats.nektar.dataset_parts import DatasetParts
from elvis.formats.reading import read_parts
from elvis.plugins.command.command import elvis
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.asking.completing import completed
from elvis.renderer.device import persistence
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.parts.bricks import Bricks, InMemory
from elvis.renderer.parts.parts import RankPart, drawable, is_local, what_matters
from elvis.scene import (
    Camera,
    Clip,
    Cone,
    Contours,
    CutSurface,
    Faces,
    Implicit,
    Isosurface,
    MeshLines,
    Plane,
    Scene,
    Sphere,
    Style,
    Transfer,
    VolumeRendering,
)
from elvis.scene.model.errors import SceneError
from elvis.scene.model.quantities import quantities

try:
    import pymetis
except ImportError:
    pymetis = None

#: what is fitted to the data takes a preview at them: that of some scenes alone
GIVEN = Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.8)
LINES = Style(contours=Contours(count=6), mesh_lines=MeshLines())
TILTED = Plane((0.5, 0.45, 0.52), (0.3, 0.2, 1.0))
UPRIGHT = Plane((0.5, 0.45, 0.52), (1.0, 0.1, 0.0))
SCENES = {
    "plane": Scene(plane=TILTED),
    "plane with lines": Scene(objects=(CutSurface(TILTED, LINES),), camera="iso"),
    "faces with lines": Scene(objects=(Faces(("all",), LINES),), camera="iso"),
    "inner faces": Scene(objects=(Faces(("inner",), Style(opacity=0.4)),), camera=GIVEN),
    "one element's faces": Scene(objects=(Faces(("element:40", "element:7")),), camera="iso"),
    "isosurface": Scene(objects=(Isosurface((0.35,)),), camera="iso"),
    "isosurface with lines": Scene(
        objects=(Isosurface((0.35,), style=Style(quantity="x", contours=Contours((0.3, 0.6)))),), camera=GIVEN
    ),
    "isosurface of an expression": Scene(objects=(Isosurface((0.6,), "u*u + x"),), camera="-x"),
    "clear surfaces": Scene(
        objects=(Isosurface((0.2, 0.5), style=Style(opacity=0.5)), Faces(("all",), Style(opacity=0.3))), camera=GIVEN
    ),
    "clipped": Scene(objects=(Faces(), CutSurface(UPRIGHT)), clip=(Clip(UPRIGHT),), camera=GIVEN),
    "sphere": Scene(objects=(CutSurface(Sphere((0.5, 0.5, 0.5), 0.3)),), camera="iso", range="all", box=True),
    "cone": Scene(objects=(CutSurface(Cone((0.4, 0.5, 0.1), (0.2, 0.1, 1.0), 25.0)),), camera="iso", box=True),
    "implicit": Scene(objects=(CutSurface(Implicit("x + 0.3*y*y - 0.6")),), range="all", camera=GIVEN),
    "volume": Scene(objects=(VolumeRendering(Transfer((0.0, 1.0), (0.0, 3.0))),), camera=GIVEN),
}


def function(points):
    x, y, z = points.T
    return 0.5 + 0.5 * np.sin(2.0 * x + y) * np.cos(3.0 * z - x)


@pytest.fixture(scope="module")
def bent():
    """162 curved tetrahedra with a cubic field, and another one of mixed orders."""
    return with_field(curved(grid(Shape.TETRAHEDRON, 3), ripple(0.05), 3), function, 4)


@pytest.fixture(scope="module")
def mixed():
    """All shapes, straight and curved, with fields of order 2 and 4."""
    whole = with_field(curved(mixed_volume(1), ripple(0.05), 3), lambda points: function(points / 3.0), 5)
    low = approximated(whole, "u", lambda points: function(points / 3.0), 3)
    (prisms,) = (block for block in low.blocks if block.expansion.shape is Shape.PRISM)
    blocks = [prisms if block.expansion.shape is Shape.PRISM else block for block in whole["u"].blocks]
    return Dataset(whole.mesh, (replace(low, blocks=tuple(blocks)),))


def cuts(dataset):
    """Partitions: compact, at random, like combs."""
    ids = np.concatenate([entities.ids for entities in dataset.mesh.elements.values()])
    mixed_up = np.random.default_rng(0).permutation(ids)
    return [
        metis(dataset, 8),
        along_curve(dataset, 3),
        [np.sort(some) for some in np.array_split(mixed_up, 2)],
        [np.sort(ids)[start::3] for start in range(3)],
    ]


def metis(dataset, count):
    """A partition by METIS, of the graph of elements that have sides in common; along a curve where it isn't there."""
    if pymetis is None:
        return along_curve(dataset, count)
    elements = dataset.mesh.elements.values()
    sides = [sides for entities in elements for sides in entities.members.tolist()]
    part = np.array(pymetis.part_mesh(count, sides, gtype=pymetis.GType.DUAL).element_part)
    ids = np.concatenate([entities.ids for entities in elements])
    return [np.sort(ids[part == number]) for number in range(count)]


def in_parts(dataset, scene, parts):
    """The elements of a dataset that a scene depends on, found part by part."""
    if not is_local(dataset, is_even(dataset), [scene]):
        return dataset
    whole = Portion.whole(dataset)
    return drawable(unite([what_matters(whole.of(ids), [scene]) for ids in parts]))


def written(renderer, dataset, scene, folder):
    """The bytes of a picture and of its record, what is told of pixels, and how many elements were drawn."""
    whole = completed(dataset, scene)
    renderer.load(dataset, *quantities(whole))
    frame = renderer.render(whole)
    for name in ("a.png", "a.npz"):
        frame.save(folder / name)
    told = frame.counts(), frame.remarks, frame.stats["elements"], frame.stats.get("contours")
    return (folder / "a.png").read_bytes(), (folder / "a.npz").read_bytes(), told


@pytest.mark.sampled(least=2, free=("name",))
@pytest.mark.parametrize("name", SCENES)
def test_pictures_of_parts_match_those_of_the_whole(renderer, bent, name, tmp_path):
    scene = replace(SCENES[name], field="u", size=(96, 72))
    drawn = renderer("vulkan")
    expected = written(drawn, bent, scene, tmp_path)
    for parts in cuts(bent):
        assert written(drawn, in_parts(bent, scene, parts), scene, tmp_path) == expected
    assert expected[2][0]["certain"] > 200


@pytest.mark.sampled(least=3, free=("name",))
@pytest.mark.parametrize("name", [*(name for name in SCENES if name != "plane"), "clipped volume"])
def test_pictures_in_bands_match_whole_pictures(renderer, bent, name, tmp_path, monkeypatch):
    """To the last bit, of two and six bands of rows; a plane alone is drawn in another way."""
    ball = Clip(Sphere((0.5, 0.5, 0.6), 0.3))
    volume = (*SCENES["volume"].objects, CutSurface(UPRIGHT, Style(opacity=0.5)))
    scene = SCENES.get(name, Scene(objects=volume, clip=(ball,), camera=GIVEN))
    scene = replace(scene, field="u", size=(32, 24), samples=1 + (name == "clipped"), stats="counts.json")
    drawn = renderer("vulkan")
    expected = written(drawn, bent, scene, tmp_path)
    for rows in (14, 4):
        monkeypatch.setattr(persistence, "BAND", 32 * rows)
        assert written(drawn, bent, scene, tmp_path) == expected


def noted(frame, folder):
    """The bytes of a frame's picture and record, and what is told of pixels."""
    for name in ("a.png", "a.npz"):
        frame.save(folder / name)
    told = (
        frame.counts(),
        frame.remarks,
        frame.stats["elements"],
        frame.stats.get("contours"),
        frame.stats.get("volume"),
    )
    return (folder / "a.png").read_bytes(), (folder / "a.npz").read_bytes(), told


def by_one_process(dataset, scene, folder):
    """What one process makes of all."""
    with Pictures(dataset, "vulkan") as pictures:
        return noted(pictures.draw(scene), folder)


def by_ranks(dataset, scene, parts, folder):
    """What ranks make of a scene, each of which has a part; and how many elements each draws of."""

    def draw(ranks):
        own = RankPart(what_matters(portions(dataset, parts)[ranks.rank], [scene]), ranks, {}, dataset.mesh.corners)
        with Pictures(own, "vulkan", ranks=ranks) as pictures:
            frame = pictures.draw(scene)
            return frame, sum(map(len, pictures._renderer.stages.volume.parts))

    drawn = played(len(parts), draw)
    return noted(drawn[0][0], folder), [count for _, count in drawn]


INSIDE = Camera((0.5, 0.5, 0.5), (1.0, 0.9, 0.7), (0.0, 0.0, 1.0), fov=70.0)
NEAR = Camera((-0.3, -0.4, 0.8), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), fov=50.0)
HAZE = VolumeRendering(Transfer((0.0, 0.5, 1.0), (0.0, 3.0, 1.0)))
BALL = Clip(Sphere((0.5, 0.5, 0.6), 0.3))
OF_RANKS = SCENES | {
    "volume from inside": Scene(objects=(HAZE,), camera=INSIDE),
    "volume with a plane": Scene(objects=(HAZE, CutSurface(TILTED, Style(opacity=0.5))), camera=NEAR, clip=(BALL,)),
    "volume of all": Scene(objects=(HAZE,), camera="iso", range="all", clip=(Clip(Implicit("x + 0.3*y*y - 0.6")),)),
}


@pytest.mark.sampled(least=2, free=("name", "cut"))
@pytest.mark.parametrize("cut", range(4))
@pytest.mark.parametrize("name", OF_RANKS)
def test_pictures_of_ranks_match_those_of_one_process(bent, name, cut, tmp_path):
    """Of two, three and eight ranks, whose parts are compact, at random or like combs."""
    scene = replace(OF_RANKS[name], field="u", size=(24, 150), stats="counts.json")
    expected = by_one_process(bent, scene, tmp_path)
    assert by_ranks(bent, scene, cuts(bent)[cut], tmp_path)[0] == expected


@pytest.mark.parametrize("name", ["volume", "isosurface"])
def test_ranks_draw_the_elements_of_their_rows(name, tmp_path):
    """Of straight ones, of which there are many; boxes of neighbours reach in."""
    dataset = with_field(grid(Shape.TETRAHEDRON, 5), function, 2)
    scene = replace(SCENES[name], field="u", size=(96, 480), camera="-x", domain_outline=False)
    drawn, counts = by_ranks(dataset, scene, along_curve(dataset, 5), tmp_path)
    assert drawn == by_one_process(dataset, scene, tmp_path)
    assert max(counts) < 0.65 * len(dataset.mesh.of(Shape.TETRAHEDRON))


@pytest.mark.thorough
def test_figures_of_ranks_match_those_of_one_process(bent, tmp_path):
    """Lines that are curves go on from one rank's rows to the next one's."""
    surfaces = Faces(("all",), replace(LINES, opacity=0.6)), Isosurface((0.35,), style=LINES)
    scene = Scene(field="u", objects=surfaces, camera=GIVEN, size=(48, 60), outline=True, outputs=("a.svg",))
    parts = along_curve(bent, 2)

    def figure(ranks):
        own = RankPart(what_matters(portions(bent, parts)[ranks.rank], [scene]), ranks, {}, bent.mesh.corners)
        with Pictures(own, "vulkan", ranks=ranks) as pictures:
            return pictures.draw(scene)

    with Pictures(bent, "vulkan") as pictures:
        alone = pictures.draw(scene)
    first, *_ = played(2, figure)
    for name in ("a.svg", "a.png"):
        alone.save(tmp_path / name)
        first.save(tmp_path / f"ranks-{name}")
        assert (tmp_path / name).read_bytes() == (tmp_path / f"ranks-{name}").read_bytes()
    assert (tmp_path / "a.svg").read_text().count("<path") > 50


def test_counts_cover_all_ranks(tmp_path):
    """Elements without numbers, and inverted ones, are told of though few ranks draw them."""
    dataset = with_field(grid(Shape.TETRAHEDRON, 4), function, 2)
    (block,) = dataset["u"].blocks
    coefficients = block.coefficients.copy()
    coefficients[[3, 200]] = np.nan
    wrong = replace(block, coefficients=coefficients)
    dataset = Dataset(dataset.mesh, (replace(dataset["u"], blocks=(wrong,)),))
    scene = Scene(field="u", objects=(HAZE, Isosurface((0.6,))), camera="-x", size=(48, 240), range=(0.0, 1.0))
    expected = by_one_process(dataset, scene, tmp_path)
    assert by_ranks(dataset, scene, along_curve(dataset, 4), tmp_path)[0] == expected
    assert any("not a number: 2" in remark for remark in expected[2][1])


@pytest.mark.thorough
def test_pictures_of_all_shapes_and_orders(renderer, mixed, tmp_path):
    objects = Faces(("all",), Style(opacity=0.5)), Isosurface((0.6,))
    camera = Camera((4.5, -3.0, 2.6), (1.5, 0.3, 0.5), (0.0, 0.0, 1.0), height=2.6)
    scene = Scene(field="u", objects=objects, camera=camera, size=(96, 72))
    drawn = renderer("vulkan")
    expected = written(drawn, mixed, scene, tmp_path)
    assert all(written(drawn, in_parts(mixed, scene, own), scene, tmp_path) == expected for own in cuts(mixed)[2:])


def test_pictures_in_bricks_match_whole_pictures(renderer, bent, tmp_path):
    scene = Scene(field="u", plane=TILTED, size=(96, 72))
    expected = written(renderer("vulkan"), bent, scene, tmp_path)[:2]
    whole = 4 * Portion.whole(bent).bytes
    with Pictures(bent) as pictures:
        for memory in (0.72 * whole, 0.9 * whole):
            frame = pictures.draw(replace(scene, memory=float(memory), outputs=("a.npz",)))
            frame = replace(frame, scene=scene)
            for name in ("a.png", "a.npz"):
                frame.save(tmp_path / name)
            assert ((tmp_path / "a.png").read_bytes(), (tmp_path / "a.npz").read_bytes()) == expected
        with pytest.raises(SceneError, match=r"^memory: expected at least [\d.]+ [KM]iB .*, found 500 bytes$"):
            pictures.draw(replace(scene, memory=500.0))


def test_bricks_of_files_match_the_whole(bent, tmp_path, monkeypatch):
    """One is read after the other, the whole never; where all elements count nothing is found."""
    files = write(bent, tmp_path / "a.xml", mesh_format="hdf5", field_format="hdf5")
    read = [path for path in files if path.suffix != ".nekg"]
    names = [str(path) for path in read]
    whole = 4 * Portion.whole(bent).bytes
    command = ["render", *names, "--size", "96x72", "--plane", "0.5,0.45,0.52:0.3,0.2,1", "--overwrite"]
    expected = drawn_by_command(command, tmp_path)
    parts = read_parts(*read)
    assert 4 * parts.bytes == whole
    asked = bricks_asked_for(monkeypatch)
    monkeypatch.setattr("elvis.plugins.data.data.dataset_of", None)
    command += ["--memory", str(int(0.72 * whole))]
    assert drawn_by_command(command, tmp_path, "memory: the process took up to") == expected
    assert [chosen.sum() for chosen in asked] == [1, 1, 1, 1]
    assert (asked[1] ^ asked[2] ^ asked[3]).all()


def bricks_asked_for(monkeypatch):
    """Which bricks files and datasets in memory are requested, each time."""
    asked = []
    for source in (DatasetParts, InMemory):
        of = source.of
        monkeypatch.setattr(source, "of", lambda own, chosen, of=of: asked.append(chosen) or of(own, chosen))
    return asked


def seen_from(angle):
    """A camera that is given whole, as those of animations that go round."""
    eye = (0.5 + 3.0 * np.cos(angle), 0.5 + 3.0 * np.sin(angle), 1.5)
    return Camera(eye, (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.6)


NEXT = {
    "planes": [Scene(plane=replace(TILTED, point=(0.5, 0.45, z)), range="all") for z in (0.52, 0.2)],
    "cuts with faces that a word chooses": [
        Scene(objects=(CutSurface(replace(UPRIGHT, point=(x, 0.5, 0.5)), LINES), Faces(("element:40",))), camera="iso")
        for x in (0.3, 0.9)
    ],
    "cameras": [Scene(objects=(Faces(("all",), LINES),), camera=seen_from(angle)) for angle in (0.2, 1.7)],
    "values": [Scene(objects=(Isosurface((value,), style=LINES),), camera="iso", box=True) for value in (0.35, 0.8)],
    "times": [Scene(objects=(CutSurface(Implicit("x + t - 0.5")),), camera="-x", time=time) for time in (0.1, -0.3)],
}


@pytest.mark.sampled(least=3, free=("name",))
@pytest.mark.parametrize("name", NEXT)
def test_next_pictures_read_the_bricks_that_they_need(bent, name, tmp_path, monkeypatch):
    monkeypatch.setattr("elvis.renderer.parts.bricks.ELEMENTS", 4)
    asked, memory = bricks_asked_for(monkeypatch), 3.9 * Portion.whole(bent).bytes
    scenes = [replace(scene, field="u", size=(96, 72)) for scene in NEXT[name]]
    read = []
    with Pictures(bent) as whole, Pictures(Bricks(InMemory(bent), lambda: bent)) as pictures:
        for scene in scenes:
            del asked[:]
            frame = pictures.draw(replace(scene, memory=memory, outputs=("a.npz",)))
            read.append(sum(int(chosen.sum()) for chosen in asked))
            frame = replace(frame, scene=replace(frame.scene, memory=None, outputs=()))
            for folder, drawn in (("a", frame), ("b", whole.draw(scene))):
                (tmp_path / folder).mkdir(exist_ok=True)
                drawn.save(tmp_path / folder / "picture.png")
                drawn.save(tmp_path / folder / "picture.npz")
            for kind in ("png", "npz"):
                own, wanted = (tmp_path / folder / f"picture.{kind}" for folder in "ab")
                assert own.read_bytes() == wanted.read_bytes()
    assert read[0] >= 40
    assert read[1] >= 40 if name == "times" else read[1] < 0.9 * read[0]
    assert bool(read[1]) == (name != "cameras")


def drawn_by_command(command, folder, told=""):
    """The bytes of a picture and of its record; the command prints what is ``told``."""
    names = [folder / name for name in ("b.png", "b.npz")]
    outputs = [text for name in names for text in ("-o", str(name))]
    result = CliRunner().invoke(elvis, [*command, *outputs], standalone_mode=False)
    assert result.exit_code == 0, result.exception
    assert told in result.stderr
    return [name.read_bytes() for name in names]


def test_a_cut_requests_few_elements(bent):
    scene = Scene(field="u", plane=TILTED, size=(96, 72))
    count = sum(map(len, in_parts(bent, scene, along_curve(bent, 2)).mesh.elements.values()))
    assert count < 100


@pytest.mark.parametrize("shape", Shape)
def test_portions_are_united_to_the_whole(shape):
    dataset = with_field(grid(shape, 3), lambda points: points[:, 0], 3)
    if shape.dimension > 1:
        dataset = with_field(curved(grid(shape, 3), ripple(0.05), 3), lambda points: points[:, 0], 3)
    for parts in cuts(dataset)[1:]:
        united = unite(portions(dataset, parts[::-1])).dataset
        assert united.mesh.vertices.tobytes() == dataset.mesh.vertices.tobytes()
        assert united.mesh.edge_curves.points.tobytes() == dataset.mesh.edge_curves.points.tobytes()
        assert united.mesh.face_curves.points.tobytes() == dataset.mesh.face_curves.points.tobytes()
        for kind, entities in dataset.mesh.entities.items():
            assert np.array_equal(united.mesh.of(kind).members, entities.members)
        assert united["u"].blocks[0].coefficients.tobytes() == dataset["u"].blocks[0].coefficients.tobytes()


def test_faces_between_parts_are_inner_faces():
    dataset = with_field(grid(Shape.HEXAHEDRON, 2), lambda points: points[:, 0], 2)
    outer = []
    for part in portions(dataset, along_curve(dataset, 8)):
        own = drawable(part)
        outer.append(len(faces_of(own, volume_of(own, ["u"])).select(("all",))[0]))
    assert outer == [3] * 8


@pytest.fixture(scope="module")
def files(bent, tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    write(bent, folder / "bent.xml", folder / "bent.fld")
    (folder / "damaged.fld").write_text("no field")
    return folder


VIEW = "2.9,-2.1,1.9:0.5,0.5,0.5:0,0,1:40"


@pytest.mark.thorough
def test_ranks_write_the_files_of_one_process(files, started, monkeypatch):
    arguments = ("render", "bent.xml", "bent.fld", "--faces", "all", "--camera", VIEW, "--size", "96x72")
    monkeypatch.chdir(files)
    alone = CliRunner().invoke(elvis, [*arguments, "-o", "1.png", "-o", "1.npz"], standalone_mode=False)
    ranks = started.ranks(files, (2, *arguments, "-o", "2.png", "-o", "2.npz"))
    assert (alone.exception, ranks.returncode, ranks.stderr) == (None, 0, alone.stderr)
    for suffix in ("png", "npz"):
        assert (files / f"2.{suffix}").read_bytes() == (files / f"1.{suffix}").read_bytes()


def test_ranks_with_different_pictures_are_reported(files, started):
    one, other = (
        ["render", "bent.xml", "bent.fld", "--faces", "all", "-o", name] for name in ("none1.png", "none2.png")
    )
    ranks = started.ranks(files, (1, *one), (1, *other))
    assert ranks.returncode == 1
    assert ranks.stderr.startswith("elvis: error: part 2 of 2: expected the data and the task of part 1, found others")
    assert not [path for path in files.iterdir() if "none" in path.name]


@pytest.mark.thorough
def test_child_processes_of_a_rank_draw_separate_pictures(files, started):
    shown = ["--faces", "all", "--size", "96x72", "--camera", VIEW]
    render = [*started.elvis, "render", "bent.xml", "bent.fld", *shown, "-o", "own.png"]
    starts = f"import subprocess, sys; sys.exit(subprocess.run({render!r}).returncode)"
    ranks = started.processes(files, (1, sys.executable, "-c", starts), (1, sys.executable, "-c", ""))
    assert (ranks.returncode, ranks.stderr) == (0, "")
    assert (files / "own.png").exists()


def test_a_rank_that_fails_names_its_part_and_its_reason(files, started):
    good, bad = (("render", "bent.xml", field, "-o", "none.png") for field in ("bent.fld", "damaged.fld"))
    ranks = started.ranks(files, (1, *good), (1, *bad))
    assert ranks.returncode == 1
    (sentence,) = ranks.stderr.splitlines()
    assert sentence.startswith("elvis: error: part 2 of 2: damaged.fld is another file there than at part 1")
    assert not [path for path in files.iterdir() if "none" in path.name]
