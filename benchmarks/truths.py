"""Every shared file of a solver converted: the error that is reported, and that at the solver's own values.

python benchmarks/truths.py FOLDER      the folder of the solvers' files and of their *.truth.npz
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from measuring import once
from tables import Table, seconds

from elvis.core.base.arrays import Floats
from elvis.core.base.relative import scale
from elvis.plugins.conversion.converting import Conversion
from elvis.plugins.testing import values_found


@dataclass(frozen=True)
class Case:
    """Files of a case, what to compare them with, and options of the converter.

    names  our fields by name of the truth's, where they are called otherwise
    left_out  shapes of the truth that the file doesn't have whole
    """

    converter: str
    files: tuple[str, ...]
    truth: tuple[str, ...] = ()
    names: dict[str, Sequence[str]] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Where the files lie."""
        return FOLDERS.get(self.converter, self.converter)


FOLDERS = {"hopr": "hopr_flexi", "nek": "nek5000"}

_FLEXI = {"soln": ("Density", "MomentumX", "MomentumY", "MomentumZ", "EnergyStagnationDensity")}
_PYFR = {"soln": ("rho", "rhou", "rhov", "rhow", "E")}
_GMF = {"s": ("scalar",), "v": ("vector_x", "vector_y", "vector_z")}
_NEK = {"vel": ("velocity_x", "velocity_y", "velocity_z"), "p": ("pressure",)}


def _mfem(name: str, fields: str) -> Case:
    return Case("mfem", (f"{name}.mesh", *(f"{name}.{each}.gf" for each in fields)), (name,))


def _vtk(name: str, truth: str) -> Case:
    return Case("vtk", (f"{name}.vtu",), (truth,))


CASES = [
    Case("gmsh", ("ball_tet_o2_p5.msh",), ("ball_tet_o2_p5",)),
    Case("gmsh", ("mixed_o2_v22.msh",), ("mixed_o2_v22", "mixed_o2_v22_w")),
    Case("gmsh", ("mixed_o3.msh",), ("mixed_o3", "mixed_o3_w")),
    _vtk("mfem_escher_p3", "mfem_escher_p3"),
    _vtk("mfem_fichera_mixed_p2", "mfem_fichera_mixed_p2"),
    _vtk("mfem_fichera_q3", "mfem_fichera_q3"),
    _vtk("dealii_shell_p4", "dealii_shell_p4"),
    _vtk("dolfinx_tet_o3_u_p0_000000", "dolfinx_tet_o3"),
    _vtk("dolfinx_tet_o3_w_p0_000000", "dolfinx_tet_o3"),
    Case("vtk", ("pyfr_mixed3d_p3.vtu",), ("../pyfr/mixed3d_p3-01",), {"soln": ("Density",)}, left_out=("pyr",)),
    *(_mfem(name, "uvw") for name in ("escher_p3", "fichera_mixed_p2", "fichera_q3", "tinyzoo")),
    _mfem("pipe_nurbs", "uw"),
    _mfem("stream_laghos", "f"),
    Case("ngsolve", ("ballbox_p4.elems.npz",), ("ballbox_p4",)),
    Case(
        "ngsolve",
        tuple(f"ballbox_p4.{end}" for end in ("vol", "u.gfu", "w.gfu", "v.gfu")),
        ("ballbox_p4",),
        options={"spaces": "H1:5,L2:4,VectorH1:4"},
    ),
    Case("ngsolve", ("hexprism_p3_hex.elems.npz",), ("hexprism_p3_hex",)),
    Case("ngsolve", ("hexprism_p3_prism.elems.npz",), ("hexprism_p3_prism",)),
    Case("nek", ("ethier0.f00001", "ethier.re2"), ("ethier_p7",), _NEK),
    Case("nek", ("nek_io_test_m12io_test0.f00001",)),
    *(Case("pyfr", (f"mixed3d_p3-{n}.pyfrs",), (f"mixed3d_p3-{n}",), _PYFR) for n in ("00", "01")),
    Case("hopr", ("NACA0012_Re5000_AoA8_3D_Referenz_0000010.000000000.h5",), ("NACA0012_3D",), _FLEXI),
    Case("hopr", ("reggie_cavity_Re100_State_0000001.000000000.h5",), ("cavity4x4x4",), _FLEXI),
    Case("hopr", ("convcurved_N4_State.h5",), ("convcurved_N4",), _FLEXI),
    Case("hopr", ("pyhope_1-11-cartbox_mixed_mesh.h5",)),
    Case("gmf", ("ball_tetP3_sol4.meshb", "ball_tetP3_sol4.solb"), ("ball_tetP3_sol4",), _GMF),
    Case("gmf", ("ball_tetP3_sol4_ascii.mesh", "ball_tetP3_sol4_ascii.sol"), ("ball_tetP3_sol4_ascii",), _GMF),
    Case("cgns", ("gmsh_ball_tet_o3.cgns",)),
    Case("cgns", ("gmsh_mixed_o2.cgns",)),
    *(Case("exodus", (f"simple-cube-{name}.e",)) for name in ("hex27", "tet10", "multi-element-order2")),
    Case("exodus", ("cylinder-hex-q2.gen",)),
]


