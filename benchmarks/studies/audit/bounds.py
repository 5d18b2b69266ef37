"""Level and power of the two tests of exceeded bounds: Holm's method, and that of the largest excess in previews.

Data sets are drawn from a model and played with it, which makes beliefs right, or with its log-likelihoods times a
number above 1, which makes them overconfident. Each is compared with others of the right model. The condition that the
interval of a factor lies above 1, which audits set beside the tests and which makes them stricter, is left out.

`--document docs/explanation/audit-studies.md` updates the table of that page.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.audit.guarantees import of_largest
from solidtouch.analysis.experiment.sources import right_model
from solidtouch.analysis.stats.detection import LEVEL
from solidtouch.analysis.stats.right_model import compare, drawn_table, simulate
from solidtouch.analysis.stats.uniformity import rejected
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.trials.records import TapTable, tap_table
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.settings import PlaySettings

from benchmarks.page import check_block, share_interval, table, write_block
from benchmarks.study import until_interrupted, write_json

THETA = 0.9
FACTORS = (1.0, 1.1, 1.2, 1.3, 1.5)
SIMULATIONS = {"largest": 39, "Holm": 119}
_TAPS, _TRIALS = 20, 500


def shares(model: HistogramModel, shape: TapTable, factor: float, number: int, seed: int) -> NDArray[np.float64]:
    """Shares of trials that stop for another object, of so many data sets played with a factor, (number, 1 + M)."""

    def draw(generator: np.random.Generator) -> TapTable:
        drawn = drawn_table(model, shape, generator)
        return drawn._replace(log_likelihood=factor * drawn.log_likelihood)

    play = PlaySettings(passive=True, border="clamp")
    return simulate(model, shape, [THETA], play=play, trials=_TRIALS, seed=seed, simulations=number, draw=draw).missed[
        :, 0
    ]


def rejections(
    observed: NDArray[np.float64], right: NDArray[np.float64]
) -> dict[str, tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Of each test and data set (N, V), whether any value is rejected and whether the first one is, of all objects.

    Data sets of the right model (S, V) are taken in turn; data sets share some.
    """
    found = {}
    for name, number in SIMULATIONS.items():
        results = []
        for i, one in enumerate(observed):
            own = right[np.arange(i * number, (i + 1) * number) % len(right)]
            if name == "Holm":
                results.append(rejected([compare(a, b).above for a, b in zip(one, own.T, strict=True)], LEVEL))
            else:
                results.append(of_largest(one, own, LEVEL))
        found[name] = np.array(results).any(axis=1), np.array(results)[:, 0]
    return found


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=400, help="data sets of each factor")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    check_block(options.document, "bounds")
    N, model = options.data_sets, right_model(options.seed)
    shape = tap_table(model, draw_session(model, _TAPS, options.seed, 0))
    right = shares(model, shape, 1.0, 10 * N, options.seed)
    tasks = [partial(shares, model, shape, factor, N, options.seed + 1 + i) for i, factor in enumerate(FACTORS)]
    lines, measured = [], {}
    for factor, observed in zip(FACTORS, until_interrupted("Factors", tasks), strict=False):
        found = rejections(observed, right)
        measured[str(factor)] = {name: [float(part.mean()) for part in parts] for name, parts in found.items()}
        cells = [share_interval(int(part.sum()), len(part)) for parts in found.values() for part in parts]
        lines.append([f"{factor:g}", f"{observed[:, 0].mean():.3f}", *cells])
    if len(lines) < len(FACTORS):
        return
    write_json("bounds", measured)
    heads = [f"{name}, {number} data sets: {what}" for name, number in SIMULATIONS.items() for what in ("any", "all")]
    text = (
        f"Taps of the right model, {_TAPS} of each class, {_TRIALS} passive trials to {THETA:g}, whose log-likelihoods "
        f"are multiplied by a factor; {N} data sets of each factor, seed {options.seed}. Shares of data sets in which "
        "a bound of any kind, or that of all objects together, is rejected at "
        f"{LEVEL:.0%}, with 95% intervals.\n\n" + table(["factor", "wrong", *heads], lines)
    )
    print(text)
    if options.document is not None:
        write_block(options.document, "bounds", text)


if __name__ == "__main__":
    main()
