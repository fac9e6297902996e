"""Names of fields that come from arrays of several components."""

from __future__ import annotations

_XYZ = "xyz"


def components(name: str, count: int) -> list[str]:
    """Names of the components of an array: letters for vectors and tensors, numbers for anything else."""
    if count == 1:
        return [name]
    if count in (2, 3):
        return [f"{name}_{axis}" for axis in _XYZ[:count]]
    if count in (4, 9):
        axes = _XYZ[: 2 if count == 4 else 3]
        return [f"{name}_{a}{b}" for a in axes for b in axes]
    return [f"{name}_{i}" for i in range(count)]
