"""Elements with several of a plugin's fields: one copy of its module per field, with buffers of its own.

The text of the module is changed by regular expressions, since generics can't do it: an element type receives only the
index of its element, and reads buffers that are globals of its module, one set for a program.  A generic parameter
chooses types and constants, not globals; Slang has no modules with parameters; and two copies of a module under
different names have globals of equal names, which are bound by name.  Pointers make no difference as long as they are
globals as well.  The alternative is element types that receive their buffers, another interface for all plugins.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from elvis.plugins.runtime.volume import Part

_HEAD = re.compile(r"^[ \t]*(?:module|import)\s+[\w.]+\s*;", re.M)
_IMPORT = re.compile(r"^[ \t]*import\s+[\w.]+\s*;", re.M)

_SOURCE = """
struct Joined : IVolume
{{
    static const bool affine = field0::Element.affine;
    uint number;
    __init(uint number) {{ this.number = number; }}
    Frame frame(double3 r) {{ return field0::Element(number).frame(r); }}
    double value(double3 r)
    {{
        uint element = number / {count}u;
        switch (number % {count}u)
        {{
        {values}
        }}
    }}
    double3 gradient(double3 r)
    {{
        uint element = number / {count}u;
        switch (number % {count}u)
        {{
        {gradients}
        }}
    }}
    static double margin(double3 r) {{ return field0::Element.margin(r); }}
    static double3 center() {{ return field0::Element.center(); }}
    static uint hull_count() {{ return field0::Element.hull_count(); }}
    static double3 hull(uint element, uint k) {{ return field0::Element.hull(element, k); }}
}}
"""


def join_fields(parts: Sequence[Part], folder: Path) -> tuple[str, str, Mapping[str, NDArray[Any]]]:
    """Type, source and buffers of elements whose number e M + m has the field of part m of M, on the map of element e.

    parts  the same elements with different fields
    """
    heads, bodies, buffers = dict[str, None](), list[str](), dict[str, NDArray[Any]]()
    for m, part in enumerate(parts):
        text = (folder / f"{part.module}.slang").read_text(encoding="utf-8")
        declared = [name for name in part.buffers if re.search(rf"(?:>|\*)\s*{name}\s*;", text)]
        heads.update(dict.fromkeys(found.strip() for found in _IMPORT.findall(text + "\n" + part.source)))
        heads.update(dict.fromkeys(re.findall(r"import\s+[\w.]+\s*;", part.source)))
        rest = re.sub(r"import\s+[\w.]+\s*;", "", part.source)
        body = f"{_HEAD.sub('', text)}\n{rest}\ntypealias Element = {part.type};"
        for name in declared:
            body = re.sub(rf"\b{name}\b", f"{name}_of_{m}", body)
        bodies.append(f"namespace field{m}\n{{\n{body}\n}}")
        buffers |= {f"{name}_of_{m}" if name in declared else name: array for name, array in part.buffers.items()}
    values, gradients = (_cases(len(parts), asked) for asked in ("value", "gradient"))
    text = _SOURCE.format(count=len(parts), values=values, gradients=gradients)
    return "Joined", "\n".join([*heads, *bodies, text]), buffers


def _cases(count: int, asked: str) -> str:
    """Labels of a switch, each of which evaluates the element of one field; the last one is the default."""
    labels = [f"case {m}:" for m in range(count - 1)] + ["default:"]
    return "\n        ".join(f"{label} return field{m}::Element(element).{asked}(r);" for m, label in enumerate(labels))
