"""Cameras of a scene: views, automatic cameras, camera paths."""
