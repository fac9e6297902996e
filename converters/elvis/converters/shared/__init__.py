"""What readers of several formats share: careful opening of files and HDF5, libraries in processes of their own.

May be imported by every reader and command of the converters.
"""