def row(case: Case, data: Path) -> list[str]:
    """A line of the table."""
    from elvis.plugins.conversion.converting import convert
    from elvis.plugins.conversion.discovery import choose_converter, installed_converters, with_defaults

    paths = [data / case.folder / name for name in case.files]
    converter = choose_converter(
        [each for each in installed_converters() if each.name == case.converter], paths
    ).converter
    assert converter is not None
    conversion, timing = once(lambda: convert(converter(paths, **with_defaults(converter, case.options)), files=paths))
    report = conversion.report
    orders = sorted({measure.order for measure in report.fields})
    worst = [_share(each) for each in (report.geometry, *report.fields)]
    found = list(_errors(case, data, conversion))
    return [
        case.converter,
        case.files[0] if len(case.files) == 1 else f"{case.files[0]} + {len(case.files) - 1}",
        str(sum(report.elements.values())),
        str(report.geometry.order),
        ", ".join(map(str, orders)) or "-",
        worst[0],
        max(worst[1:], key=lambda text: float(text.split()[0])) if report.fields else "-",
        f"{max(found):.0e}" if found else "-",
        seconds(timing.best),
    ]


def _share(measure: Any) -> str:
    return f"{measure.relative:.0e}" + ("" if measure.is_exact else " projected")


def _errors(case: Case, data: Path, conversion: Conversion) -> Iterator[float]:
    """Of each field that the truth has, the largest difference by place, as a share of its range there."""
    known = {each.name for each in conversion.report.fields}
    for name in case.truth:
        truth = np.load(data / case.folder / f"{name}.truth.npz")
        kept = ~np.isin(truth["shape"], case.left_out)
        for key in (key for key in truth.files if key.startswith("f_")):
            columns: Floats = truth[key].reshape(len(kept), -1)[kept]
            own = case.names.get(key[2:], [key[2:]] if columns.shape[1] == 1 else [f"{key[2:]}_{a}" for a in "xyz"])
            for column, ours in zip(columns.T, own, strict=False):
                if ours in known:
                    found = values_found(conversion.dataset, ours, truth["xyz"][kept])
                    is_found = np.isfinite(found)
                    assert is_found.mean() > (0.9 if case.left_out else 0.999)
                    spread, magnitude = float(np.ptp(column)), float(np.abs(column).max())
                    yield float(np.abs(found - column)[is_found].max() / scale(spread, magnitude))


def table(data: Path) -> Table:
    """All cases."""
    columns = ["converter", "file", "elements", "map", "orders", "map's error", "fields' error", "at truth", "s"]
    shown = Table("Conversions of solvers' files", columns)
    shown.rows = [row(case, data) for case in CASES]
    shown.notes = [
        "Errors: the largest that the report announces, as a share of the mesh's diagonal and of a field's range; "
        "exact to rounding unless said otherwise. At truth: difference to the solver's own values at its points, "
        "searched for by place. Seconds: reading, projection, check."
    ]
    return shown


if __name__ == "__main__":
    print(table(Path(sys.argv[1])).text())
