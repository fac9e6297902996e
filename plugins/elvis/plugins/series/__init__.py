"""Series: the steps of a solution in time, found among files, and the interpolation between them."""
