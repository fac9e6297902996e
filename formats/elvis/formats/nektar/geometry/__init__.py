"""Meshes of the native format, in XML and HDF5."""
