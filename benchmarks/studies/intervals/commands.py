"""Coverage of the intervals of `trials`, `strategies` and `tune` on data of known truth.

Test taps are drawn from the tables that the filter uses, so a large pool of them gives the true values for fresh taps.

`--document docs/explanation/intervals-commands.md` updates the table of that page.
"""

import argparse
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.stats.jackknife import interval, jackknife
from solidtouch.analysis.stats.resampled_units import RESAMPLES, left_out_units, resampled_tables, units_of
from solidtouch.analysis.stats.tallied import tally_means
from solidtouch.analysis.strategies.curves import AT_TAPS, Family, decided_sums, differences
from solidtouch.analysis.trials.spread import tap_spread
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.moves.control import fixation, passive
from solidtouch.inference.stopping.stopping import after
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.records import TapTable, plan_trials, tap_table
from solidtouch.inference.trials.resampling import spread
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.tally import tally_trials
from solidtouch.inference.tuning.held_out import held_out, with_repeats
from solidtouch.inference.tuning.threshold import choose_threshold
from solidtouch.models import seeds
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.study import processes, until_interrupted

L, M, K, B = 6, 3, 4, 8
GRID = ClassGrid(1.5 * np.arange(L), "mm", None, tuple((f"object {m}",) for m in range(M)))
EDGES = np.arange(B + 1.0)
THETA, AIM, DEADLINE, TAPS = 0.9, 2, 50, 3
RARE = 0.9999
"""A threshold at which many data sets have no errors."""
TRUTHS = 4
"""Tables of the world; as many data sets of each."""
LARGE, TRUE_TRIALS, TRIALS = 4000, 50_000, 50_000
BLOCK = "intervals-commands"
_TUNE_TRIALS, _STRATEGY_TRIALS = 500, 200
_POOL = 1 << 20  # number of the data set that is the large pool
RECORD = Preprocessing(samples=1)
PRICE = 20.0
SIZES = (5, 20, 60)
_WORDS = {"what_wrong": "P(wrong)", "taps": "taps"}
PLAY = PlaySettings(border="clamp", deadline=DEADLINE)


class Held(NamedTuple):
    """One interval.

    Attributes:
        of: Command and quantity.
        size: Taps of each class.
        truth: Number of the world.
        low: Lower end.
        high: Upper end.
        true: What it should hold; NaN for the mean of the estimates over all data sets of this world.
        estimate: The estimate.
    """

    of: str
    size: str
    truth: int
    low: float
    high: float
    true: float
    estimate: float


def world(truth: int) -> NDArray[np.float64]:
    """P(b | class), shape (L, M, K, B)."""
    return seeds.generator(truth, seeds.Purpose.STUDY).dirichlet(np.full(B, 1.0), (L, M, K))


def drawn(truth: int, taps: int, data_set: int, session: int = 0) -> TapSet:
    """Taps of a world, of which no two are the same."""
    found = draw_taps(GRID, world(truth), EDGES, RECORD, taps, data_set, session).dataset
    within = seeds.generator(data_set, seeds.Purpose.STUDY, 1, session).uniform(-0.4, 0.4, found["taps"].shape)
    return TapSet(found.assign(taps=found["taps"] + within))


def right(truth: int) -> HistogramModel:
    """The model that the taps of a world come from."""
    return HistogramModel(GRID, EDGES, "none", RECORD, np.round(1e9 * world(truth)).astype(np.int64), 0.0)


def fitted(taps: TapSet, grid: ClassGrid) -> HistogramModel:
    """The model of some taps."""
    return fit(taps, grid, bins=B, pseudocount=0.5, power="none")


def true_means(large: TapTable, theta_x: float = 0.0, theta: float = THETA) -> dict[str, float]:
    """What fresh taps give."""
    plan = plan_trials(large.pool, TRUE_TRIALS, 1, AIM)
    found = run_trials(large, plan, (theta,), play=PLAY.changed(theta_x=theta_x), fresh=True)
    return {"what_wrong": float((found.what[:, 0] != plan.what).mean()), "taps": float(found.taps.mean())}


@cache
def large(truth: int) -> TapSet:
    """So many taps of a world that their own chance is small beside that of the data sets."""
    return drawn(truth, LARGE, _POOL)


