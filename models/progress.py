"""Progress of long work, as all functions report it."""

from collections.abc import Callable
from typing import Any

type Progress = Callable[[str, int], Callable[[int], None]]
"""Called with the name and size of a stage; returns the function that advances it."""


def no_progress(stage: str, total: int) -> Callable[[int], None]:  # noqa: ARG001 - the signature of Progress
    """Shows nothing."""
    return lambda done: None  # noqa: ARG005


def silent(*told: object) -> Callable[..., Any]:  # noqa: ARG001 - whatever is told
    """Shows nothing, as a `Progress` or as what advances one."""
    return silent


class ShownHere:
    """Progress that is shown in this process; a copy in another process shows nothing.

    Attributes:
        show: A `Progress`, or what advances one.
    """

    def __init__(self, show: Callable[..., Any] = silent) -> None:
        self.show = show

    def __call__(self, *told: Any) -> Any:
        """Passes on what is told."""
        return self.show(*told)

    def __reduce__(self) -> tuple[Any, ...]:
        return ShownHere, ()
