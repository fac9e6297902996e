"""``elvis info``: the contents of a dataset, its extrema, mesh quality and resolution."""