@cache
def known_means(truth: int, theta_x: float) -> dict[str, float]:
    """What fresh taps of a world give under the correct model."""
    return true_means(tap_table(right(truth), large(truth)), theta_x)


def of_trials(truth: int, number: int, taps: int) -> Iterator[Held]:
    """`trials`: on fresh taps against what these give, as stored against the mean of all data sets."""
    table_of = tap_table(right(truth), drawn(truth, taps, number))
    for policy, theta_x in (("passive", 1.0), ("active", 0.0)):
        rule = {"play": PLAY.changed(theta_x=theta_x), "fixation": AIM, "seed": number}
        spread = tap_spread(table_of, GRID, (THETA,), TRIALS, **rule)
        means = tally_means(tally_trials(table_of, (THETA,), TRIALS, **rule), GRID)
        true = known_means(truth, theta_x)
        both = (("fresh", spread.fresh_intervals(), spread.fresh), ("stored", spread.intervals(means), means))
        for kind, intervals, estimates in both:
            for name, known in true.items():
                low, high = (float(end[0]) for end in intervals[name])
                of = f"`trials`, {policy}, {_WORDS[name]}, {kind} taps"
                estimate = float(np.ravel(estimates[name])[0])
                yield Held(of, f"{taps}", truth, low, high, known if kind == "fresh" else np.nan, estimate)


def of_strategies(truth: int, number: int, taps: int) -> Iterator[Held]:
    """`strategies`: passive minus fixation point after `TAPS` taps on resamples, against the mean of all data sets."""
    table_of = tap_table(right(truth), drawn(truth, taps, number))
    tables, n, means = resampled_tables(table_of, RESAMPLES, number), _STRATEGY_TRIALS, []
    rule = Family("number of taps", "taps", tuple(range(1, TAPS + 1)), lambda level: after(int(level)))
    for policy in (passive(), fixation(AIM)):
        sums = []
        for i, one in enumerate(tables):
            plan = plan_trials(one.pool, n, number, first_stream=i * n)
            record = play(one, plan, policy, border="clamp", deadline=TAPS, seed=number)
            sums.append(decided_sums(record, rule, GRID).mean(axis=0))
        means.append(units_of(sums, spread(table_of)))
    found = differences(means[0], means[1], (TAPS,), 1)[0][AT_TAPS.index("what_error")]
    of = f"`strategies`, P(wrong) of passive minus fixation, {TAPS} taps"
    yield Held(of, f"{taps}", truth, found.low, found.high, np.nan, found.value)


def of_tune(truth: int, number: int, taps: int, sessions: int) -> Iterator[Held]:
    """`tune`: error, taps and cost of a threshold on parts.

    Against fresh taps under the same models, and, where sessions are drawn anew, against the mean of all data sets.
    """
    recorded = concatenate([drawn(truth, taps, number, session) for session in range(sessions)])
    parts = with_repeats(held_out(recorded, GRID, fitted), recorded, fitted)
    options = {
        "play": PlaySettings(fixation=AIM, deadline=DEADLINE, border="clamp"),
        "trials": _TUNE_TRIALS,
        "seed": number,
    }
    found = choose_threshold(parts, (0.5, THETA, RARE), PRICE, **options)
    tables = [tap_table(part.model, large(truth)) for part in parts.parts]
    size = f"{sessions} sessions of {taps}" if sessions > 1 else f"halves of {taps}"
    for h, theta, at in ((1, THETA, ""), (2, RARE, f" at {RARE:g}")):
        true = [true_means(one, theta=theta) for one in tables]
        wrong, taken = (float(np.mean([one[name] for one in true])) for name in ("what_wrong", "taps"))
        price = PRICE * wrong + taken
        rows = (("P(wrong)", found.error, wrong), ("taps", found.taps, taken), ("cost", found.cost, price))
        for name, one, known in rows:
            of, low, high, mean = f"`tune`, {name}{at}", float(one.low[h]), float(one.high[h]), float(one.mean[h])
            yield Held(of, size, truth, low, high, known, mean)
            if sessions > 1:
                yield Held(f"{of}, repeated study", size, truth, low, high, np.nan, mean)


