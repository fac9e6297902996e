"""Files of the Gamma mesh format (.mesh, .meshb, .sol, .solb)."""
