"""Compiled kernels: how they are kept between processes, and what is said when one can't be compiled."""
