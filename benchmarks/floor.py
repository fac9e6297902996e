"""The arithmetic floor of a frame: the floating point operations that cannot be avoided, at the machine's peak.

A pixel inside an element takes Newton steps on the map and one evaluation of the field.  What is counted:

    pixel  = steps * (3 (2 m + 2 m_x + 2 m_y + 2 m_z) + SOLVE) + 2 f
    steps  = 1 for straight tetrahedra, whose maps are affine, else 2: one from a good guess, one to see it was enough

with m coefficients of the map (position), m_x, m_y, m_z of its three derivatives, f of the field.  Every polynomial is
taken by Horner's rule, one product and one sum a coefficient, which is optimal for general coefficients (Pan 1966,
Methods of computing values of polynomials).  Elements, guesses, outside pixels, memory and colours cost nothing here.
"""

from __future__ import annotations

from math import comb

import numpy as np
from cases import Case
from measuring import Timing

from elvis import Shape
from elvis.renderer.device.adapters import open_device

#: operations of a 3 x 3 solve by Cramer's rule (3 cross products of 9, 4 scalar products of 5, a division, 3 products)
#: with the residual (3) and the update (3)
SOLVE = 57

#: multiplications and additions of a thread of the Vulkan test: a loop of CHAINS independent multiply-adds
CHAINS, TURNS, THREADS = 16, 2048, 1 << 15
KERNEL = f"""
static const int CHAINS = {CHAINS}, TURNS = {TURNS};
RWStructuredBuffer<double> result;
[shader("compute")] [numthreads(64, 1, 1)]
void rate(uint3 id : SV_DispatchThreadID)
{{
    double sums[CHAINS] = {{}}, x = 1.0lf - 1e-9lf * double(id.x & 7u), y = 1e-9lf;
    [ForceUnroll] for (int k = 0; k < CHAINS; ++k) sums[k] += double(k);
    [loop] for (int n = 0; n < TURNS; ++n)
    {{
        [ForceUnroll] for (int k = 0; k < CHAINS; ++k) sums[k] = fma(sums[k], x, y);
    }}
    double total = 0.0lf;
    [ForceUnroll] for (int k = 0; k < CHAINS; ++k) total += sums[k];
    result[id.x] = total;
}}
"""


def coefficients(shape: Shape, degree: int) -> int:
    """Number of coefficients of a polynomial of the shape's space; none below degree 0."""
    if degree < 0:
        return 0
    if shape is Shape.TETRAHEDRON:
        return comb(degree + 3, 3)
    return comb(degree + 2, 2) * (degree + 1) if shape is Shape.PRISM else (degree + 1) ** 3


def derivatives(shape: Shape, degree: int) -> int:
    """Number of coefficients of the three partial derivatives together."""
    if shape is Shape.TETRAHEDRON:
        return 3 * coefficients(shape, degree - 1)
    if shape is Shape.PRISM:
        return 2 * comb(degree + 1, 2) * (degree + 1) + comb(degree + 2, 2) * degree
    return 3 * degree * (degree + 1) ** 2


def operations(case: Case) -> int:
    """Floating point operations of a pixel inside (see the head of this module)."""
    shape, degree = case.shape, case.degree
    steps = 1 if shape is Shape.TETRAHEDRON and degree == 1 else 2
    step = 6 * (coefficients(shape, degree) + derivatives(shape, degree)) + SOLVE
    return steps * step + 2 * coefficients(shape, case.order)


def coefficients_of(degree: int, dimension: int) -> int:
    """Number of coefficients of a polynomial of total degree in two or three coordinates; none below degree 0."""
    return comb(degree + dimension, dimension) if degree >= 0 else 0


def simplicial(degree: int, dimension: int) -> int:
    """Operations of a Newton step on the map of a triangle or tetrahedron: position, derivatives and solve."""
    return 6 * (coefficients_of(degree, dimension) + dimension * coefficients_of(degree - 1, dimension)) + SOLVE


def peaks(device: str) -> dict[str, float]:
    """Double precision operations a processor second, so of a core: NumPy's matrix product, multiply-adds in a kernel.

    On a GPU, whose work takes no processor time, a second by the clock counts.
    """
    return {"blas": _blas(), "device": _device(device)}


def _blas(size: int = 1024, runs: int = 5) -> float:
    a, timing = np.random.default_rng(0).random((size, size)), Timing()
    for _ in range(runs):
        timing.run(lambda: a @ a)
    return 2.0 * size**3 / timing.effort


def _device(name: str, runs: int = 5) -> float:
    """The rate of independent multiply-adds in a kernel."""
    import slangpy

    choice = open_device(name)
    adapter, device = choice.adapter, choice.device
    try:
        program = device.link_program(
            [module := device.load_module_from_source("rate", KERNEL)], [module.entry_point("rate")]
        )
        kernel = device.create_compute_kernel(program)
        usage = slangpy.BufferUsage.unordered_access
        result = device.create_buffer(element_count=THREADS, struct_size=8, usage=usage)

        def work() -> None:
            kernel.dispatch(slangpy.uint3(THREADS, 1, 1), vars={"result": result})
            device.wait()

        work()
        timing = Timing()
        for _ in range(runs):
            timing.run(work)
    finally:
        device.close()
    return 2.0 * CHAINS * TURNS * THREADS / (timing.effort if adapter.software else timing.best)
