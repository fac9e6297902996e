"""The files that the pages of the documentation speak of, by the names that they have there.

    python examples/page_data.py FOLDER [DATA]        into FOLDER; solvers' own files come from the folder DATA

wing       all volume shapes, curved, with p, u, v, w
cylinder   2D: potential flow past a cylinder (generate.py)
wave       2D: wave_0.chk to wave_8.chk, a standing wave that loses strength, at times 0 to 2
resolved   2D: 64 squares of order 4 with a smooth field, a layer, a shock and a corner
bend       3D: flow through a curved duct (generate.py)
delta      3D: vortex over a half delta wing (cases.py, where Gmsh is installed)
SOURCES    files that solvers wrote
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from elvis import Dataset, write
from elvis.core.testing import approximated, curved, mixed_volume, ripple
from elvis.plugins.samples.sample import write_sample

#: name in the pages -> solver's file; a folder and a pattern stand for all that fit, under their own names
SOURCES = {
    "case.pyfrm": "solvers/pyfr/mixed3d_p3.pyfrm",
    "case-00.pyfrs": "solvers/pyfr/mixed3d_p3-00.pyfrs",
    "case-01.pyfrs": "solvers/pyfr/mixed3d_p3-01.pyfrs",
    "refined.mesh": "solvers/mfem/fichera_mixed_p2.mesh",
    "sol.gf": "solvers/mfem/fichera_mixed_p2.u.gf",
    "pipe.mesh": "solvers/mfem/pipe_nurbs.mesh",
    "pipe.u.gf": "solvers/mfem/pipe_nurbs.u.gf",
    "box.vol": "solvers/ngsolve/ballbox_p4.vol",
    "box.u.gfu": "solvers/ngsolve/ballbox_p4.u.gfu",
    "box.w.gfu": "solvers/ngsolve/ballbox_p4.w.gfu",
    "ball.msh": "solvers/gmsh/ball_tet_o2_p5.msh",
    "mixed.msh": "solvers/gmsh/mixed_o3.msh",
    "shell.vtu": "solvers/vtk/dealii_shell_p4.vtu",
    "u.pvd": "solvers/vtk/dolfinx_tet_o3_u.pvd",
    "naca_State.h5": "solvers/hopr_flexi/NACA0012_Re5000_AoA8_3D_Referenz_0000010.000000000.h5",
    "naca_mesh.h5": "solvers/hopr_flexi/NACA0012_652_Ng2_mesh.h5",
    "escher.mesh": "solvers/mfem/escher_p3.mesh",
    "escher.u.gf": "solvers/mfem/escher_p3.u.gf",
    "sphere.xml": "nektar/sphere_manifold/interpfield_fromsphere.xml",
    "sphere.fld": "nektar/sphere_manifold/interpfield_fromsphere.fld",
    "step.xml": "nektar/bfs_tq7/bfs_tg.xml",
    "step.fld": "nektar/bfs_tq7/bfs_tg.fld",
    "": ("solvers/nek5000/ethier[0.]*", "solvers/vtk/dolfinx_tet_o3_u*"),
}


def lay_out(folder: Path, data: Path | None = None, quick: bool = True) -> None:
    """Write all files of the pages; those of solvers where their folder is there."""
    import generate

    write(wing(3 if quick else 5), folder / "wing.xml")
    for name in ("wave", "resolved"):
        write_sample(name, folder)
    generate.main(folder)
    if find_spec("gmsh"):
        import cases

        cases.write_case("delta", folder, quick)
    if data is not None and data.is_dir():
        for name, source in SOURCES.items():
            for each in (source,) if isinstance(source, str) else source:
                for path in data.glob(each):
                    shutil.copy(path, folder / (name or path.name))


def wing(modes: int = 5) -> Dataset:
    """Tetrahedra, pyramids, prisms and a hexahedron, all of them curved, with four fields of so many modes each way.

    The boundary has the name of that of the wing of ``elvis sample``.
    """
    mesh = curved(mixed_volume(seed=1), ripple(0.02), n=min(modes, 4))
    named = (replace(own, name="wing" if own.name == "boundary" else own.name) for own in mesh.composites)
    dataset = Dataset(replace(mesh, composites=tuple(named)))
    functions = {
        "p": lambda x: np.sin(2 * x[:, 0]) * np.cos(x[:, 1]) + x[:, 2] ** 2,
        "u": lambda x: 1 - x[:, 2] ** 2,
        "v": lambda x: x[:, 0] * x[:, 1],
        "w": lambda x: 0.1 * x[:, 0],
    }
    fields = (approximated(dataset, name, function, modes) for name, function in functions.items())
    return replace(dataset, fields=tuple(fields))


def main(arguments: list[str]) -> None:
    """Write them for a person: the delta wing with all its elements."""
    folder, *data = map(Path, arguments)
    folder.mkdir(parents=True, exist_ok=True)
    lay_out(folder, data[0] if data else None, quick=False)


if __name__ == "__main__":
    main(sys.argv[1:])
