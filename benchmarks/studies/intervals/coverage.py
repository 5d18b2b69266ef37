"""Coverage of the 95% intervals of decision errors and reaction times.

Taps are drawn from histograms with 12 symbols, Dirichlet 1, and classified by the same histograms (`right`), by two
models whose log-likelihoods have added noise of equal size and which therefore err equally often (`noisy`, `noisy
too`), and by the first of these at half the power (`remedied`). Every data set is drawn anew. The truth is computed
from a pool of `MANY` taps per class, which no trial uses up; for the difference of two models of equal error it is 0.

`--document docs/explanation/intervals.md` updates the tables of that page; with `--preview` that of intervals made as
`compare --quick` makes them.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from solidtouch.analysis.compare.classes import class_scores
from solidtouch.analysis.stats.decisions import at_equal_taps, decision_curves, play_models, spread_of
from solidtouch.analysis.stats.reliability import EVERYTHING, at_stopping, reliability
from solidtouch.cli.compare import QUICK, QUICK_TRIALS
from solidtouch.inference.trials.records import ENDINGS, TapTable
from solidtouch.inference.trials.resampling import RESAMPLES
from solidtouch.models import seeds
from solidtouch.models.grid import FEW_TAPS, ClassGrid, tap_pool
from solidtouch.models.settings import PlaySettings

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.study import OUT, processes, write_json

SIZES = {"6 x 3": (6, 3), "16 x 5": (16, 5)}
TAPS = (5, 20, 60)
SYMBOLS, TAXELS, THETA = 12, 2, 0.9
SURER = 0.99
"""A threshold at which errors are rare."""
NOISE = 0.5
TRIALS = 4000
MANY = 5000
"""Taps of a class from which truths come."""
_TRUTH = 10**9  # their seed
CONTACTS = (1, 5)
EQUAL_TAPS = {6: {"passive": 5.0, "active": 5.0}, 16: {"passive": 8.5, "active": 7.0}}
"""Mean reaction times, by L, that all models reach at some threshold."""
FEWER = {6: {"passive": 3.5, "active": 4.0}, 16: {"passive": 3.5, "active": 6.0}}
"""Those where a class has fewer than 10 taps."""
MODELS = ("right", "noisy", "noisy too", "remedied")
EQUAL = "two models of equal error"
BLOCK = "coverage"
_LEAST, _MOST = 0.92, 0.98


class Seen(NamedTuple):
    """A quantity of one data set: its estimate and the ends of its interval."""

    value: float
    low: float
    high: float


def grid_of(L: int, M: int) -> ClassGrid:
    """Positions 1 mm apart, objects without sizes."""
    return ClassGrid(np.arange(L) + 0.5, "mm", np.arange(L + 1.0), tuple((f"object {m}",) for m in range(M)))


def draw(L: int, M: int, taps: int, seed: int) -> tuple[dict[str, TapTable], ClassGrid]:
    """A data set as every model sees it; the histograms are those of seed 0 always."""
    log_prob = np.log(np.random.default_rng(L * M).dirichlet(np.ones(SYMBOLS), size=(L * M, TAXELS)))
    generator = seeds.generator(seed, seeds.Purpose.STUDY, taps, L)
    own = np.repeat(np.arange(L * M), taps)
    uniform = generator.random((len(own), TAXELS, 1))
    symbol = np.minimum((uniform > np.exp(log_prob).cumsum(axis=-1)[own]).sum(axis=-1), SYMBOLS - 1)
    right = np.sum([log_prob[:, k, symbol[:, k]].T for k in range(TAXELS)], axis=0).reshape(-1, L, M)
    noisy = [right + NOISE * generator.normal(size=right.shape) for _ in range(2)]
    pool, flat = tap_pool(*np.divmod(own, M), (L, M)), np.full((L, M), -np.log(L * M))
    seen = dict(zip(MODELS, (right, *noisy, noisy[0] / 2), strict=True))
    return {name: TapTable(values, pool, flat) for name, values in seen.items()}, grid_of(L, M)


def quantities(L: int, M: int, taps: int, few: bool, preview: bool, seed: int) -> dict[str, Seen]:
    """Everything that is said of one data set, with intervals."""
    trials, resamples = (QUICK_TRIALS, QUICK["resamples"]) if preview else (TRIALS, RESAMPLES)
    return decisions(L, M, taps, few, trials, resamples, seed) | scores(L, M, taps, resamples, seed)


def decisions(L: int, M: int, taps: int, few: bool, trials: int, resamples: int, seed: int) -> dict[str, Seen]:
    """What is said of decisions; at equal taps that are those of `FEWER`, or not."""
    tables, grid = draw(L, M, taps, seed)
    compared = {name: tables[name] for name in MODELS[1:]}
    options = {"play": PlaySettings(border="clamp"), "resamples": resamples}
    played = play_models(compared, grid, (0.5, 0.7, 0.8, THETA, 0.95, SURER), trials, seed, **options)
    every = decision_curves(played)
    curves, surer = every.sel(theta=THETA), every.sel(theta=SURER)
    calibration = reliability(tables["right"], grid, [THETA, SURER], seed, trials=trials, contacts=(), **options)
    found: dict[str, Seen] = {}
    for policy in ("passive", "active"):
        both = at_stopping(calibration, policy).sel(counted="all", what=EVERYTHING)
        right, rare = both.sel(theta=THETA), both.sel(theta=SURER)
        noisy = curves.sel(policy=policy, model="noisy")
        equal_taps = (FEWER if few else EQUAL_TAPS)[L][policy]
        equal = at_equal_taps(played, [equal_taps]).sel(policy=policy).isel(taps=0)
        found[f"error at stopping, {policy}, right"] = seen(right, "wrong")
        found[f"error at stopping, {policy}, noisy"] = seen(noisy, "what_wrong")
        found[f"taps to decision, {policy}, right"] = seen(right, "taps")
        found[f"taps to decision, {policy}, noisy"] = seen(noisy, "taps")
        found[f"error at equal taps, {policy}, noisy"] = seen(equal.sel(model="noisy"), "what_wrong")
        found[f"error at threshold {SURER:g}, {policy}, right"] = seen(rare, "wrong")
        found[f"error at threshold {SURER:g}, {policy}, noisy"] = seen(
            surer.sel(policy=policy, model="noisy"), "what_wrong"
        )
        found[f"miscalibration factor, {policy}, right"] = seen(right, "factor")
        found[f"miscalibration factor at threshold {SURER:g}, {policy}, right"] = seen(rare, "factor")
        found[f"miscalibration factor, {policy}, noisy"] = seen(noisy, "miscalibration")
        for model, words in (("noisy too", EQUAL), ("remedied", "a remedy and none")):
            name = "what_wrong_difference"
            at = curves.sel(policy=policy, model=model)
            found[f"difference at stopping, {words}, {policy}"] = seen(at, name)
            at_surer = surer.sel(policy=policy, model=model)
            found[f"difference at threshold {SURER:g}, {words}, {policy}"] = seen(at_surer, name)
            found[f"difference at equal taps, {words}, {policy}"] = seen(equal.sel(model=model), name)
    wrong = [played[f"what_wrong{end}"].sel(model="noisy", theta=THETA) for end in ("", *ENDINGS)]
    active, passive = ([one.sel(policy=policy).values for one in wrong] for policy in ("active", "passive"))
    samples, ends = active[0] - passive[0], (active[1] - passive[2], active[2] - passive[1])
    low, high = spread_of(played).interval(samples, endings=ends)
    found["difference of active and passive, noisy"] = Seen(float(samples[0]), float(low), float(high))
    return found


def scores(L: int, M: int, taps: int, resamples: int, seed: int) -> dict[str, Seen]:
    """What is said of beliefs after numbers of taps."""
    tables, _ = draw(L, M, taps, seed)
    data, found = class_scores({name: tables[name] for name in MODELS[1:]}, seed, CONTACTS, resamples=resamples), {}
    for n in data["contacts"].values.tolist():
        at = data.sel(contacts=n)
        for name, words in (("accuracy_what", "accuracy"), ("log_score_what", "log score")):
            found[f"{words} after {n} tap{'s' * (n > 1)}"] = seen(at.sel(model="noisy"), name)
            for model, other in (("noisy too", EQUAL), ("remedied", "a remedy and none")):
                found[f"difference of {words} after {n} tap{'s' * (n > 1)}, {other}"] = seen(
                    at.sel(model=model), f"{name}_difference"
                )
    return found


def seen(at: xr.Dataset, name: str) -> Seen:
    """A quantity with its interval."""
    return Seen(float(at[name]), float(at[f"{name}_low"]), float(at[f"{name}_high"]))


class Coverage(NamedTuple):
    """What came of one quantity and size.

    Attributes:
        truth: Its truth.
        bias: Mean of the estimates less the truth, in their standard deviation.
        width: Mean half width of the interval over 1.96 standard deviations of the estimates.
        hits: Intervals that hold the truth.
        n: Data sets with an interval.
        sets: Data sets.
    """

    truth: float
    bias: float
    width: float
    hits: int
    n: int
    sets: int


def coverage(sets: list[Seen], truth: float) -> Coverage:
    """How often the intervals of data sets hold the truth."""
    known = [one for one in sets if np.isfinite([one.value, one.low, one.high]).all()]
    if not known:
        return Coverage(truth, np.nan, np.nan, 0, 0, len(sets))
    value, low, high = np.array(known).T
    spread = value.std(ddof=1)
    hits = int(((low <= truth + 1e-12) & (truth <= high + 1e-12)).sum())
    width = ((high - low) / 2 / 1.96 / spread).mean()
    return Coverage(truth, (value.mean() - truth) / spread, width, hits, len(known), len(sets))


def run(
    data_sets: int, seed: int, sizes: dict[str, tuple[int, int]], taps: tuple[int, ...], preview: bool = False
) -> Iterator[tuple[Any, ...]]:
    """Size, taps per class, quantity and its coverage, all data sets of a size and number of taps at once."""
    with processes() as pool:
        for size, (L, M) in sizes.items():
            for n in taps:
                few, gathered = n < FEW_TAPS, defaultdict(list)
                truths = pool.submit(decisions, L, M, MANY, few, 100 * TRIALS, 1, _TRUTH)
                own = [seeds.derived_seed(seed, seeds.Purpose.STUDY, number) for number in range(data_sets)]
                for one in pool.map(partial(quantities, L, M, n, few, preview), own):
                    for name, value in one.items():
                        gathered[name].append(value)
                for name, sets in gathered.items():
                    mean = np.mean([one.value for one in sets])
                    truth = truths.result()[name].value if name in truths.result() else float(mean)
                    yield size, n, name, coverage(sets, 0.0 if EQUAL in name else truth)


def told(found: Coverage) -> str:
    """The coverage with its interval, whether that is above 98% or below 92%, and how often there was an interval."""
    if found.n < found.sets / 2:
        return "no interval"
    share = found.hits / found.n
    verdict = "" if _LEAST <= share <= _MOST else ("too wide" if share > _MOST else "too narrow")
    rarely = "" if found.n == found.sets else f"(in {found.n / found.sets:.0%} of the data sets)"
    return " ".join(filter(None, (share_interval(found.hits, found.n), verdict, rarely)))


def document(rows: list[tuple[Any, ...]]) -> str:
    """The table of the page: a row for each quantity, a column for each size and number of taps."""
    by_name: dict[str, dict[tuple[str, int], Coverage]] = defaultdict(dict)
    for size, n, name, found in rows:
        by_name[name][size, n] = found
    columns = list(dict.fromkeys((size, n) for size, n, _, _ in rows))
    cells = [[name, *(told(one) if (one := found.get(c)) else "–" for c in columns)] for name, found in by_name.items()]
    shares = [
        np.array([one.hits / one.n for size, n, _, one in rows if (size, n) == c and one.n >= one.sets / 2])
        for c in columns
    ]
    cells.append(["lowest of these", *(f"{of.min():.3f}" for of in shares)])
    cells.append(["too wide, of those with intervals", *(f"{(of > _MOST).sum()} of {len(of)}" for of in shares)])
    return table(["quantity", *(f"{size}, {n} taps" for size, n in columns)], cells)


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=300, help="number of data sets")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--sizes", nargs="*", choices=SIZES, default=list(SIZES))
    parser.add_argument("--taps", nargs="*", type=int, default=list(TAPS))
    parser.add_argument(
        "--add", action="store_true", help="add to the results of the last run; with an empty --sizes only write them"
    )
    parser.add_argument("--preview", action="store_true", help="intervals as of `compare --quick`")
    options = parsed(parser, BLOCK)
    block, kept = (f"{BLOCK}-preview", "intervals-preview") if options.preview else (BLOCK, "intervals")
    rows: list[tuple[Any, ...]] = []

    def write() -> None:
        write_json(kept, [[size, n, name, *found] for size, n, name, found in rows])
        write_block(options.document, block, document(rows))

    if options.add:
        wanted = set(product(options.sizes, options.taps))
        old = json.loads((OUT / f"{kept}.json").read_text(encoding="utf-8"))
        rows = [(size, n, name, Coverage(*found)) for size, n, name, *found in old if (size, n) not in wanted]
        write()
    sizes = {name: SIZES[name] for name in options.sizes}
    for row in run(options.data_sets, options.seed, sizes, tuple(options.taps), options.preview):
        size, n, name, found = row
        print(
            f"{size:6} {n:3} {name:64} {told(found)} of {found.n}, truth {found.truth:.4g} bias {found.bias:+.2f} "
            f"width {found.width:.2f}",
            flush=True,
        )
        rows = sorted([*rows, row], key=lambda one: (list(SIZES).index(one[0]), one[1]))
        write()


if __name__ == "__main__":
    main()
