"""Helpers of several readers: opening files and HDF5, running libraries in separate processes, spaces of elements."""
