"""All cases of the kit, by name, from simple to complex."""

from collections.abc import Sequence
from functools import cache, lru_cache

from ...models.errors import InputError
from .answers import Answer
from .case import Case
from .cases import beliefs, likelihood, limits, moves
from .exact import Exact


@lru_cache(maxsize=1)
def catalogue() -> dict[str, Case]:
    """Every case by name."""
    groups = (likelihood, beliefs, moves, limits)
    return {case.name: case for group in groups for case in group.cases()}


def select(names: Sequence[str]) -> list[Case]:
    """The cases of these names, or all where there is none.

    Raises:
        InputError: There is no such case.
    """
    known = catalogue()
    for name in names:
        if name not in known:
            raise InputError(f"--case {name}: there is no such case; `solidtouch conformance list` shows all.")
    return [known[name] for name in names] if names else list(known.values())


@cache
def expected(case: Case) -> list[Answer]:
    """The right answers to a case."""
    return list(Exact(case).answers())
