"""Pictures of a running solver: those of its data afterwards, at the steps that are requested, and no harm to it."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from elvis import (
    CutSurface,
    Dataset,
    ElvisError,
    Faces,
    FormatError,
    Implicit,
    Plane,
    Session,
    from_arrays,
    render,
    sample,
)
from elvis.core.mapping.geometry import geometry, share
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import Shape
from elvis.core.testing.fields import with_field
from elvis.core.testing.meshes import grid
from elvis.plugins.conversion.nodal import tensor_nodes
from elvis.plugins.data.run_states import states_of
from elvis.renderer.frame import renderer as renderer_module
from elvis.renderer.frame import rendering
from elvis.renderer.insitu.triggers import Condition, Trigger
from elvis.renderer.passes.faces import faces
from elvis.scene.model.errors import SceneError

NODES = np.asarray(tensor_nodes(Shape.QUADRILATERAL, tuple(lobatto(4)[0].tolist())))


def squares(bend=0.1):
    """(4, 16, 2) places of nodes of four curved squares."""
    corners = np.array([(i, j) for j in range(2) for i in range(2)], float)
    places = corners[:, None] + (NODES + 1) / 2
    places[..., 1] += bend * places[..., 0] * (2 - places[..., 0]) * (places[..., 1] - 1)
    return places


def values(places, time):
    return places[..., 0] ** 2 * (1 + time) - places[..., 1]


@pytest.fixture
def session(tmp_path):
    def make(mesh, **keywords):
        settings = {"size": (20, 20), "device": "reference", "output": str(tmp_path / "u_{step:03}.png")}
        return Session(mesh, **{"field": "u", **settings, **keywords})

    return make


class TestPictures:
    def test_the_last_step_matches_render(self, session, tmp_path):
        places = squares()
        with session({"quadrilateral": places}, device="auto", contours=3) as drawn:
            for step in range(3):
                assert drawn.show(step, 0.1 * step, {"u": values(places, 0.1 * step)}) is not None, drawn.faults
        render(
            from_arrays({"quadrilateral": places}, u=values(places, 0.2)),
            "u",
            size=(20, 20),
            contours=3,
            output=str(tmp_path / "post.png"),
        )
        assert (tmp_path / "u_002.png").read_bytes() == (tmp_path / "post.png").read_bytes()
        assert (tmp_path / "u_000.png").read_bytes() != (tmp_path / "post.png").read_bytes()

    def test_nan_values_are_reported_once(self, session):
        places = squares()
        drawn = session({"quadrilateral": places}, output=None)
        for step in range(3):
            u = values(places, 0.5)
            u[0, 0] = np.inf if step else np.nan
            assert drawn.show(step, 0.0, {"u": u}) is not None
        assert len(drawn.faults) == 1
        assert drawn.faults[0].startswith("field 'u': expected finite numbers, found NaN or infinity in ")

    def test_only_the_first_rank_has_a_session(self, session, monkeypatch):
        monkeypatch.setenv("PMI_SIZE", "2")
        monkeypatch.setenv("PMI_RANK", "1")
        with pytest.raises(ElvisError, match="but this is rank 1: gather mesh and arrays on rank 0"):
            session({"quadrilateral": squares()})

    @pytest.mark.own_devices  # what others have left on a device comes and goes
    def test_steady_steps_make_no_buffer(self, session):
        places = squares()
        with session({"quadrilateral": places}, device="auto", output=None, range=(0, 1)) as drawn:
            made = []
            for step in range(4):
                drawn.show(step, 0.0, {"u": values(places, step)})
                made.append(drawn._pictures.buffers_made)
        assert made[1] == made[3]

    def test_names_have_step_and_time(self, session, tmp_path):
        places = squares()
        drawn = session({"quadrilateral": places}, output=str(tmp_path / "{time:.2f}_{step}.png"))
        drawn.show(7, 0.5, {"u": values(places, 0.5)})
        assert [path.name for path in tmp_path.iterdir()] == ["0.50_7.png"]


def bubbles():
    """(2, 27, 3) places of nodes of two hexahedra that are curved inside, which no mesh file can hold."""
    nodes = np.asarray(tensor_nodes(Shape.HEXAHEDRON, tuple(lobatto(3)[0].tolist())))
    places = np.array([(0, 0, 0), (1, 0, 0)], float)[:, None] + (nodes + 1) / 2
    places[..., 0] += 0.1 * np.prod(1 - nodes**2, axis=1)
    return places


class TestNeeded:
    """Of later steps no field is converted that neither picture nor condition needs."""

    @pytest.mark.parametrize(
        ("keywords", "names"),
        [
            ({"field": "u"}, ["u"]),
            ({"field": ""}, ["u"]),
            ({"field": "x"}, ["u"]),
            ({"field": "u*w"}, ["u", "w"]),
            ({"field": "d(w,x)", "when": "max(q) > -1"}, ["w", "q"]),
            ({"field": "u", "lic": {"velocity": "w,q"}}, ["u", "w", "q"]),
        ],
    )
    def test_fields(self, session, tmp_path, monkeypatch, keywords, names):
        places, shown = squares(), []

        def fields(step):
            # of u, which is linear, other fields must not change the modes
            return {
                "u": 1 + places[..., 0] * step,
                "w": values(places, step),
                "q": places[..., 0] ** 3,
                "o": places[..., 1],
            }

        show = rendering.Pictures.show
        monkeypatch.setattr(rendering.Pictures, "show", lambda own, data: shown.append(data) or show(own, data))
        with session({"quadrilateral": places}, **keywords) as drawn:
            for step in range(3):
                assert drawn.show(step, 0.0, fields(step)) is not None, drawn.faults
        assert [list(data) for data in shown] == [names, names]
        whole = from_arrays({"quadrilateral": places}, fields(2))
        for name in names:
            for own, wanted in zip(shown[-1][name].blocks, whole[name].blocks, strict=True):
                assert own.expansion == wanted.expansion
                assert (own.coefficients == wanted.coefficients).all()
        keywords.pop("when", None)
        post = str(tmp_path / "post.png")
        render(whole, **{"size": (20, 20), "device": "reference", "output": post, **keywords})
        assert (tmp_path / "u_002.png").read_bytes() == (tmp_path / "post.png").read_bytes()

    def test_a_name_that_comes_later(self, session):
        places = squares()
        drawn = session({"quadrilateral": places}, field="u*w", output=None)
        assert drawn.show(0, 0.0, {"u": values(places, 0)}) is None
        assert drawn.show(1, 0.0, {"u": values(places, 0), "w": values(places, 1)}) is not None


class TestKept:
    """What values have no part in is found once, and pictures are those of data that share nothing."""

    @pytest.mark.parametrize(
        ("objects", "views"),
        [
            ((Faces(),), 1),
            ((CutSurface(Plane((0.9, 0.4, 0.4), (1, 2, 3))),), 1),
            ((CutSurface(Implicit("u - 0.9")),), 3),
        ],
    )
    def test_the_view_and_visible_faces(self, session, tmp_path, monkeypatch, objects, views):
        places, made, seen = bubbles(), [], []
        fit, look = renderer_module.automatic, faces.face_patches
        monkeypatch.setattr(renderer_module, "automatic", lambda *given: made.append(1) or fit(*given))
        monkeypatch.setattr(faces, "face_patches", lambda *given: seen.append(1) or look(*given))
        before = []
        with session({"hexahedron": places}, device="auto", objects=objects) as drawn:
            for step in range(3):
                before.append(len(seen))
                u = places.sum(axis=2) ** (1 + step)
                u[0] = np.nan if step == 1 else u[0]
                assert drawn.show(step, 0.0, {"u": u}) is not None, drawn.faults
        assert len(made) == views
        assert views > 1 or before[1:] == [len(seen)] * 2
        monkeypatch.undo()
        dataset = from_arrays({"hexahedron": places}, u=u)
        assert dataset.map_names
        render(dataset, "u", size=(20, 20), objects=objects, output=str(tmp_path / "post.png"))
        assert (tmp_path / "u_002.png").read_bytes() == (tmp_path / "post.png").read_bytes()

    def test_maps_that_are_fields(self):
        places = bubbles()
        states = states_of({"hexahedron": places})
        first, second, third = (states.at(step, {"u": step * places[..., 0]}) for step in range(3))
        share(first.mesh)
        assert geometry(first) is geometry(second) is geometry(third)
        other = replace(third, fields=tuple(map(copy, third.fields)))
        assert geometry(other) is not geometry(third)


class TestStates:
    def test_nodal_values_are_converted_like_files(self):
        places = squares()
        states = states_of({"quadrilateral": places})
        for time in (0.0, 1.0, 2.0):
            state = states.at(time, {"u": values(places, time), "c": np.full(places.shape[:2], time)})
            whole = from_arrays({"quadrilateral": places}, u=values(places, time), c=np.full(places.shape[:2], time))
            assert state.time == time
            for name in ("u", "c"):
                for own, wanted in zip(state[name].blocks, whole[name].blocks, strict=True):
                    assert own.expansion == wanted.expansion
                    assert (own.coefficients == wanted.coefficients).all()

    def test_a_uniform_start_does_not_affect_later_steps(self):
        places, point = squares(0.0), (0.3, 1.6)
        states = states_of({"quadrilateral": places})
        first, second = (states.at(1.0, {"u": own}) for own in (np.ones(places.shape[:2]), values(places, 1.0)))
        assert sample(second, "u", point)["u"] == pytest.approx([0.18 - 1.6], abs=1e-13)
        # so that a series interpolates between the two
        assert [block.expansion for block in first["u"].blocks] == [block.expansion for block in second["u"].blocks]

    def test_new_coefficients_replace_old_ones(self):
        dataset = with_field(grid(Shape.QUADRILATERAL, 2), lambda x: x[:, 0] * x[:, 1])
        coefficients = [np.array(block.coefficients) for block in dataset["u"].blocks]
        states = states_of(dataset)
        twice = states.at(1.0, {"u": [2 * own for own in coefficients], "w": [-own for own in coefficients]})
        point = (0.3, 0.7)
        found = sample(twice, ["u", "w"], point)
        assert [float(found["u"][0]), float(found["w"][0])] == pytest.approx([0.42, -0.21], abs=1e-13)
        coefficients[0][:] = 0.0
        assert sample(twice, "u", point)["u"] == pytest.approx([0.42], abs=1e-13)

    def test_dlpack_arrays_are_accepted(self):
        class Tensor:
            def __init__(self, array):
                self.array = array

            def __dlpack__(self, **options):
                return self.array.__dlpack__(**options)

            def __dlpack_device__(self):
                return self.array.__dlpack_device__()

        places = squares()
        state = states_of({"quadrilateral": places}).at(0.0, {"u": Tensor(values(places, 0.0))})
        assert sample(state, "u", (0.5, 1.0))["u"] == pytest.approx([0.25 - 1.0], abs=1e-12)

    @pytest.mark.parametrize(
        ("fields", "told"),
        [
            ({"u": np.zeros((4, 15))}, r"u: expected \(4, 16\) values, or components of these, found \(4, 15\)"),
            ({"u": {"triangle": np.zeros((4, 16))}}, "u: there are no elements of the shape 'triangle'"),
        ],
    )
    def test_mismatched_arrays_are_rejected(self, fields, told):
        with pytest.raises(ElvisError, match=told):
            states_of({"quadrilateral": squares()}).at(0.0, fields)

    def test_mismatched_coefficients_are_rejected(self):
        dataset = with_field(grid(Shape.QUADRILATERAL, 2), lambda x: x[:, 0])
        with pytest.raises(ElvisError, match=r"u: quadrilateral: expected coefficients \(4, 9\), found \(4, 8\)"):
            states_of(dataset).at(0.0, {"u": np.zeros((4, 8))})
        with pytest.raises(ElvisError, match="found a mesh without fields"):
            states_of(Dataset(dataset.mesh))
        with pytest.raises(ElvisError, match="expected a dataset, or positions of nodes by shape"):
            states_of(3)


class TestTriggers:
    """u = x² (1 + t) - y on [0, 2]²: its largest value is 4 (1 + t), its smallest -2."""

    def shown(self, session, **keywords):
        places = squares(0.0)
        drawn = session({"quadrilateral": places}, output=None, **keywords)
        found = [drawn.show(step, 0.1 * step, {"u": values(places, 0.1 * step)}) for step in range(6)]
        assert drawn.faults == []
        return [step for step, frame in enumerate(found) if frame is not None]

    def test_a_period(self, session):
        assert self.shown(session, every=2) == [0, 2, 4]

    @pytest.mark.parametrize(
        ("when", "steps"),
        [
            ("max(u) > 5", [3, 4, 5]),
            ("max(u) < 5", [0, 1, 2]),
            ("min(u) < -2.5", []),
            ("min(u) > -2.5 and max(2*u) >= 11", [4, 5]),
        ],
    )
    def test_conditions(self, session, when, steps):
        assert self.shown(session, when=when) == steps

    def test_arrays_of_other_steps_are_not_requested(self, session):
        drawn = session({"quadrilateral": squares()}, every=5)
        assert drawn.show(3, 0.0, lambda: pytest.fail("called")) is None
        assert drawn.faults == []

    @pytest.mark.parametrize(
        "text",
        [
            *("max(u)", "u > 1", "mean(u) > 1", "max(u) > one", "max() > 1", "max(u) > 1 or min(u) < 0"),
            *("max(u) > nan", "max(u) > 1e400", None, 3),
        ],
    )
    def test_invalid_conditions_are_rejected(self, text):
        with pytest.raises(SceneError, match="when: expected a condition as"):
            Trigger.of(1, text)

    @pytest.mark.parametrize("every", [0, -1, 2.5, True])
    def test_invalid_periods_are_rejected(self, every):
        with pytest.raises(SceneError, match="every: expected a number of steps, 1 or more"):
            Trigger.of(every, "")

    def test_conditions_may_contain_functions(self):
        assert Condition.parse("max(max(u, v) + 1) <= 2e-3") == Condition("max", "max(u, v) + 1", False, 2e-3)


class TestFaults:
    def test_the_solver_continues_after_one_warning(self, session, capsys):
        places = squares()
        drawn = session({"quadrilateral": places})
        for step in range(3):
            assert drawn.show(step, 0.0, {"w": values(places, 0.0)}) is None
        assert capsys.readouterr().err.count("was not drawn; the solver continues") == 1
        assert len(drawn.faults) == 1
        assert "u" in drawn.faults[0]
        assert drawn.show(3, 0.0, {"u": values(places, 0.0)}) is not None

    def test_warnings_that_differ_only_in_numbers_are_printed_once(self, session, tmp_path, capsys):
        """As the names of files that a full disk, or a folder that is gone, does not take."""
        (tmp_path / "gone").mkdir()
        places, drawn = squares(), session({"quadrilateral": squares()}, output=str(tmp_path / "gone" / "u_{step}.png"))
        (tmp_path / "gone").rmdir()
        for step in range(12):
            assert drawn.show(step, 0.0, {"u": values(places, 0.0)}) is None
        assert capsys.readouterr().err.count("was not drawn; the solver continues") == 1
        assert len(drawn.faults) == 1
        assert "u_0.png: cannot be written: there is no folder" in drawn.faults[0]

    @pytest.mark.parametrize("modal", [False, True])
    @pytest.mark.parametrize(
        ("step", "time", "told"),
        [
            ("7", 0.0, "step: expected a whole number, found '7'"),
            (2.5, 0.0, "step: expected a whole number, found 2.5"),
            (0, "soon", "time: expected a number, found 'soon'"),
            (0, None, "time: expected a number, found None"),
            (0, 0.0, "expected arrays by the names of fields, as {'u': …}, found array("),
        ],
    )
    def test_invalid_steps_are_reported(self, session, step, time, told, modal):
        places = squares()
        mesh = from_arrays({"quadrilateral": places}, u=values(places, 0.0)) if modal else {"quadrilateral": places}
        drawn = session(mesh)
        assert drawn.show(step, time, values(places, 0.0)) is None
        assert drawn.faults[0].startswith(told)

    def test_any_exception_counts_as_a_fault(self, session, capsys):
        drawn = session({"quadrilateral": squares()})
        drawn.show(0, 0.0, lambda: 1 / 0)
        assert "step 0 was not drawn; the solver continues: ZeroDivisionError" in capsys.readouterr().err

    def test_an_interrupt_comes_through(self, session):
        def interrupted():
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            session({"quadrilateral": squares()}).show(0, 0.0, interrupted)

    @pytest.mark.parametrize(
        ("keywords", "told"),
        [
            ({"output": "u_{stop}.png"}, "expected a name with {step} or {time}"),
            ({"output": "u.gif"}, "expected a name that ends in"),
            ({"output": "nowhere/u.png"}, "nowhere"),
            ({"range": "series"}, "later steps are not known"),
        ],
    )
    def test_impossible_settings_are_rejected_before_the_first_step(self, session, keywords, told):
        with pytest.raises((SceneError, FormatError, ElvisError), match=told):
            session({"quadrilateral": squares()}, **keywords)
