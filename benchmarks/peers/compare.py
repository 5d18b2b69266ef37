"""Published examples of hmmlearn, dynamax and pymdp through this project's updates and moves.

    python -m benchmarks.peers.compare --document docs/explanation/peers.md

Packages that are not installed are left out: for dynamax `pip install --pre --group peers`, for pymdp a Python that has
it, in the variable SOLIDTOUCH_PYMDP_PYTHON.
"""

import os
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from importlib.metadata import version
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.page import parsed, table, write_block
from benchmarks.peers import packages
from benchmarks.peers.examples import Example, active_examples, examples
from benchmarks.peers.paths import States, by_moves, by_paths, by_steps

BLOCK = "peers"
AGREES = 1e-10
"""Largest difference from a package."""
DRAWN = (
    ("filter", "test_hmm_filter", 3, 2, False),
    (
        "smoother, most probable path",
        "test_hmm_smoother, test_hmm_posterior_mode, test_compute_transition_probs",
        5,
        2,
        False,
    ),
    ("matrices that change", "test_two_filter_vs_smoother_nonstationary", 6, 3, True),
)
"""Tests of dynamax that draw their arguments: name, test, observations, states, whether matrices change."""


class Compared(NamedTuple):
    """An example and what was found.

    Attributes:
        name: Of the example.
        package: Whose it is.
        source: Where it stands.
        published: Published numbers, those that hold, and how many.
        differences: Largest difference from each package that is installed.
    """

    name: str
    package: str
    source: str
    published: tuple[int, int]
    differences: dict[str, float]

    @property
    def passed(self) -> bool:
        """Whether all published numbers hold, and all packages agree."""
        held, number = self.published
        return held == number and all(difference <= AGREES for difference in self.differences.values())


def held(example: Example, found: States) -> tuple[int, int]:
    """How many published numbers hold, of how many."""
    right = [
        np.abs(np.asarray(getattr(found, name)) - value) <= example.within[name]
        for name, value in example.expected.items()
    ]
    return sum(int(one.sum()) for one in right), sum(one.size for one in right)


def largest(found: States, other: dict[str, NDArray[np.float64]]) -> float:
    """Largest difference in any quantity."""
    return max(float(np.abs(np.asarray(getattr(found, name)) - value).max()) for name, value in other.items())


def drawn() -> list[Example]:
    """Examples whose arguments dynamax draws, in its way."""
    return [packages.drawn_by_dynamax(name, test, T, S, in_time=in_time) for name, test, T, S, in_time in DRAWN]


def compared(*, dynamax: bool, pymdp: bool) -> Iterator[Compared]:
    """All examples, beside hmmlearn and the packages that are there."""
    for example in [*examples().values(), *drawn()]:
        found, others = by_paths(example), {}
        alone = example.taps.shape[1] == 1
        if example.trained is not None and example.power == "none":
            others["hmmlearn"] = largest(found, packages.by_hmmlearn(example))
        if dynamax:
            others["dynamax"] = largest(found, packages.by_dynamax(example))
        if pymdp and example.trained is not None and (alone or example.power == "J"):
            others["pymdp"] = float(np.abs(found.belief - packages.by_pymdp(example)).max())
        yield Compared(example.name, example.package, example.source, held(example, found), others)
    for active in active_examples().values():
        beliefs = by_moves(active)
        expected = active.expected.get("object")
        right = np.array([]) if expected is None else np.abs(beliefs.sum(axis=1) - expected) <= 1e-12
        others = {"pymdp": float(np.abs(beliefs - packages.by_pymdp(active)).max())} if pymdp else {}
        yield Compared(active.name, active.package, active.source, (int(right.sum()), right.size), others)
    if dynamax:
        casino = packages.casino_of_dynamax(examples()["casino, first rolls"])
        beliefs, log_evidence = by_steps(casino)
        other = packages.by_dynamax(casino)
        right = abs(log_evidence - casino.expected["log_evidence"]) <= casino.within["log_evidence"]
        difference = max(np.abs(beliefs - other["belief"]).max(), abs(log_evidence - other["log_evidence"]))
        yield Compared(casino.name, casino.package, casino.source, (int(right), 1), {"dynamax": float(difference)})


def constant(*, dynamax: bool) -> str:
    """A sentence about many taps of a state that stays."""
    example = packages.constant_state()
    log_belief = np.cumsum(example.log_likelihood, axis=0)
    exact = np.exp(log_belief - np.logaddexp.reduce(log_belief, axis=1, keepdims=True))
    rows = {"this project": by_steps(example)[0]} | (
        {"dynamax": packages.by_dynamax(example)["belief"]} if dynamax else {}
    )
    lines = []
    for name, belief in rows.items():
        other = int((belief.argmax(axis=1) != exact.argmax(axis=1)).sum())
        lines.append([name, f"{np.abs(belief - exact).max():.1e}", f"{other:,}"])
    head = [f"{example.name}, from {example.source}", "largest difference from sums", "taps with another best state"]
    return table(head, lines)


def page(rows: list[Compared], *, dynamax: bool, pymdp: bool) -> str:
    """The tables of the page, with the versions that were run."""
    versions = [f"{name} {version(name)}" for name in ("hmmlearn", *(["dynamax"] if dynamax else []))]
    ran = [*versions, *(["pymdp 1.0.4"] if pymdp else [])]
    names = ["hmmlearn", "dynamax", "pymdp"]
    lines = []
    for row in rows:
        each = [f"{row.differences[name]:.0e}" if name in row.differences else "" for name in names]
        published = f"{row.published[0]} of {row.published[1]}" if row.published[1] else ""
        lines.append([row.name, f"{row.package}, `{row.source}`", published, *each])
    head = ["example", "from", "published numbers that hold", *(f"difference from {name}" for name in names)]
    return "\n\n".join([f"Run beside it: {', '.join(ran)}.", table(head, lines), constant(dynamax=dynamax)])


def main() -> None:
    """Compares everything and writes the page; exit code 1 if something differs."""
    options = parsed(ArgumentParser(description=__doc__), BLOCK)
    there = {"dynamax": find_spec("dynamax") is not None, "pymdp": packages.PYMDP in os.environ}
    rows = list(compared(**there))
    text = page(rows, **there)
    print(text)
    write_block(options.document, BLOCK, text)
    sys.exit("\n".join(f"{row.name} differs." for row in rows if not row.passed) or None)


if __name__ == "__main__":
    main()
