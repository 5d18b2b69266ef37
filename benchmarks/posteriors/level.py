"""Level and power of the verdict on draws: how often right draws are called wrong, and how often wrong ones are.

Draws come from exact posteriors; in chains that mix slowly half of them repeat the one before. Wrong ones are draws of
the same model with another prior, or with a line of it misread.

    python -m benchmarks.posteriors.level --document docs/reference/posteriors/README.md
"""

from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.posteriors.catalogue import posterior
from solidtouch.analysis.posteriors.comparison import compare_draws
from solidtouch.analysis.posteriors.files import Draws
from solidtouch.models.measurement import gaussian, profile_ar
from solidtouch.models.measurement.fits.cells import WEAK_CELLS
from solidtouch.models.seeds import Purpose, generator

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.posteriors.make import numbers
from benchmarks.posteriors.targets import SEED, Target, taps, targets
from benchmarks.study import processes, until_interrupted, write_json

CHAINS = 4
RIGHT, WRONG = 200, 50
"""Programs with right draws, and with each kind of wrong ones."""

type Drawn = dict[str, NDArray[np.float64]]


class Program(NamedTuple):
    """A kind of draws.

    Attributes:
        name: Of the reference posterior.
        draws: Of each chain.
        repeated: Share of draws that repeat the one before.
        wrong: What is wrong, in a phrase; empty for right ones.
    """

    name: str
    draws: int
    repeated: float
    wrong: str = ""


RIGHT_PROGRAMS = [
    Program(name, draws, repeated)
    for name in ("histogram", "gaussian", "profile-ar", "session")
    for draws, repeated in ((250, 0.0), (1000, 0.0), (1000, 0.5))
]


def _prior_shape(rng: np.random.Generator) -> Callable[[], Drawn]:
    cells = gaussian.fit(taps(), WEAK_CELLS._replace(a=3.0)).cells
    return lambda: cells.draw(rng)


def _prior_rate(rng: np.random.Generator) -> Callable[[], Drawn]:
    cells = gaussian.fit(taps(), WEAK_CELLS._replace(b=1.0)).cells
    return lambda: cells.draw(rng)


def _deviation(rng: np.random.Generator) -> Callable[[], Drawn]:
    cells = gaussian.fit(taps(), WEAK_CELLS).cells

    def draw() -> Drawn:
        drawn = cells.draw(rng)
        return {**drawn, "variance": np.sqrt(drawn["variance"])}

    return draw


def _first_sample(rng: np.random.Generator) -> Callable[[], Drawn]:
    known = taps()
    samples = known.samples.copy()
    samples[:, 0] = samples[:, 1]
    slopes = profile_ar.fit(known._replace(samples=samples), WEAK_CELLS)
    return lambda: slopes.draw(rng)


WRONG_WAYS: dict[str, tuple[str, Callable[[np.random.Generator], Callable[[], Drawn]]]] = {
    "InverseGamma(3, 2) in place of (2, 2)": ("gaussian", _prior_shape),
    "rate 1 in place of 2": ("gaussian", _prior_rate),
    "standard deviations written as variances": ("gaussian", _deviation),
    "the second sample read as the first": ("profile-ar", _first_sample),
}
WRONG_PROGRAMS = [Program(name, 1000, 0.0, wrong) for wrong, (name, _) in WRONG_WAYS.items()]


def drawn(program: Program, target: Target, number: int) -> Draws:
    """Draws of a program."""
    rng = generator(SEED, Purpose.STUDY, 3, number)
    exact: Any = target.exact
    draw = WRONG_WAYS[program.wrong][1](rng) if program.wrong else partial(exact.draw, rng)
    chains: list[list[Drawn]] = []
    for _ in range(CHAINS):
        chain = [draw()]
        for repeats in rng.random(program.draws - 1) < program.repeated:
            chain.append(chain[-1] if repeats else draw())
        chains.append(chain)
    sites = {name: np.array([[one[name] for one in chain] for chain in chains]) for name in target.scales}
    return numbers(sites, target.scales)


def statuses(program: Program, first: int, count: int) -> Counter[str]:
    """Verdicts on so many programs of a kind."""
    (target,) = (one for one in targets() if one.name == program.name)
    every = (compare_draws(posterior(program.name), drawn(program, target, first + i)) for i in range(count))
    return Counter(verdict.status for verdict in every)


def main() -> None:
    """Runs the study."""
    options = parsed(ArgumentParser(description=__doc__), "level", "power")
    kinds = [*RIGHT_PROGRAMS, *WRONG_PROGRAMS]
    with processes() as pool:
        pending = [
            pool.submit(statuses, kind, 10_000 * i, WRONG if kind.wrong else RIGHT) for i, kind in enumerate(kinds)
        ]
        found = [*until_interrupted("Verdicts on draws", [one.result for one in pending])]
    done = [*zip(kinds, found, strict=False)]
    write_json("reference-posteriors-level", [[*kind, dict(counts)] for kind, counts in done])
    right = [_row(kind, counts) for kind, counts in done if not kind.wrong]
    every = sum((counts for kind, counts in done if not kind.wrong), Counter[str]())
    right.append(["all", "", "", _share(every)])
    wrong = [[f"`{kind.name}`", kind.wrong, _share(counts)] for kind, counts in done if kind.wrong]
    head = ["posterior", "draws", "share that repeat", "called wrong"]
    write_block(options.document, "level", table(head, right))
    write_block(options.document, "power", table(["posterior", "mistake", "called wrong"], wrong))
    for row in (*right, *wrong):
        print(*row, sep=" | ")


def _row(kind: Program, counts: Counter[str]) -> list[str]:
    return [f"`{kind.name}`", f"{CHAINS} x {kind.draws}", f"{kind.repeated:g}", _share(counts)]


def _share(counts: Counter[str]) -> str:
    decided = counts["pass"] + counts["differs"]
    undecided = f", {counts['undecided']} undecided" if counts["undecided"] else ""
    return share_interval(counts["differs"], decided) + undecided


if __name__ == "__main__":
    main()
