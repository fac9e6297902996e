"""Compiled kernels: their cache between processes, and messages about kernels that fail to compile."""
