"""All cases of the kit, by name, from simple to complex, and the level of each."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache

from ...models.errors import InputError, counted
from .answers import Answer
from .case import LEVELS, Case
from .cases import beliefs, continuous, likelihood, limits, moves, strategies
from .dataset.version import KIT_VERSION
from .exact import Exact
from .tolerance import Precision


@dataclass(frozen=True, eq=False)
class Kit:
    """Cases with a version.

    Attributes:
        version: Of the kit.
        cases: By name.
        sizes: Number of cases of the whole kit by level; a folder may hold some of them.
        precision: For which the tolerances are; `None` for any.
        unknown: Number of cases in a folder of levels that this version does not know.
    """

    version: str
    cases: Mapping[str, Case]
    sizes: Mapping[str, int]
    precision: Precision | None = None
    unknown: Mapping[str, int] = field(default_factory=dict)

    @property
    def sentences(self) -> list[str]:
        """What cannot be asked of the kit."""
        return [
            f"Left out: {counted(n, 'case')} of level {level!r}, which this version of solidtouch does not know."
            for level, n in self.unknown.items()
        ]

    def select(self, names: Sequence[str] = (), levels: Sequence[str] = ()) -> list[Case]:
        """The cases of these names and levels, or all where neither is given.

        Raises:
            InputError: There is no such case or level.
        """
        names, levels = listed("names", names), listed("levels", levels)
        for name in names:
            if not isinstance(name, str) or name not in self.cases:
                raise InputError(f"case {name}: there is no such case; `solidtouch conformance list` shows all.")
        for level in levels:
            if level not in LEVELS:
                raise InputError(f"level {level}: it must be one of {', '.join(LEVELS)}.")
        if not names and not levels:
            return list(self.cases.values())
        named = [self.cases[name] for name in dict.fromkeys(names)]
        return named + [case for case in self.cases.values() if case.level in levels and case.name not in names]


def listed(argument: str, given: Iterable[str]) -> tuple[str, ...]:
    """What an argument lists.

    Raises:
        InputError: It is a text or no list.
    """
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise InputError(f"{argument} must be a list, got {given!r}.")
    return tuple(given)


@lru_cache(maxsize=1)
def own_kit() -> Kit:
    """The kit of this version of the package."""
    cases = {case.name: case for case in _cases()}
    return Kit(KIT_VERSION, cases, Counter(case.level for case in cases.values()))


def catalogue() -> Mapping[str, Case]:
    """Every case by name."""
    return own_kit().cases


def _cases() -> Iterable[Case]:
    for group in (likelihood, beliefs, moves):
        for case in group.cases():
            yield replace(case, level=_level(case))
    for level, group in (("limits", limits), ("continuous", continuous), ("strategies", strategies)):
        for case in group.cases():
            yield replace(case, level=level)


def _level(case: Case) -> str:
    """What a case asks of a program beyond the equations one by one."""
    holes = case.probabilities is not None and not case.probabilities.any(axis=(2, 3)).all()
    if case.border != "uniform" or holes:
        return "borders"
    return "episodes" if len(case.equations) == 10 else "core"


@cache
def expected(case: Case) -> list[Answer]:
    """The right answers to a case."""
    if case.pinned is not None:
        return list(case.pinned.answers)
    return list(Exact(case).answers())
