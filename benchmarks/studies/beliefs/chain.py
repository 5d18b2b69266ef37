"""Calibration of the whole chain: beliefs of all engines for a correct model, and with planted errors.

For a correct model (preset `model`: taps of four samples from fitted histograms, power none, border clamp) the truth
must rank uniformly, and decisions must be right as often as believed. An error planted in the filter alone must be
detected; the detection rate is counted over repetitions at several sample sizes, and without an error it is the
false-alarm rate. Repetitions use the array code, which is fastest.

`--document docs/explanation/calibration.md` updates the tables and the figure of that page.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.correctness.page import told_factor, told_p
from solidtouch.analysis.correctness.sbc import ARRAYS, LEVEL, POLICIES, ROUTES, Calibration, calibrate, judged
from solidtouch.analysis.correctness.sbc_chain import ACTIVE, Checkpoints, World
from solidtouch.analysis.experiment.sources import right_model
from solidtouch.analysis.stats.uniformity import JudgedBeliefs, error_factor
from solidtouch.inference.moves.control import default_fixation
from solidtouch.inference.reference import Border
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.seeds import Purpose, derived_seed, generator

from benchmarks.page import parsed, publish, share_interval, table, write_block
from benchmarks.studies.beliefs.figures import CalibrationPanel, calibration_figure
from benchmarks.studies.models.sbc import DRAWS, distribution, simultaneous_band
from benchmarks.study import until_interrupted, write_json

KINDS = ("rank", "credible set", "decisions", "decisions by belief")
SHARES = (0.5, 0.9, 1.0)
"""Which exchanged peaks are planted: so many of all taxels and objects cost at most as much per tap."""


class Sizes(NamedTuple):
    """Of the study: trials of each route, trials of a repetition, repetitions with an error and without."""

    trials: int = 6000
    repeated: tuple[int, ...] = (500, 1500, 6000)
    planted: int = 20
    right: tuple[int, ...] = (100, 100, 20)


class Planted(NamedTuple):
    """A filter with an error.

    Attributes:
        name: What is wrong.
        title: The same, short.
        believed: Its measurement model.
        border: Its reading of Eq. 9.
    """

    name: str
    title: str
    believed: HistogramModel
    border: Border = "clamp"


class Rate(NamedTuple):
    """How often an error is found."""

    name: str
    trials: int
    repetitions: int
    found: int
    kinds: Mapping[str, int]


def exchanged(model: HistogramModel, what: int, taxel: int) -> HistogramModel:
    """The model with the most probable bin of an object and taxel at the fixation point exchanged with the next one.

    The next bin is that of larger values; of the last bin, it is the one before.
    """
    counts = model.counts.copy()
    row = counts[default_fixation(model.grid.L), what, taxel]
    peak = int(row.argmax())
    other = peak + 1 if peak + 1 < len(row) else peak - 1
    row[[peak, other]] = row[[other, peak]]
    return replace(model, counts=counts)


def cost(model: HistogramModel, wrong: HistogramModel) -> float:
    """Kullback-Leibler divergence of a tap at the fixation point under the wrong model, over all objects, in nats."""
    l = default_fixation(model.grid.L)
    p, q = model.probabilities[l], wrong.probabilities[l]
    return float(model.preprocessing.samples * (p * np.log(p / q)).sum())


def exchanged_peaks(model: HistogramModel) -> list[Planted]:
    """Errors of one peak, by their cost: the median of all taxels and objects, higher ones, and the highest."""
    M, K = model.grid.M, model.K
    models = {(what, taxel): exchanged(model, what, taxel) for what in range(M) for taxel in range(K)}
    ranked = sorted(models, key=lambda key: cost(model, models[key]))
    found = []
    for share in SHARES:
        what, taxel = key = ranked[int(np.ceil(share * len(ranked))) - 1]
        nats = cost(model, models[key])
        name = f"peak of taxel {taxel} of object {what}, {nats:.2g} nats a tap"
        found.append(Planted(name, f"wrong peak, {nats:.2g} nats", models[key]))
    return found


def planted_errors(model: HistogramModel) -> list[Planted]:
    """The filter without an error, and all with one."""
    return [
        Planted("none", "no error", model),
        Planted("border uniform", "border uniform", model, "uniform"),
        Planted("power J", "power J", replace(model, power="J")),
        *exchanged_peaks(model),
    ]


def rate(truth: HistogramModel, error: Planted, trials: int, repetitions: int, seed: int) -> Rate:
    """Repeats a calibration with new random numbers."""
    results = [
        calibrate(
            truth,
            {ARRAYS: trials},
            believed=error.believed,
            border=error.border,
            seed=derived_seed(seed, Purpose.REPEAT, i),
        )
        for i in range(repetitions)
    ]
    kinds = [{test for _, test in result.failed} for result in results]
    found = sum(not result.passed for result in results)
    return Rate(error.name, trials, repetitions, found, {kind: sum(kind in one for one in kinds) for kind in KINDS})


def panel(error: Planted, truth: HistogramModel, trials: int, seed: int) -> CalibrationPanel:
    """Active trials of one filter: credible sets after two taps, factors at all moments."""
    world, moments = World(truth, error.believed, error.border), Checkpoints().names
    found = judged(ARRAYS, world, ACTIVE, trials, Checkpoints(), generator(seed, Purpose.STUDY))
    names = list(dict.fromkeys(quantity for _, quantity in found))
    band = simultaneous_band(trials)
    curves = {name: spread(found[moments[1], name].credible) for name in names}
    factors = {name: np.array([told(found[at, name]) for at in moments]) for name in names}
    return CalibrationPanel(error.title, band.z, band.low, band.high, curves, factors)


def spread(rank: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distribution function of numbers in [0, 1] less that of uniform ones, at the places of the band."""
    return distribution(np.minimum((DRAWS + 1) * rank, DRAWS).astype(np.intp))


