import pytest

from elvis.formats import ElvisError


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


def test_a_file_that_is_not_there(tmp_path, elvis):
    with pytest.raises(ElvisError, match=r"absent\.xml"):
        elvis("norms", tmp_path / "absent.xml")
