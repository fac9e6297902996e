"""The settings of a scene, each described once, and scene files."""
