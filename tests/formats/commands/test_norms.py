import json

import numpy as np
import pytest

from elvis import ElvisError


def test_the_contract_of_scripts(nektar, elvis_json):
    found = elvis_json("norms", nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld")
    assert list(found) == ["x", "y", "z", "u", "v", "w", "p"]
    assert all(list(norm) == ["L2", "Linf"] for norm in found.values())
    assert found["p"]["L2"] == pytest.approx(6.531972647, rel=1e-9)
    assert found["p"]["Linf"] == pytest.approx(4, rel=1e-9)


def test_the_order_of_files_does_not_matter(nektar, elvis):
    mesh, field = nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"
    assert elvis("norms", mesh, field) == elvis("norms", field, mesh)


def test_the_table_shows_the_signed_maximum(nektar, elvis):
    text = elvis("norms", nektar / "bfs_tq7" / "bfs_tg.xml", nektar / "bfs_tq7" / "bfs_tg.fld")
    rows = {line.split()[0]: line.split()[1:] for line in text.splitlines()[1:]}
    assert float(rows["v"][1]) == pytest.approx(0.1084452905, rel=1e-8)
    assert float(rows["v"][2]) == pytest.approx(0.0308771, rel=1e-5)


def test_a_missing_file(tmp_path, elvis):
    with pytest.raises(ElvisError, match=r"absent\.xml"):
        elvis("norms", tmp_path / "absent.xml")


def test_norms_of_quantities_equal_their_integrals(nektar, elvis):
    """u = 1 - z^2 on [-1, 1]^3: du/dz = -2z has the L2 norm sqrt(4 * 8/3); divergence and 2u follow from u alone."""
    channel = nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"
    asked = ("--field", "d(u,z)", "--field", "2*u", "--field", "q_criterion")
    found = json.loads(elvis("norms", "--json", *channel, *asked))
    plain = json.loads(elvis("norms", "--json", *channel))
    assert list(found) == ["d(u,z)", "2*u", "q_criterion"]
    assert found["d(u,z)"]["L2"] == pytest.approx(np.sqrt(32 / 3), rel=1e-12)
    assert found["2*u"]["L2"] == pytest.approx(2 * plain["u"]["L2"], rel=1e-13)
    assert found["q_criterion"]["Linf"] < 1e-10


@pytest.mark.parametrize(
    ("text", "is_told"), [("1", True), ("-2*pi", True), ("x/x", False), ("u", False), ("0", False)]
)
def test_the_norm_of_a_constant_is_normalised_and_a_note_says_so(nektar, elvis, monkeypatch, text, is_told):
    """A cube of edge 2."""
    told = []
    monkeypatch.setattr("elvis.core.base.terminal.warn", told.append)
    channel = nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"
    found = json.loads(elvis("norms", "--json", *channel, "--field", text))
    if is_told:
        assert found[text]["L2"] == pytest.approx(np.sqrt(8) * found[text]["Linf"], rel=1e-12)
    assert len(told) == is_told
    assert all(sentence.endswith("the domain's volume (area, length) is 8") for sentence in told)
