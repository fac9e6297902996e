"""Names of composites that XML files give only in comments: ``<B ID="0"> C[2] </B> <!-- Wall -->``.

Nektar++ identifies boundary composites by number, so people write their meaning behind them, on the same line.  The
scanner of elements ignores comments; this module searches for them behind the entries of COMPOSITE and BOUNDARYREGIONS.
Attributes NAME of the regions are found with the session (`elvis.formats.nektar.session`).
"""

from __future__ import annotations

import re
from dataclasses import replace

from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import Mesh
from elvis.formats.nektar.composites import composite_ids
from elvis.formats.nektar.xml import Buffer

_BEHIND = re.compile(rb"</([BC])\s*>[ \t]*<!--([^\r\n]*?)-->")
_OPENING = re.compile(rb"<[BC]\s[^<>]*\bID\s*=\s*[\"']\s*([0-9]{1,18})\s*[\"'][^<>]*>")
#: characters of a name at most: more is a remark
_LONGEST = 40

#: for a composite, or the composites of a boundary region: the text of their list, or a number, and the name
Remark = tuple[bytes, str]


def read_remarks(data: Buffer) -> list[Remark]:
    """Lists of composites as ``C[2-3]``, and what the comments behind their entries call them, in file order."""
    if b"!" not in data or b"<!--" not in data:
        return []
    found = []
    for match in _BEHIND.finditer(data):
        name = " ".join(match[2].decode("utf-8", "replace").split()).strip("-/!# ")
        start = data.rfind(b"<" + match[1], 0, match.start())
        opening = _OPENING.match(data, start) if start >= 0 else None
        if opening is None or not name or len(name) > _LONGEST or name.isdigit() or "," in name or "<" in name:
            continue
        content = bytes(data[opening.end() : match.start()])
        found.append((content if match[1] == b"B" else opening[1], name))
    return found


def with_remarks(mesh: Mesh, remarks: list[Remark]) -> Mesh:
    """The mesh, whose composites without a name are labelled; the first remark on one counts."""
    labels: dict[int, str] = {}
    for text, name in remarks:
        try:
            ids = composite_ids(text)
        except FormatError:
            continue
        for composite in mesh.composites:
            if bool(((ids.first <= composite.id) & (composite.id <= ids.last)).any()):
                labels.setdefault(composite.id, name)
    if not labels:
        return mesh
    labelled = (replace(each, label=None if each.name else labels.get(each.id)) for each in mesh.composites)
    return replace(mesh, composites=tuple(labelled))
