"""Tasks that run anywhere and what becomes of them."""

import time
import traceback
from collections.abc import Callable, Generator, Iterator
from typing import Any, NamedTuple, Protocol


class Task(Protocol):
    """A piece of work that needs nothing of the others."""

    @property
    def number(self) -> int:
        """Its number, which no other task has."""
        ...

    @property
    def data(self) -> str:
        """Name of the data that it shares with others."""
        ...


class Outcome(NamedTuple):
    """What became of a task.

    Attributes:
        number: Of the task.
        values: Its result; `None` where it failed.
        seconds: How long it took.
        traceback: Why it failed.
    """

    number: int
    values: Any
    seconds: float
    traceback: str = ""


type Work = Callable[[Any, Any], Any]
"""Gives the result of a task, from the task and its data."""

type Load = Callable[[str], Any]
"""Gives data by their name."""

type Runner = Callable[[Iterator[Any], Work, Load], Generator[Outcome]]
"""Runs tasks, neighbours of which share data, in any order and places, and yields outcomes as they come; closing it
stops everything."""


def attempt(task: Task, work: Work, data: Any) -> Outcome:
    """The outcome of a task, whatever it raises."""
    began = time.perf_counter()
    try:
        values, failure = work(task, data), ""
    except Exception:  # a task that fails must not end the others
        values, failure = None, traceback.format_exc()
    return Outcome(task.number, values, time.perf_counter() - began, failure)
