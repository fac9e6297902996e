"""Bases, expansions and their values, quadrature, Bernstein bounds."""
