"""Written files: reading back gives the same bits, other programs find what they need, and nothing is left half."""

import os
import re
from dataclasses import replace

import h5py
import numpy as np
import pytest

from elvis.formats import Composite, ElvisError, Field, read, write

MESH_FORMATS = ["compressed", "text", "hdf5"]
FIELD_FORMATS = ["xml", "hdf5"]


def dataset_of(case_files, case):
    return read(*[path for path in case_files(case) if path])


@pytest.mark.parametrize("mesh_format", MESH_FORMATS)
def test_meshes_come_back_bit_by_bit(case, mesh_format, case_files, assert_same, tmp_path):
    dataset = replace(dataset_of(case_files, case), fields=())
    files = write(dataset, tmp_path / "mesh.xml", mesh_format=mesh_format)
    assert [file.name for file in files] == ["mesh.xml", "mesh.nekg"][: len(files)]
    assert_same(read(tmp_path / "mesh.xml"), dataset)


@pytest.mark.parametrize("field_format", FIELD_FORMATS)
def test_fields_come_back_bit_by_bit(case, field_format, case_files, assert_same, tmp_path):
    dataset = dataset_of(case_files, case)
    if not dataset.fields:
        pytest.skip("the case has no fields")
    write(dataset, tmp_path / "a.xml", field_format=field_format)
    assert_same(read(tmp_path / "a.fld", tmp_path / "a.xml"), dataset)
