"""Numbers that files declare are compared with what arrives: what is missing is an error or is named."""

import re

import h5py
import numpy as np
import pytest
from cgns_writing import base, condition, conditions, grid, section, structured, unstructured, write_hdf5
from small_files import NATIVE, SMALL_FILES

from elvis.core.base.errors import FormatError
from elvis.plugins import read
from elvis.plugins.conversion.discovery import installed_converters

#: formats that state a number of elements, and those that list sides by boundary
ELEMENTS = ("elvisdat", "exodus", "gmf", "gmsh", "hopr", "mfem", "nek", "ngsolve", "pyfr", "vtk")
SIDES = ("exodus", "gmf", "hopr", "pyfr")


def source(name, folder):
    made, package = SMALL_FILES[name]
    if package:
        pytest.importorskip(package)
    (converter,) = (each.converter for each in installed_converters() if each.name == name)
    return converter(made(folder))


@pytest.mark.parametrize("name", ELEMENTS)
def test_missing_elements_are_an_error(name, tmp_path):
    """A block that a converter would drop is missed, as it is in a file without it."""
    found = source(name, tmp_path)
    assert found.declared.check(found) == []
    assert found.declared.elements == sum(map(len, found.blocks))
    found.blocks = [found.blocks[0].take(slice(0, len(found.blocks[0]) - 1)), *found.blocks[1:]]
    with pytest.raises(FormatError, match="as the files declare, found"):
        found.declared.check(found)


@pytest.mark.parametrize("name", SIDES)
def test_missing_sides_are_named(name, tmp_path):
    found = source(name, tmp_path)
    assert found.declared.sides
    lost = found.boundaries[0].name
    found.boundaries = [each for each in found.boundaries if each.name != lost]
    (sentence,) = found.declared.check(found)
    assert repr(lost) in sentence


def test_hopr_declares_its_elements_and_conditions(tmp_path):
    (path,) = SMALL_FILES["hopr"][0](tmp_path)
    with h5py.File(path, "r+") as file:
        sides = np.asarray(file["SideInfo"])
        sides[0, 4] = 9
        file["SideInfo"][...] = sides
    assert any("condition 9 (without a name)" in each for each in read(path, cache=False).remarks)
    with h5py.File(path, "r+") as file:
        file.attrs["nElems"] = np.array([3], "i4")
    with pytest.raises(FormatError, match="expected 3 elements, as the files declare, found 2"):
        read(path, cache=False)


def test_cgns_conditions_that_refer_to_missing_entities_are_reported(tmp_path):
    places = grid(3, 2, 2) * [2, 1, 1]
    own = condition("left", "PointList", [(1, 1, 1), (1, 1, 7)], "IFaceCenter")
    path = write_hdf5(tmp_path / "a.cgns", [base(structured("zone", places, conditions(own)))], 4.2)
    assert any("1 faces of the boundary condition left lie outside of the grid" in r for r in read(path).remarks)
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    own = condition("left", "PointList", [(2,), (9,)], "EdgeCenter")
    parts = [section("cells", 7, 1, [(0, 1, 2, 3)]), section("edges", 3, 2, [(0, 1)]), conditions(own)]
    path = write_hdf5(tmp_path / "b.cgns", [base(unstructured("zone", square, 1, *parts), dimension=2)], 4.2)
    assert any("1 elements of the boundary condition left are in no section" in r for r in read(path).remarks)


def test_composites_refer_to_existing_entities(tmp_path):
    (tmp_path / "a.xml").write_text(re.sub(r"E\[0-3\]", "E[0-3,6-9]", NATIVE))
    remarks = read(tmp_path / "a.xml").remarks
    assert "3 of the 8 entities of composite 2 that are not in the mesh were skipped" in remarks
