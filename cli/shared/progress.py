"""Progress bars for the stages of long commands."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

_REFRESHES = 4  # in a second
LINE_S = 30.0
"""Time in seconds between two lines of progress without a terminal."""


def progress_bars() -> "Progress":
    """Progress bars with name, count, elapsed and remaining time, on standard error."""
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
    columns = (TextColumn("{task.description:32}"), BarColumn(8), MofNCompleteColumn(), *times)
    console = Console(stderr=True)
    # Each refresh takes the time of a short task of a study; without a terminal nothing would be shown.
    return Progress(*columns, console=console, refresh_per_second=_REFRESHES, auto_refresh=console.is_terminal)


@contextmanager
def bars() -> Iterator[Callable[[str, int], Callable[[int], None]]]:
    """Function that starts the bar of a stage and returns the function that advances it.

    Nothing is shown before the first stage. Without a terminal, long stages print occasional lines on standard error.
    """
    with ExitStack() as shown:
        progress = progress_bars()

        def stage(name: str, total: int) -> Callable[[int], None]:
            if not progress.tasks:
                shown.enter_context(progress)
            task = progress.add_task(name, total=total)
            began = said = time.monotonic()

            def advance(done: int) -> None:
                nonlocal said
                progress.advance(task, done)
                now, finished = time.monotonic(), progress.tasks[task].completed
                if not progress.console.is_terminal and now - said > LINE_S:
                    said = now
                    left = _about((now - began) * (total - finished) / finished) if 0 < finished < total else ""
                    progress.console.print(f"{name}: {finished:.0f} of {total}{left}", highlight=False, markup=False)

            return advance

        yield stage


def _about(seconds: float) -> str:
    """What is left, in words; nothing below a second."""
    if seconds < 1:
        return ""
    return f", about {seconds:.0f} s left" if seconds < 120 else f", about {seconds / 60:.0f} min left"
