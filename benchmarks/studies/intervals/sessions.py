"""Coverage of the intervals of trials that stay in one of several test sessions.

Taps are drawn from histograms with 12 symbols, Dirichlet 1, that each session changes: its log probabilities have added
noise of a standard deviation, drawn anew for every session, and the model knows the histograms without it. Every data
set has other sessions. The truth is the mean over `MANY` sessions of trials that stay in one, and what trials that draw
taps of all sessions say stands beside it.

`--document docs/explanation/intervals.md` updates the table of that page.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from solidtouch.analysis.stats.decisions import decision_curves, play_models
from solidtouch.inference.trials.records import TapTable
from solidtouch.models import seeds
from solidtouch.models.grid import tap_pool
from solidtouch.models.settings import PlaySettings

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.studies.intervals.coverage import SYMBOLS, TAXELS, Seen, coverage, grid_of, seen
from benchmarks.study import processes, write_json

L, M, TAPS, THETA, TRIALS = 6, 3, 20, 0.9, 4000
SESSIONS, APART = (2, 3, 5, 10), (0.0, 0.7)
MANY = 600
"""Sessions of a truth."""
WHAT = {"what_wrong": "error at stopping", "taps": "taps to decision"}
BLOCK = "coverage-sessions"
_LOG_PROB = np.log(np.random.default_rng(L * M).dirichlet(np.ones(SYMBOLS), size=(L * M, TAXELS)))


def draw(sessions: int, apart: float, seed: int, mixed: bool = False) -> dict[str, TapTable]:
    """A data set as the model sees it, and as one of half its power does.

    Args:
        sessions: That test.
        apart: Standard deviation of log probabilities between them.
        seed: Of sessions and taps.
        mixed: Whether trials draw taps of all sessions.
    """
    generator = seeds.generator(seed, seeds.Purpose.STUDY, sessions, int(100 * apart))
    noisy = _LOG_PROB + apart * generator.normal(size=(sessions, *_LOG_PROB.shape))
    prob = np.exp(noisy - np.logaddexp.reduce(noisy, axis=-1, keepdims=True))
    session, own = (np.repeat(index.ravel(), TAPS) for index in np.indices((sessions, L * M)))
    uniform = generator.random((len(own), TAXELS, 1))
    symbol = np.minimum((uniform > prob.cumsum(axis=-1)[session, own]).sum(axis=-1), SYMBOLS - 1)
    right = np.sum([_LOG_PROB[:, k, symbol[:, k]].T for k in range(TAXELS)], axis=0).reshape(-1, L, M)
    pool = tap_pool(*np.divmod(own, M), (L, M), 0 if mixed else session)
    prior = np.full((L, M), -np.log(L * M))
    return {name: TapTable(p * right, pool, prior, session=session) for name, p in (("model", 1.0), ("half", 0.5))}


def decisions(
    sessions: int, apart: float, seed: int, *, resamples: int = 100, mixed: bool = False, trials: int = TRIALS
) -> dict[str, Seen]:
    """What is said of the decisions of one data set, with intervals."""
    play = PlaySettings(border="clamp")
    tables = draw(sessions, apart, seed, mixed)
    played = play_models(tables, grid_of(L, M), (THETA,), trials, seed, play=play, resamples=resamples)
    curves, found = decision_curves(played).sel(theta=THETA), {}
    for policy in ("passive", "active"):
        for name, words in WHAT.items():
            at = curves.sel(policy=policy)
            found[f"{words}, {policy}"] = seen(at.sel(model="model"), name)
            found[f"{words}, {policy}, difference"] = seen(at.sel(model="half"), f"{name}_difference")
    return found


def run(data_sets: int, seed: int) -> Iterator[tuple[Any, ...]]:
    """How far sessions are apart, how many, a quantity, what is said of it, and the mean of mixed trials."""
    own = [seeds.derived_seed(seed, seeds.Purpose.STUDY, number) for number in range(data_sets)]
    with processes() as workers:
        for apart in APART:
            truth = workers.submit(decisions, MANY, apart, seed, resamples=2, trials=100 * TRIALS)
            for sessions in SESSIONS:
                on = partial(decisions, sessions, apart)
                sets = list(workers.map(on, own, chunksize=4))
                mixed = list(workers.map(partial(on, resamples=2, mixed=True), own, chunksize=4))
                for name in sets[0]:
                    found = coverage([one[name] for one in sets], truth.result()[name].value)
                    yield apart, sessions, name, found, float(np.mean([one[name].value for one in mixed]))


def document(rows: list[tuple[Any, ...]]) -> str:
    """The table of the page: a row for each quantity, coverages by the number of sessions."""
    cells: dict[tuple[float, str], list[str]] = {}
    for apart, sessions, name, found, mixed in rows:
        cell = cells.setdefault((apart, name), [f"{apart:g}", name, f"{found.truth:.3f}", ""])
        if sessions == max(SESSIONS):
            cell[3] = f"{mixed:.3f}"
        cell.append(share_interval(found.hits, found.n))
    heads = (f"covers, {sessions} sessions" for sessions in SESSIONS)
    return table(["sd", "quantity", "truth", f"trials that mix {max(SESSIONS)} sessions", *heads], list(cells.values()))


def measure_and_write(
    description: str | None,
    block: str,
    name: str,
    run: Callable[[int, int], Iterable[tuple[Any, ...]]],
    document: Callable[[list[tuple[Any, ...]]], str],
) -> None:
    """A study as the command line says: its rows, into a file of that name and a block of a page."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=200, help="number of data sets")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    options = parsed(parser, block)
    rows = []
    for row in run(options.data_sets, options.seed):
        rows.append(row)
        print(*row, flush=True)
    write_json(name, rows)
    write_block(options.document, block, document(rows))


def main() -> None:
    """Measures and writes."""
    measure_and_write(__doc__, BLOCK, "intervals-sessions", run, document)


if __name__ == "__main__":
    main()
