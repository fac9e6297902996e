"""Where a scene is seen from.

It may import the model.
"""
