"""Files of true values at points, as other programs compute them."""

import numpy as np


def truth_values(path):
    """Coordinates (n, d) and fields (n, f) of a truth file, and the names of the fields."""
    lines = path.read_text().splitlines()
    names = next(line for line in lines if line.startswith("FIELDS")).split()[1:]
    rows = [line.split("|")[1:] for line in lines if line.count("|") == 2 and not line.startswith("E")]
    return np.array([r[0].split() for r in rows], float), np.array([r[1].split() for r in rows], float), names
