"""What a plugin author sees: the protocols, and the discovery of plugins by entry points.

``registry`` finds plugins of any distribution; ``command`` is the ``elvis`` command, made of the commands it finds.
"""
