"""Shared cases, what it means that two datasets are the same, and that a file is rejected."""

import re
import shutil
import time
import tracemalloc
from pathlib import Path

import pytest

from elvis import FormatError
from elvis.formats.reading import read

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "nektar"
MESH_SUFFIXES, FIELD_SUFFIXES = (".xml", "_xml"), (".fld", ".rst", ".chk")


def case_names():
    """The folders of the shared data, known when tests are collected."""
    return sorted(folder.name for folder in DATA.iterdir() if folder.is_dir()) if DATA.is_dir() else []


@pytest.fixture(params=case_names())
def case(request):
    """The name of each shared case in turn."""
    return request.param


@pytest.fixture(scope="session")
def case_files(nektar):
    """The mesh file and the field file (None where there is none) of a case."""

    def found(case):
        names = sorted(path for path in (nektar / case).iterdir() if "zVariation" not in path.name)
        mesh = [path for path in names if path.name.endswith(MESH_SUFFIXES)]
        fields = [path for path in names if path.name.endswith(FIELD_SUFFIXES)]
        assert len(mesh) == 1
        return mesh[0], fields[0] if fields else None

    return found


@pytest.fixture(scope="session")
def assert_same():
    """Checks that two datasets are equal bit by bit; composites and rules only where asked."""

    def check(one, other, with_composites=True):
        check_mesh(one.mesh, other.mesh, with_composites)
        assert [field.name for field in one.fields] == [field.name for field in other.fields]
        for a, b in zip(one.fields, other.fields, strict=True):
            check_field(a, b)
        assert one.time == other.time
        assert dict(one.metadata) == dict(other.metadata)

    return check


def check_mesh(one, other, with_composites):
    assert (one.dimension, one.space) == (other.dimension, other.space)
    assert bits(one.vertex_ids) == bits(other.vertex_ids)
    assert bits(one.vertices) == bits(other.vertices)
    shapes = {shape for mesh in (one, other) for shape in mesh.entities if len(mesh.of(shape))}
    for shape in shapes:
        assert bits(one.of(shape).ids) == bits(other.of(shape).ids)
        assert bits(one.of(shape).members) == bits(other.of(shape).members)
    for a, b in ((one.edge_curves, other.edge_curves), (one.face_curves, other.face_curves)):
        assert [bits(getattr(a, name)) for name in vars(a)] == [bits(getattr(b, name)) for name in vars(b)]
    if with_composites:
        assert [composite_facts(c) for c in one.composites] == [composite_facts(c) for c in other.composites]
        assert dict(one.domains) == dict(other.domains)


def composite_facts(composite):
    # written labels are names
    return composite.id, composite.name or composite.label, [(tag, ids.tolist()) for tag, ids in composite.parts]


def check_field(one, other):
    """The blocks by expansion, for files of another kind may order them differently."""
    blocks = {block.expansion: block for block in other.blocks}
    assert {block.expansion for block in one.blocks} == set(blocks)
    for block in one.blocks:
        assert bits(block.element_ids) == bits(blocks[block.expansion].element_ids)
        assert bits(block.coefficients) == bits(blocks[block.expansion].coefficients)


def bits(array):
    return array.dtype, array.shape, array.tobytes()


@pytest.fixture
def refused(slowness):
    """Checks that files are rejected with a message, quickly and without much memory; the message is one sentence."""

    def check(*paths, match, megabytes=60, seconds=5):
        tracemalloc.start()
        start = time.process_time()
        try:
            with pytest.raises(FormatError, match=match) as caught:
                read(*paths)
            assert tracemalloc.get_traced_memory()[1] < megabytes * (1 << 20)
            assert time.process_time() - start < slowness * seconds
        finally:
            tracemalloc.stop()
        assert "\n" not in str(caught.value)
        assert not re.search(r"Traceback|Error:", str(caught.value))

    return check


@pytest.fixture
def copied(nektar, tmp_path):
    """Files of a case, copied; ``changed`` replaces text in one of them."""

    def copies(case):
        for path in (nektar / case).iterdir():
            if path.is_file():
                shutil.copyfile(path, tmp_path / path.name)
        return tmp_path

    return copies
