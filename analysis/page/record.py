"""What the JSON files of several studies hold under the same names."""

from typing import TypedDict


class GridRecord(TypedDict):
    """Numbers of where and what classes."""

    L: int
    M: int


class UnitsRecord(TypedDict):
    """Units of errors."""

    what: str
    where: str


class TitleRecord(TypedDict):
    """What was asked for."""

    title: str
    command: str
