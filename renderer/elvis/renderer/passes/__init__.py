"""The passes: each draws one kind of thing into a layer, with its kernels beside its Python."""
