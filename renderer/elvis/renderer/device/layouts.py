"""Memory layouts of kernels' input and output, from Slang's reflection."""

from __future__ import annotations

from typing import Any

import numpy as np


def dtype_of(layout: Any, is_in_c: bool) -> np.dtype[Any]:
    """Dtype of a reflected struct, array, vector or scalar.

    is_in_c  whether kernels are compiled as C++, in which members after a struct begin after its padding; for data read
             through pointers Slang states the offsets of other targets, in the padding
    """
    import slangpy

    kinds, reflected = slangpy.TypeReflection.Kind, layout.type
    if reflected.kind == kinds.struct:
        fields = [(field.name, dtype_of(field.type_layout, is_in_c), field.offset) for field in layout.fields]
        if is_in_c:
            members = [(name, own) for name, own, _ in fields]
            return np.dtype(members, align=True)
        names, formats, offsets = (list(column) for column in zip(*fields, strict=True))
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": layout.stride})
    if reflected.kind == kinds.array:
        return np.dtype((dtype_of(layout.element_type_layout, is_in_c), (reflected.element_count,)))
    return np.dtype((reflected.scalar_type.name, (reflected.col_count,) if reflected.kind == kinds.vector else ()))
