"""Devices, their memory and their kernels."""
