"""What a mesh must say before it is written: a domain, of composites that exist (format notes 9)."""

from __future__ import annotations

from dataclasses import replace

from elvis.core.mesh import Composite, Mesh


def with_domain(mesh: Mesh) -> Mesh:
    """The mesh with a domain: where it names none, every element, in one new composite a shape."""
    if any(mesh.domains.values()):
        return mesh
    free = max((composite.id for composite in mesh.composites), default=-1) + 1
    shapes = enumerate(mesh.elements.items(), free)
    added = tuple(Composite(id, ((shape.tag, entities.ids),)) for id, (shape, entities) in shapes)
    domains = {0: tuple(composite.id for composite in added)}
    return replace(mesh, composites=(*mesh.composites, *added), domains=domains)


def written_composites(mesh: Mesh) -> list[Composite]:
    """The composites that hold anything; the format has no empty ones."""
    found = []
    for composite in mesh.composites:
        parts = tuple((tag, ids) for tag, ids in composite.parts if len(ids))
        if parts:
            found.append(replace(composite, parts=parts))
    return found
