"""Live objects as datasets: arrays, NGSolve, MFEM, Blueprint, and datasets for other libraries of Python.

They use the readers; no reader uses them.
"""
