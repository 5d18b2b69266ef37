"""Records shared by the JSON files of several studies."""

from typing import TypedDict


class GridRecord(TypedDict):
    """Numbers of position and object classes."""

    L: int
    M: int


class UnitsRecord(TypedDict):
    """Units of errors."""

    what: str
    where: str


class TitleRecord(TypedDict):
    """Title and command."""

    title: str
    command: str
