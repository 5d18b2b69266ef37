"""How far off the approximation of two taps ahead is, and what a second tap adds to looking one tap ahead.

Both are held against enumerating every first and every second tap of the pool, which takes a second for each belief.
`python benchmarks/ahead.py --document docs/strategies.md` writes the table of that page.
"""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from solidtouch.analysis.strategies.data import pool_of, simulated_bench
from solidtouch.inference.control import best_move, fixation
from solidtouch.inference.control_information import informative
from solidtouch.inference.control_two_taps import DRAWS, FURTHER, two_tap_values, two_taps
from solidtouch.inference.information import TapOutcomes, moves_to_all
from solidtouch.inference.lockstep import play
from solidtouch.inference.trial_plan import plan_trials, tap_table
from solidtouch.models.seeds import Purpose, data_set_seed, generator
from solidtouch.models.threads import one_blas_thread
from studies import check_block, mean_interval, table, until_interrupted, write_block, write_json

BLOCK = "two-taps"
PRESET, POOL, BORDER, ABOUT = "paper", 400, "uniform", "what"
MOST = 4
"""Taps before a decision, of which each number is looked at."""
DRAWN = (4, DRAWS, 32)
"""First taps of each move."""


class Judged(NamedTuple):
    """What a way of choosing came to for beliefs of one data set.

    Attributes:
        lost: Nats that enumeration expects of the best move beyond those of the chosen one, shape (n,).
        same: Whether both are one, shape (n,).
        error: Values less those of enumeration, shape (n, moves); empty where there are none to compare.
        stated: Their standard errors, likewise.
    """

    lost: NDArray[np.float64]
    same: NDArray[np.bool_]
    error: NDArray[np.float64]
    stated: NDArray[np.float64]


def beliefs_of(number: int, count: int) -> tuple[TapOutcomes, NDArray[np.float64]]:
    """Training taps of a data set, and beliefs after one to `MOST` taps of trials that fixate."""
    bench = simulated_bench(PRESET, number + 2, 0)
    unit = bench.load(number)
    seed = data_set_seed(0, number)
    model = unit.model("J", bench.grid, seed)
    table = tap_table(model, model.usable(unit.test))
    plan = plan_trials(table.pool, count, seed)
    kept = []

    def watch(beliefs: NDArray[np.float64], _: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        kept.append(beliefs)
        return {}

    play(table, plan, fixation((bench.grid.L - 1) // 2), border=BORDER, deadline=MOST, seed=seed, watch=watch)
    which = np.arange(count) % MOST
    return pool_of(model, unit.train, POOL), np.array(kept)[which, np.arange(count)]


def judged(number: int, count: int) -> dict[str, Judged]:
    """Every way on the beliefs of one data set."""
    outcomes, beliefs = beliefs_of(number, count)
    L, _, N = outcomes.given.shape
    deltas, every = moves_to_all(beliefs), np.arange(L)
    chance = generator(0, Purpose.STUDY, number).random(count)
    values = partial(two_tap_values, outcomes, beliefs, deltas, every, chance, ABOUT, BORDER)
    exact, _ = values(N)

    def of(chosen: NDArray[np.int64], error: ArrayLike = (), stated: ArrayLike = ()) -> Judged:
        worth = exact[deltas == chosen[:, np.newaxis]]
        same = best_move(exact, deltas) == chosen
        return Judged(exact.max(axis=1) - worth, same, np.asarray(error), np.asarray(stated))

    found = {"one tap": of(informative(outcomes, ABOUT, BORDER)(beliefs, chance))}
    for draws in DRAWN:
        mine, errors = values(draws)
        found[f"two taps, {draws} draws"] = of(best_move(mine, deltas), mine - exact, errors)
    for name, second in (("", None), (", second tap at every third", every[1::3].tolist())):
        policy = two_taps(outcomes, ABOUT, BORDER, second=second)
        found[f"{DRAWS} draws, {FURTHER} best places{name}"] = of(policy(beliefs, chance))
    return found


def page(data_sets: int, count: int) -> str:
    """The table; of what was finished if it is interrupted."""
    with one_blas_thread():
        tasks = [partial(judged, number, count) for number in range(data_sets)]
        found = list(until_interrupted("data sets", tasks))
    head = (
        f"{len(found)} data sets of preset `{PRESET}`, {count} beliefs of each after one to {MOST} taps, about {POOL} "
        "training taps, about the object. *Lost* is what enumeration of all pairs of taps expects of its best move "
        "beyond the chosen one; *error* the root of the mean square of values less those of enumeration, *stated* that "
        "of the standard errors given with them. Intervals are 95 % t-intervals over data sets."
    )
    names = ["way", "lost (nats)", "same place", "error (nats)", "stated (nats)"]
    return f"{head}\n\n{table(names, [_line(name, [one[name] for one in found]) for name in found[0]])}"


def _line(name: str, units: Sequence[Judged]) -> list[str]:
    lost, same = zip(*((float(unit.lost.mean()), float(unit.same.mean())) for unit in units), strict=True)
    cells = [mean_interval(lost, 4), mean_interval(same)]
    for values in ([unit.error for unit in units], [unit.stated for unit in units]):
        known = all(value.size and np.isfinite(value).all() for value in values)
        cells.append(mean_interval([np.sqrt((value**2).mean()) for value in values], 3) if known else "-")
    return [name, *cells]


def main() -> None:
    """Prints the table, or writes it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--document", type=Path, help="page that gets the table, such as docs/strategies.md")
    parser.add_argument("--data-sets", type=int, default=10)
    parser.add_argument("--beliefs", type=int, default=12, help="of each data set")
    arguments = parser.parse_args()
    check_block(arguments.document, BLOCK)
    text = page(arguments.data_sets, arguments.beliefs)
    write_json(BLOCK, text)
    if arguments.document is None:
        print(text)
    else:
        write_block(arguments.document, BLOCK, text)


if __name__ == "__main__":
    main()
