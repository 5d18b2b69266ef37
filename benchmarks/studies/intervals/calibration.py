"""How often an audit's calibration verdict is wrong for a correct model, and how often it detects a fault.

Taps are drawn from the histograms that classify them: 12 symbols, Dirichlet 1, border clamp, with the number of taps
per class given in each row. The verdict `overconfident` is wrong for any power up to the right one, `cautious` for
power none. Planted dependence repeats one sample of a tap J times, and power none counts it J times. All data sets of a
row share one reference with many more simulated data sets than an audit has, because the range under a correct model
depends on the number of taps, not on the taps. `one object outside` counts factors of single objects outside the
central 95% under a correct model, `bound exceeded` data sets in which a guarantee of the stopping rule is rejected,
after Holm over all objects; an audit also requires its interval to lie above the limit. `learned` is the exponent of
`tempering.best_power` on as many other taps; there every data set has its own reference and intervals, as in an audit.

`--document docs/explanation/intervals.md` updates the tables of that page.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.audit.remedy_scores import BeliefEvidence, decisions, factor_of, judge
from solidtouch.analysis.audit.verdict import calibration
from solidtouch.analysis.stats.detection import LEVEL
from solidtouch.analysis.stats.reliability import headline
from solidtouch.analysis.stats.right_model import Beside, compare, simulate
from solidtouch.analysis.stats.uniformity import rejected
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.trials.records import TapTable, tap_table
from solidtouch.inference.trials.resampling import RESAMPLES
from solidtouch.inference.tuning.tempering import best_power
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.measurement.model import TapModel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, data_set_seed, derived_seed
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.studies.intervals.coverage import SYMBOLS, grid_of
from benchmarks.study import processes, write_json

SIZES = {"6 x 3": (6, 3), "16 x 5": (16, 5)}
SAMPLES, TAPS, THETAS, POLICIES = (1, 5), (5, 20, 60), (0.9, 0.99), ("passive", "active")
TRIALS, DEADLINE = 1000, 100
LEVEL_BLOCK, POWER_BLOCK, LEARNED_BLOCK, RIG_BLOCK = BLOCKS = "level", "power", "learned", "rigs"
RIGS = ("paper", "broken", "nodrift", "ideal")
STATES = ("overconfident", "cautious")
NOT_REJECTED = "right, or not enough data to tell"
OBJECT, PROMISE = "one object outside", "bound exceeded"
HEAD = ("J", "taps per class", "threshold", "power", "policy", *STATES, "either", OBJECT, PROMISE)
_TAXELS = {1: 2, 5: 1}  # so that decisions take several taps
_CONTACTS = 10  # after which exponents are learned


class Design(NamedTuple):
    """What a data set is drawn from, and how it is judged.

    Attributes:
        size: Key of `SIZES`.
        samples: J.
        taps: Of each class.
        power: `"none"` or `"J"`.
        planted: Whether one sample of a tap is repeated J times.
    """

    size: str
    samples: int
    taps: int
    power: str
    planted: bool = False


def designs(sizes: list[str]) -> list[Design]:
    """All of them; with one sample power J is power none."""
    rows = [Design(*row) for row in product(sizes, SAMPLES, TAPS, ("none", "J")) if row[1] > 1 or row[3] != "J"]
    return [*rows, *(row._replace(planted=True) for row in rows if row.samples > 1 and row.power == "none")]


def right_model(size: str, samples: int) -> HistogramModel:
    """Histograms of a size, always the same."""
    L, M = SIZES[size]
    K = _TAXELS[samples]
    p = np.random.default_rng(L * M).dirichlet(np.ones(SYMBOLS), size=(L, M, K))
    counts = np.maximum(1, np.round(1e6 * p)).astype(np.int64)
    return HistogramModel(grid_of(L, M), np.arange(SYMBOLS + 1.0), "none", Preprocessing(samples), counts, 0.0)


def verdicts(design: Design, data_sets: int, references: int, seed: int) -> dict[tuple[str, float], Counter[str]]:
    """What an audit calls the beliefs in the data sets of a design, by policy and threshold."""
    right = right_model(design.size, design.samples)
    used = replace(right, power=design.power)
    table_ = tap_table(used, draw_session(right, design.taps, seed))
    found = {}
    for policy in POLICIES:
        aim, theta_x = (used.grid.L - 1) // 2, 1.0 if policy == "passive" else 0.0
        play = PlaySettings(theta_x=theta_x, fixation=aim, border="clamp", deadline=DEADLINE)
        options: dict[str, Any] = {"play": play, "trials": TRIALS}
        reference = simulate(used, table_, THETAS, seed=2 * seed + 1, simulations=references, **options)
        draw = partial(drawn, design, right, used, table_)
        observed = simulate(used, table_, THETAS, seed=2 * seed, simulations=data_sets, draw=draw, **options)
        for h, theta in enumerate(THETAS):
            beside = [compared(found[:, h], null[:, h]) for found, null in zip(observed, reference, strict=True)]
            counts = Counter(state(row[0], design.taps) for row in beside[0])
            counts[OBJECT] = sum(min(one.above, one.below) <= LEVEL / 2 for row in beside[0] for one in row[1:])
            counts[PROMISE] = sum(bool(rejected([one.above for one in row], LEVEL).any()) for row in beside[1])
            found[policy, theta] = counts
    return found


def compared(observed: NDArray[np.float64], reference: NDArray[np.float64]) -> list[list[Beside]]:
    """Each column of each data set beside the reference; shapes (data sets, 1 + M) and (references, 1 + M)."""
    return [[compare(value, null) for value, null in zip(row, reference.T, strict=True)] for row in observed]


def state(one: Beside, taps: int) -> str:
    """The verdict; at these powers the interval of the factor has no part in it."""
    factor = (one.value,) * 3 if not np.isnan(one.value) else (None,) * 3
    return calibration(BeliefEvidence(factor, 0.0, one, True, {}, taps))


def drawn(
    design: Design, right: HistogramModel, used: HistogramModel, like: TapTable, generator: np.random.Generator
) -> TapTable:
    """A data set of a design as the model in use sees it."""
    _, where, what = (np.repeat(index.ravel(), like.pool.count.ravel()) for index in np.indices(like.pool.count.shape))
    taps = right.form.sample(where, what, right.edges, design.samples, generator)
    if design.planted:
        taps = np.repeat(taps[:, :1], design.samples, axis=1)
    return like._replace(log_likelihood=used.log_likelihood(taps))


def learned(size: str, samples: int, taps: int, seed: int) -> dict[tuple[float, str], str]:
    """What an audit calls the beliefs of a learned exponent in one data set, by threshold and policy."""
    right = right_model(size, samples)
    train, test = (draw_session(right, taps, derived_seed(seed, Purpose.REPEAT, i), 0) for i in range(2))
    model = replace(right, power=best_power(right, [train], _CONTACTS, seed).power)
    return called(model, test, Setting.of(border="clamp"), THETAS, seed)


def on_rig(name: str, seed: int) -> dict[tuple[float, str], str]:
    """What an audit calls the beliefs in one data set of a simulated rig, by threshold and policy."""
    train, test = (simulate_session(preset(name), seed, session) for session in (0, 1))
    model = fit(train, train.grid())
    return called(model, model.usable(test), Setting(), (Setting().play.threshold,), seed)


def called(
    model: TapModel, test: TapSet, setting: Setting, thetas: Sequence[float], seed: int
) -> dict[tuple[float, str], str]:
    """What an audit calls the beliefs of a model in trials on test taps, by threshold and policy.

    Intervals, which take longest, have a part in that only where the test rejects.
    """
    table, verdicts = tap_table(model, test), {}

    def found(theta: float, policy: str, resamples: int) -> dict[str, Any]:
        options = {"only": policy, "contacts": (), "resamples": resamples, "trials": TRIALS, "seed": seed}
        return headline(decisions(table, model.grid, setting, [theta], **options), policy, theta)

    for policy in POLICIES:
        reference = simulate(
            model,
            table,
            thetas,
            play=setting.play.changed(passive=policy == "passive"),
            trials=TRIALS // 2,
            seed=seed,
        )
        for theta, factors in zip(thetas, np.moveaxis(reference.factor, 1, 0), strict=True):
            judged = judge(found(theta, policy, 1), model, table.pool, factors)
            if min(judged.beside.above, judged.beside.below) > LEVEL / 2:
                verdicts[theta, policy] = NOT_REJECTED
            else:
                factor = factor_of(found(theta, policy, RESAMPLES)["all trials"])
                verdicts[theta, policy] = calibration(judged._replace(factor=factor))
    return verdicts


def shares(found: Counter[str], M: int) -> list[str]:
    """How often each verdict was given, and where known how often an object's factor and a promise was rejected."""
    of = sum(n for name, n in found.items() if name not in (OBJECT, PROMISE))
    told = [share_interval(sum(found[state] for state in some), of) for some in (STATES[:1], STATES[1:], STATES)]
    return (
        [*told, share_interval(found[OBJECT], of * M), share_interval(found[PROMISE], of)] if PROMISE in found else told
    )


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=400, help="data sets of the first two tables; 0 to skip")
    parser.add_argument("--references", type=int, default=1999, help="simulated data sets of a reference")
    parser.add_argument("--learned", type=int, default=200, help="data sets with a learned exponent; 0 to skip")
    parser.add_argument("--rigs", type=int, default=200, help="data sets per simulated rig; 0 to skip")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--sizes", nargs="*", choices=SIZES, default=list(SIZES))
    options = parsed(parser, *BLOCKS)
    lines: dict[str, list[list[str]]] = {block: [] for block in BLOCKS}
    measured = []

    def note(block: str, row: list[Any], found: Counter[str]) -> None:
        lines[block].append([*map(str, row), *shares(found, SIZES[row[0]][1] if row[0] in SIZES else 0)])
        measured.append([block, *row, dict(found)])
        print(block, *lines[block][-1], flush=True)
        write_json("calibration_level", measured)
        if options.document is not None:
            first = "rig" if block == RIG_BLOCK else "size"
            write_block(options.document, block, table([first, *HEAD][: len(lines[block][0])], lines[block]))

    with processes() as pool:
        task = partial(verdicts, data_sets=options.data_sets, references=options.references, seed=options.seed)
        rows = designs(options.sizes if options.data_sets else [])
        for design, found in zip(rows, pool.map(task, rows), strict=True):
            for (policy, theta), counts in found.items():
                row = [design.size, design.samples, design.taps, theta, design.power, policy]
                note(POWER_BLOCK if design.planted else LEVEL_BLOCK, row, counts)
        for row in product(options.sizes if options.learned else (), SAMPLES, TAPS):
            seeds = [derived_seed(options.seed, Purpose.STUDY, number) for number in range(options.learned)]
            found = list(pool.map(partial(learned, *row), seeds, chunksize=4))
            for theta, policy in product(THETAS, POLICIES):
                counts = Counter(one[theta, policy] for one in found)
                note(LEARNED_BLOCK, [*row, theta, "learned", policy], counts)
        for name in RIGS if options.rigs else ():
            seeds = [data_set_seed(options.seed, number) for number in range(options.rigs)]
            found = list(pool.map(partial(on_rig, name), seeds, chunksize=4))
            for theta, policy in found[0]:
                counts = Counter(one[theta, policy] for one in found)
                note(RIG_BLOCK, [name, 50, 20, theta, "J", policy], counts)


if __name__ == "__main__":
    main()
