"""How often a tuned exponent or saturation is called lower than that of a correct model, for right and wrong models.

Histograms of known truth give one session of taps for training and one of equal size for tuning. Exponent and
saturation are tuned and compared with those of a correct model as in an audit; `learned` is the exponent of `fit
--power learned`, which leaves out each of the two sessions in turn. Truths are tables of 12 symbols from Dirichlet 1,
and normal curves over 30 bins at 6 x 3 classes, new in each data set. Planted dependence repeats one sample of each tap
J times.

`--document docs/explanation/intervals.md` updates the tables of that page.
"""

import argparse
import json
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from solidtouch.analysis.audit.remedies import BASELINE, EXPONENT, FALLING, Remedy, beside_right
from solidtouch.analysis.stats.right_exponent import Tuned, learned_beside, outside
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.tuning.tempering import best_power, fit_tempered, learn_saturation
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, derived_seed
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.studies.intervals.calibration import SIZES, TAPS
from benchmarks.studies.intervals.coverage import SYMBOLS, grid_of
from benchmarks.study import OUT, processes, write_json

LEVEL_BLOCK, POWER_BLOCK = "exponent-level", "exponent-power"
TRUTHS = (("Dirichlet", 1), ("Dirichlet", 5), ("normal curves", 5))
COLUMNS = ("exponent", "falling: exponent", "falling: saturation", "learned")
_BINS, _WIDTH = 30, 3.0  # of the normal curves, in bins
_CONTACTS = 10  # after which exponents are judged


class Design(NamedTuple):
    """What a data set is drawn from.

    Attributes:
        size: Key of `SIZES`.
        truth: What the tables are like.
        samples: J.
        taps: Of each class and session.
        planted: Whether one sample of a tap is repeated J times.
    """

    size: str
    truth: str
    samples: int
    taps: int
    planted: bool = False


def designs(sizes: list[str], taps: list[int]) -> list[Design]:
    """All of them; normal curves over many bins, which take longest, at one size only."""
    every = [Design(size, *truth, n) for size, truth, n in product(sizes, TRUTHS, taps)]
    rows = [row for row in every if row.truth == "Dirichlet" or row.size == "6 x 3"]
    return [*rows, *(row._replace(planted=True) for row in rows if row.samples > 1)]


def truth_of(design: Design, seed: int) -> HistogramModel:
    """Histograms of a seed."""
    (L, M), K = SIZES[design.size], 2 if design.samples == 1 else 1
    generator = np.random.default_rng([seed, L, M])
    if design.truth == "Dirichlet":
        p = generator.dirichlet(np.ones(SYMBOLS), size=(L, M, K))
    else:
        p = np.diff(norm.cdf(np.arange(_BINS + 1.0), generator.uniform(0, _BINS, size=(L, M, K, 1)), _WIDTH), axis=-1)
    counts = np.maximum(1, np.round(1e6 * p / p.sum(axis=-1, keepdims=True))).astype(np.int64)
    edges = np.arange(counts.shape[-1] + 1.0)
    return HistogramModel(grid_of(L, M), edges, "none", Preprocessing(design.samples), counts, 0.0)


def lower(design: Design, fixed: bool, seed: int) -> list[bool]:
    """Whether each of `COLUMNS` is called lower than that of a correct model in one data set."""
    right = truth_of(design, 0 if fixed else seed)
    own = derived_seed(seed, Purpose.REPEAT, design.taps)
    train, tune = (draw_session(right, design.taps, own, session) for session in range(2))
    if design.planted:
        train, tune = copied(train), copied(tune)
    grid, B = right.grid, right.counts.shape[-1]
    setting = Setting.of(bins=B, power="none")
    model = fit_model("histogram", train, grid, FitSettings(bins=B, power="none")).model
    power, falling = best_power(model, [tune], _CONTACTS, seed).power, learn_saturation(model, [tune], seed=seed)
    limit = None if np.isinf(falling.saturation) else falling.saturation
    tuned = {
        BASELINE: setting,
        EXPONENT: Setting.of(bins=B, power=power),
        FALLING: Setting.of(bins=B, power=falling.power, saturation=limit),
    }
    remedies = [Remedy(name, "", "", one, model, grid, "") for name, one in tuned.items()]
    _, one, other = (remedy.beside for remedy in beside_right(remedies, train, [tune], _CONTACTS, own, lambda _: None))
    both, settings = concatenate([train, tune]), FitSettings(bins=B, power=f"learned:{_CONTACTS}", seed=own)
    fitted, _ = fit_tempered("histogram", both, grid, settings)
    learned = learned_beside("histogram", fitted.model, both, settings, _CONTACTS)
    return [*_lower(one), *_lower(other), *_lower(learned)]


def _lower(tuned: Tuned | None) -> list[bool]:
    if tuned is None:
        return []
    return [outside(beside) for beside in (tuned.power, tuned.saturation) if beside is not None]


def copied(taps: TapSet) -> TapSet:
    """The first sample of each tap, as often as it has samples."""
    first = np.repeat(taps.taps[:, :1], taps.taps.shape[1], axis=1)
    return TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, first)))


def shares(found: NDArray[np.bool_]) -> list[str]:
    """How often each of `COLUMNS` was called lower."""
    return [share_interval(int(hits), len(found)) for hits in found.sum(axis=0)]


def tables(measured: list[tuple[Design, list[list[bool]]]]) -> dict[str, str]:
    """The tables of the page, by block."""
    head, blocks = ["size", "tables", "J", "taps per class", "data sets", *COLUMNS], {}
    for block, planted in ((LEVEL_BLOCK, False), (POWER_BLOCK, True)):
        some = {design: np.array(found) for design, found in measured if design.planted == planted}
        rows = [[*map(str, design[:-1]), str(len(found)), *shares(found)] for design, found in some.items()]
        if some and not planted:
            every = np.concatenate(list(some.values()))
            rows.append(["all", "", "", "", str(len(every)), *shares(every)])
        if rows:
            blocks[block] = table(head, rows)
    return blocks


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=200, help="data sets per row")
    parser.add_argument("--planted", type=int, default=40, help="data sets per row with planted dependence")
    parser.add_argument("--fixed", action="store_true", help="use the same tables in all data sets")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--sizes", nargs="*", choices=SIZES, default=list(SIZES))
    parser.add_argument("--taps", nargs="*", type=int, default=list(TAPS))
    parser.add_argument(
        "--add", action="store_true", help="add the rows missing from the last run with the same options"
    )
    options = parsed(parser, LEVEL_BLOCK, POWER_BLOCK)
    measured: list[tuple[Design, list[list[bool]]]] = []
    if options.add:
        try:
            old = json.loads((OUT / "exponent_level.json").read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            parser.error(f"--add needs what an earlier run left: {error}")
        measured = [(Design(*design), found) for *design, found in old]
    finished = {design for design, _ in measured}
    with processes() as pool:
        for design in designs(options.sizes, options.taps):
            if design in finished:
                continue
            number = options.planted if design.planted else options.data_sets
            seeds = [derived_seed(options.seed, Purpose.STUDY, n) for n in range(number)]
            found = list(pool.map(partial(lower, design, options.fixed), seeds, chunksize=2))
            measured.append((design, found))
            print(*design, len(found), *shares(np.array(found)), flush=True)
            write_json("exponent_level", [[*design, found] for design, found in measured])
            for block, text in tables(measured).items():
                write_block(options.document, block, text)


if __name__ == "__main__":
    main()
