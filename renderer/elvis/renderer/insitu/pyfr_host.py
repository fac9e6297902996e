"""PyFR as a host of pictures: a plugin of it, which draws the solution that it holds.

``mpiexec -n 2 python -m elvis.renderer.insitu.pyfr_host run -b openmp mesh.pyfrm case.ini`` is PyFR with the plugin; a
section ``[soln-plugin-elvis]`` of its configuration asks for pictures.  See ``docs/howto/in-situ.md``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.needing import MissingPackageError, require_module
from elvis.plugins.command.registry import load
from elvis.plugins.data.run_states import NodalStates
from elvis.renderer.insitu.in_situ import Session


class Host:
    """The addition to PyFR's base class of plugins: pictures that the first rank draws from the data of all.

    Its section has ``scene``, a scene file; ``output``, a picture with {step} or {time} in its name, which replaces the
    outputs of the scene; ``every`` and ``when``, as of `Session`.  Errors in these end the run before its first step.
    """

    name = "elvis"
    systems = ("*",)
    formulations = ("dual", "std")
    dimensions = (2, 3)
    #: the configuration and the section of the plugin, set by PyFR's base
    cfg: Any
    cfgsect: str

    def __init__(self, intg: Any, cfgsect: str, suffix: str | None = None) -> None:
        from pyfr.mpiutil import get_comm_rank_root

        super().__init__(intg, cfgsect, suffix)  # type: ignore[call-arg]
        self._comm, rank, self._root = get_comm_rank_root()
        self._names = list(next(iter(intg.system.ele_map.values())).convars)
        self._points: dict[str, Floats] = {}
        self._config = self.cfg.tostr()
        self._every = self.cfg.getint(cfgsect, "every", 1)
        self._states: NodalStates | None = None
        self._session = self._opened(str(intg.system.mesh.fname)) if rank == self._root else None

    def __call__(self, intg: Any) -> None:
        """Draw a step that has been accepted, where it is one that is requested."""
        step = int(intg.nacptsteps)
        if step % self._every:
            return
        wanted = self._comm.bcast(self._wanted(), root=self._root)
        parts = self._comm.gather(_part(intg, wanted), root=self._root)
        if self._session is not None:
            names = [self._names[number] for number in wanted]
            self._session.show(step, float(intg.tcurr), lambda: self._joined(names, parts))

    def _wanted(self) -> list[int]:
        """Numbers of the variables to send: the ones that the last picture needed; all before there is one."""
        every = range(len(self._names))
        carried = () if self._states is None else self._states.carried
        return [number for number in every if self._names[number] in carried] or list(every)

    def finalise(self, intg: Any) -> None:
        """Give the device back."""
        super().finalise(intg)  # type: ignore[misc]
        if self._session is not None:
            self._session.close()

    def _opened(self, mesh: str) -> Session:
        """The session of the first rank."""
        converter: Any = load("elvis.converters", "pyfr")
        self._source = converter([Path(mesh)])
        given = {key: self.cfg.get(self.cfgsect, key) for key in ("output",) if self.cfg.hasopt(self.cfgsect, key)}
        scene, when = self.cfg.getpath(self.cfgsect, "scene"), self.cfg.get(self.cfgsect, "when", "")
        self._states = NodalStates(self._source, Path(mesh).name)
        return Session(self._states, scene, every=self._every, when=when, **given)

    def _joined(self, names: Sequence[str], parts: Sequence[Mapping[str, tuple[Ints, Floats]]]) -> Any:
        """Variables on all elements, in the order of the mesh file, from the parts of all ranks."""
        values: dict[str, tuple[Floats, Floats]] = {}
        for kind in sorted({kind for part in parts for kind in part}):
            own = [part[kind] for part in parts if kind in part]
            found = np.empty((sum(len(rows) for rows, _ in own), *own[0][1].shape[1:]), own[0][1].dtype)
            for rows, each in own:
                found[rows] = each
            values[kind] = self._solution_points(kind, found.shape[2]), found
        return self._source.state(names, values, self._config)

    def _solution_points(self, kind: str, count: int) -> Floats:
        """(count, d) where elements of a kind have their values; found once."""
        from pyfr.quadrules import get_quadrule

        if kind not in self._points:
            rule = self.cfg.get(f"solver-elements-{kind}", "soln-pts")
            self._points[kind] = np.asarray(get_quadrule(kind, rule, count).pts)
        return self._points[kind]


def _part(intg: Any, wanted: Sequence[int]) -> dict[str, tuple[Ints, Floats]]:
    """For each kind of element, the rows of this rank's elements in the mesh file, and values (n, variables, points).

    wanted  numbers of the variables
    """
    kinds, rows = intg.system.ele_types, intg.system.mesh.eidxs
    pairs = zip(kinds, intg.soln, strict=True)
    return {kind: (np.asarray(rows[kind]), np.ascontiguousarray(own[:, wanted].T)) for kind, own in pairs}


@cache
def plugin() -> type:
    """The plugin's class, which PyFR finds among the subclasses of its own; kept, since it knows these weakly."""
    from pyfr.plugins.base import BaseSolnPlugin

    return type("ElVisPlugin", (Host, BaseSolnPlugin), {})


def run() -> None:
    """PyFR's command line, with the plugin."""
    try:
        solver = require_module("pyfr.__main__", "drawing while PyFR runs")
    except MissingPackageError as error:
        sys.exit(f"elvis: error: {error}")
    plugin()
    solver.main()


if __name__ == "__main__":
    run()
