"""Whether elements fold: the sign of the Jacobian determinant, proved by bounds."""
