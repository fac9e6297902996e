"""One theorem for all bounds: values lie within them, and some come near their ends.

A claim is a function of a random generator that yields pairs (found, bound).  Operands have radii of order one and
errors of 0.1, and values are taken at their corners, so that no term of a bound is small next to the others.
"""

import numpy as np

#: part of a bound that a value reaches at least: a bound isn't so wide that a term could be missing unseen
TEETH = 0.5
#: a value and a bound that it attains are rounded a few times each
ATTAINED = 1 + 1e-13


def check(claim, teeth=TEETH):
    """Inclusion for all pairs, and teeth for one."""
    nearest = []
    for found, bound in claim(np.random.default_rng(7)):
        assert (found <= bound * ATTAINED).all(), (found / bound).max()
        nearest.append(float((found / bound).max()))
    assert max(nearest) > teeth, nearest
