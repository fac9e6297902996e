"""A picture and its exact record in twenty lines: `python examples/first_picture.py` after `make demo`."""

from __future__ import annotations

from elvis import Plane, Scene, read, render

dataset = read("out/data/bend.xml", "out/data/bend.fld")
scene = Scene(
    field="speed",
    plane=Plane(point=(1.4, 1.4, 0.0), normal=(-1.0, 1.0, 0.0)),
    size=(800, 800),
    palette="magma",
    range=(0.0, 1.25),
)
frame = render(dataset, scene)
frame.save("out/first_picture.png")

# The record tells, at every pixel, the value, the element, and how certain both are
middle = (400, 400)
print(f"speed {frame.field[middle]:.12f} in element {frame.element[middle]} at {frame.position[middle]}")
print(frame.counts())
