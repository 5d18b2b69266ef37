"""Why intervals over sessions left out in turn are wider than t-intervals of their results.

Mean taps of decisions on each session, under the model of the other sessions and under one model of other taps, against
fresh taps under the same models. Only in the first case do sessions depend on each other.

`--document docs/explanation/intervals-commands.md` updates the table of that page.
"""

import argparse
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.tuning.held_out import held_out
from solidtouch.models.measurement.model import TapModel
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.studies.intervals.commands import AIM, GRID, PLAY, THETA, TRUTHS, drawn, fitted, large, true_means
from benchmarks.study import processes, until_interrupted

BLOCK = "shared-training"
SESSIONS, TAPS, TRIALS = (5, 10), 20, 2000
_OTHER = 1 << 21  # number of the data set that other models are fitted to
KINDS = ("of the other sessions", "one of other taps")


class Means(NamedTuple):
    """Mean taps on each session and what fresh taps give under its model, each of shape (F,)."""

    estimate: tuple[float, ...]
    true: tuple[float, ...]


def measured(number: int, sessions: int) -> list[Means]:
    """For each of `KINDS`."""
    truth = number % TRUTHS
    recorded = concatenate([drawn(truth, TAPS, number, session) for session in range(sessions)])
    parts = held_out(recorded, GRID, fitted).parts
    other = concatenate([drawn(truth, TAPS, _OTHER + number, session) for session in range(sessions - 1)])
    models = [[part.model for part in parts], [fitted(other, GRID)] * sessions]
    return [means(number, truth, [part.taps for part in parts], of) for of in models]


def means(number: int, truth: int, tested: list[TapSet], models: list[TapModel]) -> Means:
    """Trials of each session have random numbers of their own."""
    estimate, true, play = [], [], PLAY.changed(theta_x=0.0)
    for f, (taps, model) in enumerate(zip(tested, models, strict=True)):
        own = tap_table(model, taps)
        plan = plan_trials(own.pool, TRIALS, number, AIM, first_stream=f * TRIALS)
        estimate.append(float(run_trials(own, plan, (THETA,), play=play, seed=number, fresh=True).taps.mean()))
        true.append(true_means(tap_table(model, large(truth)))["taps"])
    return Means(tuple(estimate), tuple(true))


def row(sessions: int, kind: str, found: list[Means]) -> list[str]:
    """Standard deviation of the mean's error, standard error of a t-interval, and how often that holds the truth."""
    estimate, true = (np.array(values) for values in zip(*found, strict=True))
    error, used = (estimate - true).mean(axis=1), estimate.std(axis=1, ddof=1) / np.sqrt(sessions)
    held = int((np.abs(error) <= stdtrit(sessions - 1, 0.975) * used).sum())
    spread = f"{error.std():.4f}", f"{np.sqrt((used**2).mean()):.4f}"
    return [f"{sessions}", kind, *spread, share_interval(held, len(found))]


def main() -> None:
    """Measures, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=200, help="number of data sets")
    options = parsed(parser, BLOCK)
    lines = []
    with processes() as workers:
        for sessions in SESSIONS:
            tasks = [workers.submit(measured, number, sessions) for number in range(options.data_sets)]
            done = list(until_interrupted(f"{sessions} sessions", [one.result for one in tasks]))
            lines += [
                row(sessions, kind, list(found)) for kind, found in zip(KINDS, zip(*done, strict=True), strict=True)
            ]
    head = ["sessions", "models", "sd of the error", "standard error of t", "coverage of t"]
    text = f"{options.data_sets} data sets, active mean taps at theta {THETA:g}.\n\n{table(head, lines)}"
    print(text)
    write_block(options.document, BLOCK, text)


if __name__ == "__main__":
    main()
