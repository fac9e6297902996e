"""Arrows and cones: solids between two discs, met by each pixel's ray in closed form."""
