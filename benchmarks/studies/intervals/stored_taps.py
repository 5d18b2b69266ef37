"""Apparent overconfidence of right beliefs when trials draw stored taps repeatedly.

Taps are drawn from the histograms that classify them, as in coverage.py, and trials are played twice: with stored taps
drawn with replacement, and without using any tap twice. The true miscalibration factor of the latter is 1.

`--document docs/explanation/intervals.md` updates the table of that page.
"""

import argparse
from functools import partial

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.stats.decided import decided_trials
from solidtouch.inference.episode import DEADLINE
from solidtouch.inference.trials.records import plan_trials
from solidtouch.models.settings import PlaySettings

from benchmarks.page import mean_interval, parsed, table, write_block
from benchmarks.studies.intervals.coverage import SIZES, TAPS, THETA, TRIALS, draw
from benchmarks.study import processes

BLOCK = "stored"
POLICIES = {"passive": 1.0, "active": 0.0}


def factors(L: int, M: int, taps: int, seed: int) -> NDArray[np.float64]:
    """Wrong decisions and the doubt in them, shape (2, 2, 2): policy, stored or fresh, wrong or doubt."""
    tables, _ = draw(L, M, taps, seed)
    right = tables["right"]
    plan = plan_trials(right.pool, TRIALS, seed, (L - 1) // 2)
    found = np.empty((len(POLICIES), 2, 2))
    for i, theta_x in enumerate(POLICIES.values()):
        play = PlaySettings(theta_x=theta_x, border="clamp", deadline=DEADLINE)
        for j, fresh in enumerate((False, True)):
            (one,) = decided_trials(right, plan, (THETA,), play, seed, fresh=fresh)
            found[i, j] = (one.decided != one.true).mean(), (1 - one.belief).mean()
    return found


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=100, help="number of data sets")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    options = parsed(parser, BLOCK)
    rows = []
    with processes() as pool:
        for size, (L, M) in SIZES.items():
            for taps in TAPS:
                seeds = range(options.seed, options.seed + options.data_sets)
                found = np.array(list(pool.map(partial(factors, L, M, taps), seeds)))
                ratio = found[..., 0] / found[..., 1].mean(axis=0)  # so that the mean is a ratio of means
                for i, policy in enumerate(POLICIES):
                    rows.append([size, str(taps), policy, *(mean_interval(ratio[:, i, j]) for j in range(2))])
                    print(*rows[-1], flush=True)
    text = table(["size", "taps per class", "policy", "stored taps", "fresh taps"], rows)
    write_block(options.document, BLOCK, text)


if __name__ == "__main__":
    main()
