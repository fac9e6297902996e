"""The passes: each draws one kind of object into a hit buffer, with its kernels next to its Python."""
