"""Positions of the nodes of VTK's Lagrange cells in the reference cell, which a file doesn't state.

VTK expects equidistant nodes; solvers write Gauss-Lobatto nodes, or Gauss nodes, which are all inside.  Three criteria
are used, in this order:

- Cells between whose corners there are gaps, and whose corners coincide when they are extrapolated from Gauss nodes.
- Edges that are simple: polynomials two degrees below the cell's order.  With a wrong family, edges never are.
- How smooth edges are.  With wrong positions, the nodes of an edge form a parametrisation whose share of the two
  highest degrees is proportional to the edge's length, even for a small curvature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elvis.converters.shared.unit import unit_basis
from elvis.converters.vtk.cells import Cell
from elvis.converters.vtk.functions import family_line, is_tensor, moved
from elvis.core.base.arrays import Floats, Ints
from elvis.plugins.projection.vertices import clusters

#: names of the families of nodes
FAMILIES = ("equispaced", "gll", "gauss")

#: number of cells examined
_ENOUGH = 2000

#: the share of an edge that a node of a simple one may be off
_OFF = 1e-5

#: minimum ratio by which edges are smoother with the nodes of the accepted family than with others
_SMOOTHER = 3.0

#: the lowest order whose edges distinguish families
_LEAST = 3

#: corners that are nearer than this share of the mesh's size coincide
_TOGETHER = 1e-7

_PLACES = {"equispaced": "evenly spaced", "gll": "at Gauss-Lobatto places", "gauss": "at Gauss points"}


class Cells(Protocol):
    """Cells of one kind, with the nodes (n, k) of each."""

    cell: Cell
    nodes: Ints

    def places(self, nodes: Ints) -> Floats:
        """(..., 3) of nodes."""


@dataclass(frozen=True)
class Found:
    """The family of nodes that the cells of a file show.

    votes  simple edges by family
    doubt  a message if no criterion decides, or not clearly
    note   a message about the criterion, unless it is simple edges
    """

    name: str
    votes: dict[str, int]
    doubt: str = ""
    note: str = ""

    def notes(self, asked: str) -> list[str]:
        """Sentences for the report; ``asked`` is a family, or auto."""
        if asked != "auto":
            more = self.votes.get(self.name, 0) - self.votes.get(asked, 0)
            seem = f"nodes of {more} edges seem to lie {_PLACES[self.name]} (option nodes)"
            return [seem] if more > 0 else []
        if self.note:
            return [self.note]
        if self.name == "equispaced":
            return []
        return [f"nodes lie {_PLACES[self.name]}, which VTK doesn't expect, and were read accordingly (option nodes)"]


def node_family(parts: Sequence[Cells]) -> Found:
    """The family that Lagrange cells of one degree each show."""
    families = [name for name in FAMILIES if name != "gauss" or all(is_tensor(part.cell.shape) for part in parts)]
    if "gauss" in families and _have_gaps(parts):
        return Found("gauss", {})
    telling = [part for part in parts if part.cell.order >= _LEAST]
    if not telling:
        return Found("equispaced", {})
    off = {name: np.concatenate([_roughness(part, name) for part in telling]) for name in families}
    votes = {name: int((own < _OFF).sum()) for name, own in off.items()}
    if any(votes.values()):
        return Found(max(families, key=lambda name: votes[name]), votes)
    return _smoothest({name: float(np.median(own)) for name, own in off.items() if len(own)})


def _smoothest(roughness: dict[str, float]) -> Found:
    """The family with the smoothest edges, where all are curved."""
    first, second, *_ = sorted(roughness, key=lambda name: roughness[name])
    if _SMOOTHER * roughness[first] < roughness[second]:
        note = f"all edges are curved; assuming nodes {_PLACES[first]}, where edges are smoothest (option nodes)"
        return Found(first, {}, note=note)
    doubt = (
        "all edges are curved, so the nodes of cells can't be determined; they were assumed to be evenly spaced: if "
        "they are not, values and positions are wrong (option nodes)"
    )
    return Found("equispaced", {}, doubt)


def _roughness(part: Cells, family: str) -> Floats:
    """(n,) of edges with a length: the part of the two highest degrees, as a share of the length."""
    cell = part.cell
    places = part.places(part.nodes[:_ENOUGH][:, cell.edge_nodes()])
    length = np.linalg.norm(places[:, :, -1] - places[:, :, 0], axis=2)
    powers = np.linalg.qr(np.vander(family_line(family, cell.order), cell.order - 1))[0]
    rest = np.eye(cell.order + 1) - powers @ powers.T
    off = np.linalg.norm(np.matmul(rest, places), axis=3).max(axis=2)
    return np.asarray(off[length > 0] / length[length > 0])


def _have_gaps(parts: Sequence[Cells]) -> bool:
    """Whether no corners of cells coincide, but do in most cells when they are extrapolated from Gauss nodes."""
    some = [(part.cell, part.places(part.nodes[:_ENOUGH])) for part in parts]
    if not some or not all(len(places) for _, places in some):
        return False
    corners = [places[:, cell.vertex_nodes()] for cell, places in some]
    if _shared(corners) > 0:
        return False
    outer = []
    for cell, places in some:
        dimension = cell.shape.dimension
        basis = unit_basis(cell.shape, cell.order, moved(cell.shape, cell.order, cell.nodes, "gauss")[:, :dimension])
        outer.append(np.einsum("vk,nkc->nvc", basis.at(cell.shape.vertices), places))
    return _shared(outer) > 0.5


def _shared(corners: Sequence[Floats]) -> float:
    """The share of cells one of whose corners, of some (n, v, 3), coincides with one of another cell."""
    start, owners = 0, []
    for own in corners:
        owners.append(np.repeat(start + np.arange(len(own)), own.shape[1]))
        start += len(own)
    cells = np.concatenate(owners)
    places = np.concatenate([own.reshape(-1, 3) for own in corners])
    which = clusters(places, _TOGETHER * float(np.ptp(places, axis=0).max()))
    pairs = np.unique(np.stack([which, cells], axis=1), axis=0)
    is_shared = np.bincount(pairs[:, 0])[pairs[:, 0]] > 1
    return len(np.unique(pairs[is_shared, 1])) / start
