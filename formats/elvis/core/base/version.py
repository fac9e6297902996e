"""The version of the installed distribution."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("elvis-viz")
except PackageNotFoundError:  # the folders are on Python's path and nothing is installed
    __version__ = "0"
