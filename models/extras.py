"""What not every installation has: packages that come with an extra of this one, and modules that Windows lacks."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from .errors import InputError


class MissingPackageError(InputError):
    """A package of an extra is not installed."""


class Extra(NamedTuple):
    """Where a package comes from.

    Attributes:
        use: What needs it, the subject of a sentence.
        package: Its name in an index.
        name: The extra.
    """

    use: str
    package: str
    name: str


EXTRAS = {
    "anywidget": Extra("st.view in a notebook", "anywidget", "notebook"),
    "distributed": Extra("A Dask cluster (--scheduler)", "distributed", "cluster"),
    "mcap": Extra("An MCAP file", "mcap", "rig"),
    "mcap_ros2": Extra("A message of ROS 2", "mcap-ros2-support", "formats"),
    "pyarrow": Extra("A Parquet, Arrow or Feather file", "pyarrow", "formats"),
    "serial": Extra("A rig, real or emulated,", "pyserial", "rig"),
    "sklearn": Extra("TapClassifier", "scikit-learn", "sklearn"),
}
"""By the name that is imported."""


def missing(module: str) -> str:
    """The sentence for a package that is not installed.

    >>> missing("serial")
    "A rig, real or emulated, needs pyserial: pip install 'solidtouch[rig]'."
    """
    use, package, name = EXTRAS[module]
    return f"{use} needs {package}: pip install 'solidtouch[{name}]'."


@contextmanager
def extra(module: str) -> Iterator[None]:
    """Imports of a package of an extra, and of what it brings.

    Raises:
        MissingPackageError: It is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingPackageError(missing(module)) from error


@contextmanager
def posix(use: str) -> Iterator[None]:
    """Imports of modules of Python that Windows lacks.

    Args:
        use: What needs them, the subject of a sentence.

    Raises:
        InputError: This system lacks them.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(f"{use} needs Linux or macOS; this is {sys.platform}.") from error
