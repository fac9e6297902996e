"""Series: the steps of a solution in time, found among files, and what lies between them."""