def of_folds(truth: int, number: int, taps: int, sessions: int) -> Iterator[Held]:
    """`strategies` and `sensitivity` on sessions left out in turn: as `of_tune`, also of a difference."""
    recorded = concatenate([drawn(truth, taps, number, session) for session in range(sessions)])
    values, true = [], []
    for f, part in enumerate(held_out(recorded, GRID, fitted).parts):
        plan = plan_trials(part.table.pool, _TUNE_TRIALS, number, AIM, first_stream=f * _TUNE_TRIALS)
        table_of, own, known = tap_table(part.model, large(truth)), [], []
        for theta_x in (1.0, 0.0):
            found = run_trials(part.table, plan, (THETA,), play=PLAY.changed(theta_x=theta_x), seed=number, fresh=True)
            own.append([(found.what[:, 0] != plan.what).mean(), found.taps.mean()])
            known.append([*true_means(table_of, theta_x).values()])
        values.append([*own, np.subtract(*own)])
        true.append([*known, np.subtract(*known)])
    means, errors = jackknife([left_out_units(np.array(values))], np.asarray)
    for i, policy in enumerate(("passive", "active", "passive minus active")):
        for j, name in enumerate(_WORDS.values()):
            found = interval(means[i, j], errors[i, j], sessions, 1)
            of, ends = f"`strategies`, {name}, {policy}", (found.low, found.high)
            size, known = f"{sessions} sessions of {taps}", float(np.mean(true, axis=0)[i, j])
            yield Held(of, size, truth, *ends, known, found.value)
            yield Held(f"{of}, repeated study", size, truth, *ends, np.nan, found.value)


def outcomes(number: int, sizes: tuple[int, ...]) -> list[Held]:
    """All intervals of a data set."""
    truth = number % TRUTHS
    found: list[Held] = []
    for taps in sizes:
        found += of_trials(truth, number, taps)
        found += of_strategies(truth, number, taps)
    for taps, sessions in ((20, 1), (60, 1), (20, 2), (20, 5), (20, 10)):
        found += of_tune(truth, number, taps, sessions)
    for sessions in (3, 5, 10):
        found += of_folds(truth, number, 20, sessions)
    return found


def coverage(found: list[Held]) -> str:
    """A line for each quantity and size: how many intervals hold the truth, the bias, and the mean width."""
    lines = []
    for of in dict.fromkeys(one.of for one in found):
        for size in dict.fromkeys(one.size for one in found if one.of == of):
            own = [one for one in found if (one.of, one.size) == (of, size)]
            mean = {t: np.mean([one.estimate for one in own if one.truth == t]) for t in {one.truth for one in own}}
            true = np.array([mean[one.truth] if np.isnan(one.true) else one.true for one in own])
            low, high, estimate = np.array([(one.low, one.high, one.estimate) for one in own]).T
            known = np.isfinite(low)
            hits = int(((low <= true) & (true <= high))[known].sum())
            missing = "" if known.all() else f" ({len(own) - int(known.sum())} without)"
            bias = "" if np.isnan(own[0].true) else f"{np.mean(estimate - true):+.3f}"
            width = f"{np.mean((high - low)[known]):.3f}"
            held = share_interval(hits, int(known.sum())) + missing
            lines.append([of, size, held, bias, f"{true.mean():.3f}", width])
    return table(["interval of", "taps per class", "coverage", "bias", "truth", "mean width"], lines)


def main() -> None:
    """Measures, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=300, help="number of data sets")
    options = parsed(parser, BLOCK)
    with processes() as workers:
        played = [workers.submit(outcomes, number, SIZES) for number in range(options.data_sets)]
        done = list(until_interrupted("Data sets", [one.result for one in played]))
        workers.shutdown(cancel_futures=True)
    text = (
        f"{len(done)} data sets, {L} x {M} classes, {K} taxels of {B} symbols, Dirichlet 1, {TRUTHS} worlds, "
        f"power none, border clamp, theta {THETA:g} where nothing else is said, deadline {DEADLINE}.\n\n"
        f"{coverage([one for of in done for one in of])}"
    )
    print(text)
    write_block(options.document, BLOCK, text)


if __name__ == "__main__":
    main()
