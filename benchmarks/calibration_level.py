"""How often the calibration verdict of an audit is false where the model is right, and how often it finds a fault.

Taps are drawn from the very histograms that judge them, 12 symbols, Dirichlet 1, border clamp, as many of each class as
the row says. A verdict `overconfident` is false at any power up to the right one, `cautious` at power none. `learned`
is the exponent of `tempering.best_power` on as many other taps. Planted dependence repeats one sample of a tap J times,
which power none takes for J.

`python benchmarks/calibration_level.py --document docs/intervals.md` writes the tables of that page.
"""

import argparse
from collections import Counter
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from intervals import SYMBOLS, grid_of
from solidtouch.analysis.audit_verdict import calibration
from solidtouch.analysis.remedy_scores import judge
from solidtouch.hardware.model_rig import draw_session
from solidtouch.inference.tempering import best_power
from solidtouch.inference.trial_plan import tap_table
from solidtouch.models.histogram import HistogramModel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.setting import Setting
from solidtouch.models.taps import TapSet
from studies import check_block, processes, share_interval, table, write_block, write_json

SIZES = {"6 x 3": (6, 3), "16 x 5": (16, 5)}
SAMPLES, TAPS, THETAS, POLICIES = (1, 5), (5, 20, 60), (0.9, 0.99), ("passive", "active")
LEARNED = "learned"
TRIALS = 2000
LEVEL_BLOCK, POWER_BLOCK = "level", "power"
_TAXELS = {1: 2, 5: 1}  # so that decisions take several taps
_CONTACTS = 10  # after which exponents are learned


class Case(NamedTuple):
    """One row.

    Attributes:
        size: Key of `SIZES`.
        samples: J.
        taps: Of each class.
        theta: Threshold.
        power: `"none"`, `"J"` or `LEARNED`.
        policy: `"passive"` or `"active"`.
        planted: Whether one sample of a tap is repeated J times.
    """

    size: str
    samples: int
    taps: int
    theta: float
    power: str
    policy: str
    planted: bool = False


def cases(sizes: list[str], powers: list[str]) -> list[Case]:
    """All rows; with one sample power J is power none."""
    rows = [
        Case(*row) for row in product(sizes, SAMPLES, TAPS, THETAS, powers, POLICIES) if row[1] > 1 or row[4] != "J"
    ]
    return [*rows, *(row._replace(planted=True) for row in rows if row.samples > 1 and row.power == "none")]


def right_model(size: str, samples: int) -> HistogramModel:
    """Histograms of a size, always the same."""
    L, M = SIZES[size]
    K = _TAXELS[samples]
    p = np.random.default_rng(L * M).dirichlet(np.ones(SYMBOLS), size=(L, M, K))
    counts = np.maximum(1, np.round(1e6 * p)).astype(np.int64)
    return HistogramModel(grid_of(L, M), np.arange(SYMBOLS + 1.0), counts, 0.0, "none", Preprocessing(samples))


def verdict(case: Case, seed: int) -> str:
    """What the audit calls the beliefs in one data set."""
    model = right_model(case.size, case.samples)
    number = 10 * seed
    taps = draw_session(model, case.taps, number, case.taps)
    if case.planted:
        taps = TapSet(taps.dataset.assign(taps=taps.dataset["taps"].isel(sample=[0] * case.samples)))
    if case.power == LEARNED:
        learned = best_power(model, [draw_session(model, case.taps, number + 1, case.taps)], _CONTACTS, seed)
        model = replace(model, power=learned.power)
    else:
        model = replace(model, power=case.power)
    setting = Setting(threshold=case.theta, border="clamp", passive=case.policy == "passive")
    return calibration(judge(model, tap_table(model, taps), model.grid, setting, case.policy, TRIALS, seed))


def counted(case: Case, found: Counter[str]) -> list[str]:
    """A row of the table."""
    n = found.total()
    told = [share_interval(found[state], n) for state in ("overconfident", "cautious")]
    return [case.size, *map(str, case[1:6]), *told]


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sizes", nargs="*", choices=SIZES, default=list(SIZES))
    parser.add_argument("--powers", nargs="*", choices=("none", "J", LEARNED), default=["none", "J", LEARNED])
    parser.add_argument("--document", type=Path)
    options = parser.parse_args()
    for block in (LEVEL_BLOCK, POWER_BLOCK):
        check_block(options.document, block)
    rows: list[tuple[Case, Counter[str]]] = []
    with processes() as pool:
        for case in cases(options.sizes, options.powers):
            seeds = range(options.seed, options.seed + options.data_sets)
            found = Counter(pool.map(partial(verdict, case), seeds, chunksize=4))
            rows.append((case, found))
            print(*counted(case, found), "planted" if case.planted else "", flush=True)
            write_json("calibration_level", [[*case, dict(found)] for case, found in rows])
    if options.document is not None:
        head = ["size", "J", "taps per class", "threshold", "power", "policy", "overconfident", "cautious"]
        for block, planted in ((LEVEL_BLOCK, False), (POWER_BLOCK, True)):
            lines = [counted(case, found) for case, found in rows if case.planted == planted]
            write_block(options.document, block, table(head, lines))


if __name__ == "__main__":
    main()
