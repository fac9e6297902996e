"""The passes: each draws one kind of thing into a hit buffer, with its kernels beside its Python."""
