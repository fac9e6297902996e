"""Choice of the faces for given data."""

from __future__ import annotations

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.plugins.faces.dataset_faces import native_faces
from elvis.plugins.faces.derived import derived_faces
from elvis.plugins.faces.faces import Faces
from elvis.plugins.faces.lines import line_faces
from elvis.plugins.runtime.host.evaluation import host_evaluations
from elvis.plugins.runtime.volume import Volume


def faces_of(dataset: Dataset | None, volume: Volume) -> Faces:
    """The faces of a volume's elements.

    dataset  from which the volume was made; None for a runtime plugin's own, which then provides its faces itself
    ElvisError if it provides none.
    """
    if dataset is not None:
        extruded = dataset.mesh.dimension == 2 and volume.dimension == 3
        periods = [np.asarray(part.buffers["period"]) for part in volume.parts if "period" in part.buffers]
        length = float(periods[0][0]) if extruded and periods else None
        if dataset.mesh.dimension == 1:
            return line_faces(dataset, volume)
        return native_faces(dataset, [part.element_ids for part in volume.parts], length)
    give = getattr(volume, "faces", None)
    if give is None:
        hosts = host_evaluations(volume)
        if hosts is None:
            wanted = "or the shape and `evaluate` of its parts"
            raise ElvisError(f"the plugin provides no element faces, {wanted}, so none can be drawn")
        return derived_faces(hosts)
    faces: Faces = give()
    return faces
