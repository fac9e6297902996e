"""The settings of a scene, each described once, and scene files.

It imports nothing else of the scene.
"""
