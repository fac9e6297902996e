"""Families of cases by name; the pages of the modules say what each is about."""

from audit.families import cuts, faces, isosurfaces

#: functions of a random generator and the size of the picture, and that size in a long run
FAMILIES = {
    "cuts": (cuts.case, (500, 400)),
    "faces": (faces.case, (360, 300)),
    **{name: (case, (160, 120)) for name, case in isosurfaces.FAMILIES.items()},
}
