"""Mapping from reference to world and back: entities and orientations, blending of curves, inverse, point location."""
