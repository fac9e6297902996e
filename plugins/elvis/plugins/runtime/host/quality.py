"""The quality of the elements of a runtime plugin, from its host evaluation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats, every_pair
from elvis.core.base.errors import ElvisError
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.projections import rule
from elvis.core.numbers.mesh_quality import MeshQuality, edge_ratios, jacobian_ratios
from elvis.plugins.runtime.host.evaluation import HostEvaluation, host_evaluations, mean_ratios, scaled_determinants
from elvis.plugins.runtime.opening import PluginData, call_plugin

#: points of the Gauss rule in each direction
_POINTS_EACH_WAY = 5
#: points of elements that are held together
_BATCH = 1 << 16


def host_quality(opened: PluginData) -> MeshQuality:
    """The measures of `elvis.core.numbers.mesh_quality`, except the time step, of data of a runtime plugin.

    ElvisError for a plugin without host evaluation.
    """
    if not opened.fields:
        raise ElvisError(f"the plugin {opened.name} has opened a mesh but no field: also give the field file")
    hosts = host_evaluations(opened.volume(opened.fields[0]))
    if hosts is None:
        raise ElvisError(f"--quality: the plugin {opened.name} does not describe its elements in NumPy (Part.evaluate)")
    return call_plugin(opened.name, "measuring elements", lambda: _measured(hosts))


def _measured(hosts: list[HostEvaluation]) -> MeshQuality:
    """All measures of the elements of all parts."""
    parts = [part for host in hosts for part in _parts(host)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    ids = np.concatenate([host.part.element_ids for host in hosts])
    shapes = tuple(host.shape.label.lower() for host in hosts for _ in range(len(host)))
    dimension = max(host.shape.dimension for host in hosts)
    return MeshQuality(ids, shapes, found.pop("places")[:, :dimension], found)


def _parts(host: HostEvaluation) -> Iterator[dict[str, Floats]]:
    """Measures of the elements of a part, some at a time."""
    d = host.shape.dimension
    points, weights = rule(host.shape, _POINTS_EACH_WAY)
    for some in chunks(len(host), max(1, _BATCH // len(points))):
        rows = np.arange(some.start, some.stop)
        every_row, every_point = every_pair(rows, points)
        jacobians = host.derivatives(every_row, every_point)[0][:, :d]
        determinants = np.linalg.det(jacobians).reshape(len(rows), -1)
        yield {
            "quality": mean_ratios(host.shape, jacobians).reshape(len(rows), -1).min(axis=1),
            "scaled_jacobian": scaled_determinants(jacobians).reshape(len(rows), -1).min(axis=1),
            "jacobian_ratio": jacobian_ratios(determinants),
            "edge_ratio": edge_ratios(host.shape, host.positions(rows, host.shape.vertices)),
            "h": np.abs(determinants @ weights) ** (1 / d),
            "places": host.positions(rows, points).mean(axis=1),
        }
