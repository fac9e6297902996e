"""Make the sample data: solutions whose every detail is known, on curved meshes.

    python examples/generate.py [FOLDER]        writes them into FOLDER (default: out/data)

cylinder  2D, triangles of a quadratic map, field order 8: potential flow past a cylinder with circulation
bend      3D, hexahedra of a quartic map, field order 5: flow with two vortices through a curved duct
blocks    3D, all four volume shapes in one mesh, quadratic map, field order 6
eddies    2D, quadrilaterals of order 7, as NekRS and Nek5000 write them: Walsh's eddies, which only decay

All but the last in the native format.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from elvis.core.polynomials.quadrature import lobatto
from elvis.plugins.samples.sample import write_sample


def eddies(path: Path, cells: int = 8, order: int = 7) -> None:
    """Eddies of Walsh (1992), a flow that only decays, on a wavy mesh of cells^2 elements, in Nek's format.

    Its stream function 0.2 (cos 5x + cos 5y) + 0.3 sin 3x sin 4y is one of the Laplacian's, to the eigenvalue -25.
    """
    nodes = (np.arange(cells)[:, None] + (lobatto(order + 1)[0] + 1) / 2) / cells
    s, t = np.broadcast_arrays(nodes[None, :, None, :], nodes[:, None, :, None])
    wave = 0.03 * np.sin(2 * np.pi * s) * np.sin(2 * np.pi * t)
    x, y = 2 * np.pi * (s + wave), 2 * np.pi * (t + wave)
    u = -np.sin(5 * y) + 1.2 * np.sin(3 * x) * np.cos(4 * y)
    v = np.sin(5 * x) - 0.9 * np.cos(3 * x) * np.sin(4 * y)
    # element by element, first all x, then all y; the number tells the order of bytes
    count = cells**2
    head = f"#std 8 {order + 1:2d} {order + 1:2d}  1 {count:10d} {count:10d} {0.0:20.13E} {0:9d}      0      1 XU"
    parts = [np.stack([part.reshape(count, -1) for part in pair], axis=1) for pair in ((x, y), (u, v))]
    content = [
        np.array([6.54321], "<f4"),
        np.arange(1, count + 1, dtype="<i4"),
        *(part.astype("<f8") for part in parts),
    ]
    path.write_bytes(head.ljust(132).encode() + b"".join(part.tobytes() for part in content))


def main(folder: Path) -> None:
    """Write every sample as NAME.xml and NAME.fld, and one as Nek does."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("cylinder", "bend", "blocks"):
        write_sample(name, folder)
    eddies(folder / "eddies0.f00000")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the sample data: solutions whose every detail is known.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("out/data"), help="default: out/data")
    main(parser.parse_args().folder)
