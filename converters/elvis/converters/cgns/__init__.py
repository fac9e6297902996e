"""CGNS files, in both containers."""
