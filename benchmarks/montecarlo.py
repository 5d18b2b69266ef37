"""Times the Monte Carlo beside a plain loop over trials, on one simulated data set; `make bench`.

Ratios on one machine count, absolute times do not. The unit is a useful tap: one that comes before the slowest
threshold is crossed.
"""

import argparse
import time

import numpy as np
from solidtouch.hardware.data_collection import simulate_session
from solidtouch.hardware.presets import preset
from solidtouch.inference import reference
from solidtouch.inference.montecarlo import THRESHOLDS, TapTable, TrialPlan, plan_trials, run_trials, tap_table
from solidtouch.models.histogram import fit


def loop(table: TapTable, plan: TrialPlan, theta_x: float, deadline: int, seed: int) -> int:
    """The same job as a loop over trials and taps with the reference equations; returns the number of taps."""
    rng = np.random.default_rng(seed)
    taps = 0
    for where, what, fixation in zip(plan.where, plan.what, plan.fixation, strict=True):
        position, belief = int(where), np.exp(table.log_prior)
        for _ in range(deadline):
            tap = table.pool.pick(position, int(what), rng.random())
            belief, _ = reference.update(belief, table.log_likelihood[tap])
            taps += 1
            if reference.what_decision(belief, max(THRESHOLDS)) is not None:
                break
            at = reference.where_decision(belief, theta_x)
            if at is not None:
                delta = reference.fixation_move(at, int(fixation))
                position = min(max(position + delta, 0), len(belief) - 1)
                belief = reference.shift(belief, delta)
    return taps


def main() -> None:
    """Prints nanoseconds per useful tap of both, passive and active."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=16000)
    parser.add_argument("--loop-trials", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    train, test = (simulate_session(preset("paper"), 0, session) for session in (0, 1))
    model = fit(train, train.grid())
    table = tap_table(model, test)
    for policy, theta_x in (("passive", 1.0), ("active", 0.0)):
        plan = plan_trials(table.pool, options.trials, 0, fixation=7)
        few = TrialPlan(*(field[: options.loop_trials] for field in plan))
        run_trials(table, plan, THRESHOLDS, theta_x=theta_x)  # compiles
        ratios, fast = [], []
        for round_ in range(options.rounds):
            began = time.perf_counter()
            trials = run_trials(table, plan, THRESHOLDS, theta_x=theta_x)
            fast.append((time.perf_counter() - began) / trials.taps.max(axis=1).sum())
            ratios.append(_timed_loop(table, few, theta_x, round_) / fast[-1])
        print(
            f"{policy:8} {1e9 * np.median(fast):8.0f} ns per useful tap, {np.median(ratios):5.0f} times the plain loop"
        )


def _timed_loop(table: TapTable, plan: TrialPlan, theta_x: float, seed: int) -> float:
    began = time.perf_counter()
    taps = loop(table, plan, theta_x, 100, seed)
    return (time.perf_counter() - began) / taps


if __name__ == "__main__":
    main()
