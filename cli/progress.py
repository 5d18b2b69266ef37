"""Progress bars for the stages of long commands."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


def progress_bars() -> "Progress":
    """Bars with name, count, elapsed and remaining time, on standard error."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    columns = (TextColumn("{task.description:32}"), BarColumn(20), MofNCompleteColumn(), *times)
    return Progress(*columns, console=Console(stderr=True))


@contextmanager
def bars() -> Iterator[Callable[[str, int], Callable[[int], None]]]:
    """A function that starts the bar of a stage and gives the function that advances it."""
    with progress_bars() as progress:

        def stage(name: str, total: int) -> Callable[[int], None]:
            task = progress.add_task(name, total=total)
            return lambda done: progress.advance(task, done)

        yield stage
