"""Element faces: where they lie in their elements, their maps as Bernstein nets, neighbours, names."""

from __future__ import annotations

from elvis.plugins.faces.choice import faces_of
from elvis.plugins.faces.dataset_faces import native_faces
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.faces.hexahedra import Hexahedra, hexahedron_faces, vertices_at

__all__ = ["FaceBlock", "Faces", "Hexahedra", "faces_of", "hexahedron_faces", "native_faces", "vertices_at"]
