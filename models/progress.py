"""Progress of long work, as all functions report it."""

from collections.abc import Callable

type Progress = Callable[[str, int], Callable[[int], None]]
"""Called with the name and size of a stage; returns the function that advances it."""


def no_progress(stage: str, total: int) -> Callable[[int], None]:  # noqa: ARG001 - the signature of Progress
    """Shows nothing."""
    return lambda done: None  # noqa: ARG005
