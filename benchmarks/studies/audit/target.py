"""Whether a threshold tuned for a target error reaches it in a new session.

Simulated data sets of the paper's size with drift between sessions. In each, one session is training data, five are for
tuning, and the others are fresh: the first is what a user would meet, and all of them give the fractions with less
noise. The error of a fresh session should lie in the 90% prediction interval, and a target called reachable should be
met.

`--document docs/explanation/audit-studies.md` updates the table of that page.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.stats.target_error import Curves, choose, leave_out, predicted, session_curves
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import RigSettings, preset
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.settings import PlaySettings

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.study import until_interrupted, write_json

TUNING = 5
FRESH = 4
"""Sessions of a data set, after the one that trains."""
TARGETS = (0.05, 0.1, 0.2, 0.4, 0.6)
POLICIES = {"active": 0.0, "passive": 1.0}
_DRIFTS = ("session_gain_log_sd", "session_taxel_gain_log_sd", "mounting_x_mm", "mounting_y_mm")


def rigs() -> dict[str, RigSettings]:
    """Rigs by name: the paper's, with half and twice its differences between sessions, and without."""
    paper = preset("paper")

    def drifting(times: float) -> RigSettings:
        return replace(paper, **{name: times * getattr(paper, name) for name in _DRIFTS})

    return {"paper": paper, "half drift": drifting(0.5), "double drift": drifting(2.0), "nodrift": preset("nodrift")}


class Outcome(NamedTuple):
    """One target in one data set.

    Attributes:
        target: The wanted error.
        reachable: What five sessions say of it.
        theta: The threshold that they choose.
        expected: The error that they expect there.
        low: Lower end of the prediction interval.
        high: Its upper end.
        taps: The reaction time that they expect.
        fresh: Errors of fresh sessions at that threshold.
        left_out: Mean error of the tuning sessions, each under the threshold of the others.
    """

    target: float
    reachable: bool
    theta: float
    expected: float
    low: float
    high: float
    taps: float
    fresh: tuple[float, ...]
    left_out: float

    @property
    def covered(self) -> list[bool]:
        """Whether the error of each fresh session lies in the interval."""
        return [self.low <= error <= self.high for error in self.fresh]

    @property
    def broken(self) -> list[bool]:
        """Whether the target is called reachable and a fresh session exceeds it."""
        return [self.reachable and error > self.target for error in self.fresh]


def data_set(settings: RigSettings, seed: int, trials: int) -> dict[str, list[Outcome]]:
    """Every target in one data set, by policy."""
    train = simulate_session(settings, seed, 0)
    model = fit(train, train.grid())
    sessions = [simulate_session(settings, seed, 1 + number) for number in range(TUNING + FRESH)]
    found = {}
    for policy, theta_x in POLICIES.items():
        curves, _, _ = session_curves(
            model, sessions, model.grid, play=PlaySettings(theta_x=theta_x), seed=seed, trials=trials
        )
        tuning = Curves(curves.theta, *(values[:TUNING] for values in curves[1:]))
        found[policy] = outcomes(tuning, curves.error[TUNING:])
    return found


def outcomes(tuning: Curves, fresh: NDArray[np.float64]) -> list[Outcome]:
    """Every target by the curves of tuning sessions and the errors of fresh ones, shape (fresh, H)."""
    found = []
    for target in TARGETS:
        h, reachable = choose(tuning.error, target)
        at = predicted(tuning, h)
        left = float(leave_out(tuning, target).error.mean())
        values = at.theta, at.error, at.low, at.high, at.taps
        found.append(Outcome(target, reachable, *values, tuple(fresh[:, h].tolist()), left))
    return found


type Results = dict[str, list[dict[str, list[Outcome]]]]
"""Of each rig, data set and policy."""


def result_table(results: Results) -> str:
    """A line for each rig, policy and target; targets that come to the same everywhere share one."""
    lines = []
    for name, sets in results.items():
        for policy in POLICIES:
            columns: dict[tuple[float, ...], list[list[Outcome]]] = {}
            for column in zip(*(one[policy] for one in sets), strict=True):
                key = tuple(number for one in column for number in (one.theta, one.reachable, *one.broken))
                columns.setdefault(key, []).append(list(column))
            lines += [[name, policy, *_cells(alike)] for alike in columns.values()]
    head = ["data", "policy", "target", "fresh in interval", f"of {FRESH} fresh", "called reachable", "falsely"]
    more = ["false share of these", "expected error", "left out in turn", "fresh", "width", "taps"]
    return table([*head, *more], lines)


def _cells(alike: Sequence[Sequence[Outcome]]) -> list[str]:
    """What the table says of targets that chose the same thresholds in all data sets."""
    own = alike[-1]
    n, claims = len(own), [one for one in own if one.reachable]
    covered = sum(sum(one.covered) for one in own)
    means = [np.mean([getattr(one, name) for one in own]) for name in ("expected", "left_out", "fresh")]
    return [
        ", ".join(f"{column[0].target:g}" for column in alike),
        f"{sum(one.covered[0] for one in own)} of {n}",
        share_interval(covered, n * FRESH),
        f"{len(claims)} of {n}",
        f"{sum(one.broken[0] for one in own)} of {n}",
        f"{np.mean([share for one in claims for share in one.broken]):.2f}" if claims else "-",
        *(f"{value:.3f}" for value in means),
        f"{np.mean([one.high - one.low for one in own]):.2f}",
        f"{np.mean([one.taps for one in own]):.1f}",
    ]


def page(results: Results, seed: int, trials: int) -> str:
    """What the page says of the results."""
    n = max(map(len, results.values()))
    return (
        f"{n} data sets of each rig, seed {seed}: one session is for training, {TUNING} are for tuning and {FRESH} are "
        f"fresh; {trials} trials in each. *Fresh in interval* and *falsely* (called reachable, and exceeded) count the "
        "first fresh session of each data set; *of fresh* and *false share* count all of them. *Left out in turn* is "
        f"the error of tuning sessions under thresholds chosen from the other four.\n\n{result_table(results)}"
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=40, help="data sets per rig")
    parser.add_argument("--rigs", nargs="*", choices=list(rigs()), default=list(rigs()))
    parser.add_argument("--trials", type=int, default=1000, help="trials per session")
    parser.add_argument("--seed", type=int, default=300)
    options = parsed(parser, "target-error")
    seeds = [data_set_seed(options.seed, d) for d in range(options.data_sets)]
    tasks: list[Callable[[], tuple[str, dict[str, list[Outcome]]]]] = [
        partial(_named, name, seed, options.trials) for seed in seeds for name in options.rigs
    ]
    results: Results = {}
    for name, found in until_interrupted("Target error", tasks):
        results.setdefault(name, []).append(found)
    if not results:
        return
    measured = [
        {"rig": name, "policy": policy, "data_set": number, **one._asdict()}
        for name, sets in results.items()
        for number, found in enumerate(sets)
        for policy, each in found.items()
        for one in each
    ]
    write_json("target-error", measured)
    text = page(results, options.seed, options.trials)
    print(text)
    if options.document is not None and sum(map(len, results.values())) == len(tasks):
        write_block(options.document, "target-error", text)


def _named(name: str, seed: int, trials: int) -> tuple[str, dict[str, list[Outcome]]]:
    return name, data_set(rigs()[name], seed, trials)


if __name__ == "__main__":
    main()