def told(one: JudgedBeliefs) -> tuple[float, float, float]:
    """Wrong decisions over those announced with interval, NaN where there is neither one."""
    return error_factor(one) if max(one.doubt.sum(), (~one.right).sum()) >= 1 else (np.nan,) * 3


def right_table(result: Calibration) -> str:
    """A line for each route and policy."""
    lines, failed = [], result.failed
    for route in dict.fromkeys(row.route for row in result.rows):
        for policy in POLICIES:
            part = result.part(route=route, policy=policy)
            factors = {(row.moment, row.quantity): told_factor(row.factor) for row in part.rows}
            fails = sum(row.route == route and row.policy == policy for row, _ in failed)
            shown = [("1 tap", "what"), ("2 taps", "what"), ("theta 0.8", "what"), ("theta 0.95", "what")]
            cells = [factors[key] for key in shown] + [factors.get(("theta 0.95", "where"), "-")]
            lines.append([route, policy, *cells, str(part.tests), told_p(part.least), str(fails)])
    head = ["route", "policy", "what, 1 tap", "what, 2 taps", "what, theta .8", "what, theta .95", "where, theta .95"]
    return table([*head, "tests", "smallest p times tests", "fail"], lines)


def right_page(result: Calibration, sizes: Sizes, seed: int) -> str:
    """What the page says where everything is right."""
    return (
        f"{sizes.trials} trials per route and policy, seed {seed}. Columns `what` and `where` give the number of wrong "
        f"decisions divided by the number expected from the beliefs, with 95% intervals.\nOf {result.tests} tests, "
        f"{len(result.failed)} fail at level {result.level:g} (Holm); the smallest p-value times their number is "
        f"{told_p(result.least)}.\n\n{right_table(result)}"
    )


def planted_page(rates: Sequence[Rate], seed: int) -> str:
    """What the page says of planted errors."""
    lines = [
        [
            one.name,
            str(one.trials),
            str(one.repetitions),
            share_interval(one.found, one.repetitions),
            *(f"{one.kinds[kind] / one.repetitions:.2f}" for kind in KINDS),
        ]
        for one in rates
    ]
    head = ["error", "trials", "repetitions", "found", *(f"by {kind}" for kind in KINDS)]
    return (
        f"Passive and active together; level {LEVEL:g} holds for all tests of a repetition together; seed {seed}; "
        f"Wilson intervals.\n\n{table(head, lines)}"
    )


def tasks_of(truth: HistogramModel, errors: Sequence[Planted], sizes: Sizes, seed: int) -> list[Any]:
    """All repetitions, a task for each error and size."""
    return [
        partial(rate, truth, error, trials, repetitions if error.name == "none" else sizes.planted, seed)
        for error in errors
        for trials, repetitions in zip(sizes.repeated, sizes.right, strict=True)
    ]


def study_right(truth: HistogramModel, sizes: Sizes, seed: int, document: Path | None) -> None:
    """All routes where everything is right."""
    tasks = [partial(calibrate, truth, {route: sizes.trials}, seed=seed) for route in ROUTES]
    parts = list(until_interrupted("Everything right", tasks))
    if not parts:
        return
    result = Calibration(tuple(row for part in parts for row in part.rows), LEVEL)
    write_json("chain-right", [row._asdict() | {"factor": row.factor._asdict()} for row in result.rows])
    text = right_page(result, sizes, seed)
    print(text)
    if document is not None and len(parts) == len(tasks):
        write_block(document, "calibration-right", text)


def study_planted(truth: HistogramModel, sizes: Sizes, seed: int, document: Path | None) -> None:
    """Rates at which errors are found, and the figure."""
    errors = planted_errors(truth)
    tasks = tasks_of(truth, errors, sizes, seed)
    rates = list(until_interrupted("Planted errors", tasks))
    if not rates:
        return
    write_json("chain-planted", [one._asdict() for one in rates])
    text = planted_page(rates, seed)
    print(text)
    if document is None or len(rates) < len(tasks):
        return
    write_block(document, "calibration-planted", text)


def study_figure(truth: HistogramModel, sizes: Sizes, seed: int, document: Path | None) -> None:
    """The figure of the page: no error, the border, the power, and the peak that costs most."""
    none, border, power, *peaks = planted_errors(truth)
    shown = (none, border, power, peaks[-1])
    tasks = [partial(panel, error, truth, sizes.trials, seed) for error in shown]
    panels = list(until_interrupted("Figure", tasks))
    if document is not None and len(panels) == len(shown):
        publish(calibration_figure(panels, Checkpoints().names), document, "calibration-of-beliefs")


STUDIES = {"right": study_right, "planted": study_planted, "figure": study_figure}


def main() -> None:
    """Runs the studies as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=STUDIES, help="run one part only")
    parser.add_argument("--trials", type=int, default=Sizes().trials, help="trials per engine and policy")
    parser.add_argument(
        "--repetitions", type=int, default=Sizes().planted, help="repetitions per planted error and size"
    )
    parser.add_argument(
        "--false-alarms", type=int, nargs=3, default=Sizes().right, help="repetitions without an error, for each size"
    )
    parser.add_argument("--seed", type=int, default=1)
    options = parsed(parser, "calibration-right", "calibration-planted")
    sizes = Sizes(options.trials, planted=options.repetitions, right=tuple(options.false_alarms))
    truth = right_model(options.seed)
    for name, study in STUDIES.items():
        if options.only in (None, name):
            study(truth, sizes, options.seed, options.document)


if __name__ == "__main__":
    main()
