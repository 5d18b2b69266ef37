"""Reads all of a classic netCDF file, to find out whether that takes too long or too much memory."""

from scipy.io import netcdf_file


def read(path: str) -> None:
    """Reads the file."""
    with netcdf_file(path, mmap=False) as file:
        for variable in file.variables.values():
            _ = variable.shape
