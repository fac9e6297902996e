"""Families of cases by name; the pages of the modules say what each is about."""

from audit.families import (
    contours,
    cuts,
    differences,
    expressions,
    faces,
    folds,
    isosurfaces,
    kinks,
    lines,
    poles,
    probes,
    rings,
    volumes,
    waves,
)

#: a function of a random generator and a picture's size, that size in a long run, and a share of the pixels: elements
#: and light are slow
FAMILIES = {
    "cuts": (cuts.case, (500, 400), 1.0),
    "faces": (faces.case, (360, 300), 1.0),
    **{name: (case, (160, 120), 1.0) for name, case in {**isosurfaces.FAMILIES, **poles.FAMILIES}.items()},
    **{name: (case, (240, 200), 1.0) for name, case in contours.FAMILIES.items()},
    **{name: (case, (160, 120), 0.3) for name, case in expressions.FAMILIES.items()},
    "volumes": (volumes.case, (120, 100), 0.5),
    "volumes: kinks": (kinks.case, (60, 50), 0.1),
    "waves": (waves.case, (360, 300), 0.5),
    "rings": (rings.case, (200, 160), 0.5),
    "folded faces": (folds.faces_case, (200, 160), 0.5),
    "ranges of expressions": (expressions.range_case, (1, 1), 1e-4),
    "validity": (folds.validity_case, (1, 1), 1e-3),
    "probes": (probes.case, (200, 200), 1.0),
    "lines": (lines.case, (1, 1), 1e-2),
    "differences": (differences.case, (60, 60), 1e-2),
}
