"""Small Exodus files: blocks and sets that may be empty, variables on some of the blocks, pieces of parallel runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import starmap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

_NAME = 33


class ExodusBlock(NamedTuple):
    """A block of elements: its name, their type, and their nodes (n, k) from 0."""

    name: str
    kind: str
    nodes: Any


def unit_cubes(count: int, first: int = 0) -> tuple[Any, Any]:
    """Places (4 (count + 1), 3) and nodes (count, 8) of unit cubes in a row along x, which starts at ``first``."""
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    places = np.array([(first + x, y, z) for x in range(count + 1) for y, z in square])
    one = np.array([0, 4, 5, 1, 3, 7, 6, 2])
    return places, one + 4 * np.arange(count)[:, None]


def exodus_variables(
    places: Any,
    blocks: Sequence[ExodusBlock],
    sides: Mapping[str, Sequence[tuple[int, int]]] | None = None,
    nodal: Mapping[str, Any] | None = None,
    on_elements: Mapping[str, Mapping[int, Any]] | None = None,
    extra: Mapping[str, Any] | None = None,
    time: float = 0.0,
) -> tuple[dict[str, int], dict[str, tuple[tuple[str, ...], Any]]]:
    """Dimensions, and variables with the names of their dimensions, of a mesh with one step.

    sides        pairs of an element and a side, both from 1, by the name of the set
    nodal        values at all nodes by name
    on_elements  values by name and number of the block, from 1
    extra        integer arrays by the name of a variable
    """
    sides, nodal, on_elements, extra = sides or {}, nodal or {}, on_elements or {}, extra or {}
    sizes = {"len_name": _NAME, "num_dim": places.shape[1], "num_nodes": len(places)}
    sizes |= {"num_elem": sum(len(block.nodes) for block in blocks), "num_el_blk": len(blocks)}
    sizes |= {"time_step": 1, "num_side_sets": len(sides), "num_nod_var": len(nodal), "num_elem_var": len(on_elements)}
    variables: dict[str, tuple[tuple[str, ...], Any]] = {"time_whole": (("time_step",), np.array([time]))}
    for axis, column in zip("xyz", places.T, strict=False):
        variables[f"coord{axis}"] = (("num_nodes",), column)
    variables["eb_names"] = (("num_el_blk", "len_name"), _texts([block.name for block in blocks]))
    variables["eb_status"] = (("num_el_blk",), np.array([int(len(block.nodes) > 0) for block in blocks], np.int32))
    for number, block in enumerate(blocks, 1):
        if len(block.nodes):
            sizes |= {f"num_el_in_blk{number}": len(block.nodes), f"num_nod_per_el{number}": block.nodes.shape[1]}
            dimensions = (f"num_el_in_blk{number}", f"num_nod_per_el{number}")
            variables[f"connect{number}"] = (dimensions, (block.nodes + 1).astype(np.int32))
    if sides:
        variables["ss_names"] = (("num_side_sets", "len_name"), _texts(list(sides)))
    for number, pairs in enumerate(sides.values(), 1):
        if pairs:
            sizes[f"num_side_ss{number}"] = len(pairs)
            for name, column in zip(("elem", "side"), np.array(pairs, np.int32).T, strict=True):
                variables[f"{name}_ss{number}"] = ((f"num_side_ss{number}",), column)
    for what, names in (("nod", list(nodal)), ("elem", list(on_elements))):
        if names:
            variables[f"name_{what}_var"] = ((f"num_{what}_var", "len_name"), _texts(names))
    for number, values in enumerate(nodal.values(), 1):
        variables[f"vals_nod_var{number}"] = (("time_step", "num_nodes"), np.asarray(values, float)[None])
    for number, by_block in enumerate(on_elements.values(), 1):
        for block, values in by_block.items():
            name = f"vals_elem_var{number}eb{block}"
            variables[name] = (("time_step", f"num_el_in_blk{block}"), np.asarray(values, float)[None])
    for name, values in extra.items():
        sizes[f"num_{name}"] = len(values)
        variables[name] = ((f"num_{name}",), np.asarray(values, np.int32))
    return {name: size for name, size in sizes.items() if size}, variables


def write_classic(path: Path, blocks: Sequence[ExodusBlock], *given: Any, **named: Any) -> Path:
    """A file of the classic container; arguments after ``blocks`` are those of `exodus_variables`."""
    from scipy.io import netcdf_file

    places, *rest = given
    sizes, variables = exodus_variables(places, blocks, *rest, **named)
    with netcdf_file(str(path), "w", version=2) as file:
        file.createDimension("time_step", None)
        for name, size in sizes.items():
            if name != "time_step":
                file.createDimension(name, size)
        for name, (dimensions, values) in variables.items():
            kind = {"f": "d", "i": "i", "S": "c"}[values.dtype.kind]
            file.createVariable(name, kind, dimensions)[:] = values
        for number, block in enumerate(blocks, 1):
            if len(block.nodes):
                file.variables[f"connect{number}"].elem_type = block.kind.encode()
    return path


def write_hdf5(
    path: Path, blocks: Sequence[ExodusBlock], *given: Any, unwritten: Sequence[str] = (), **named: Any
) -> Path:
    """The same in HDF5; the variables ``unwritten`` are defined and hold nothing."""
    import h5py

    places, *rest = given
    sizes, variables = exodus_variables(places, blocks, *rest, **named)
    with h5py.File(path, "w") as file:
        for name, size in sizes.items():
            file.create_dataset(name, (size,), ">f4").make_scale(name)
        for name, (_, values) in variables.items():
            made = file.create_dataset(name, values.shape, values.dtype)
            if name not in unwritten:
                made[...] = values
        for number, block in enumerate(blocks, 1):
            if len(block.nodes):
                file[f"connect{number}"].attrs["elem_type"] = np.bytes_(block.kind)
    return path


def _texts(names: Sequence[str]) -> Any:
    """(n, _NAME) characters."""
    return np.array([list(name.ljust(_NAME, "\0")) for name in names], "S1")


def cubes_in_blocks(path: Path, write: Any, counts: Sequence[int], **named: Any) -> Path:
    """A row of unit cubes, ``counts`` of them in each block.

    The set ``inflow`` is at its start, ``outflow`` at its end; the set between these is empty.
    """
    total = sum(counts)
    places, nodes = unit_cubes(total)
    ends = np.cumsum([0, *counts])
    numbered = zip(range(len(counts)), ends[:-1], ends[1:], strict=True)
    blocks = list(starmap(lambda i, start, end: ExodusBlock(f"part{i}", "HEX8", nodes[start:end]), numbered))
    sides = {"inflow": [(1, 4)], "nothing": [], "outflow": [(total, 2)]}
    return write(path, blocks, places, sides, **named)
