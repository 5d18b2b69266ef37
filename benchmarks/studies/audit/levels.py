"""Level and power of the tests of dependence within classes.

Level: taps drawn from a fitted histogram model, preset `model`, the only data whose samples are independent given the
class. Power: taps of the simulated rig at the centre of each class and without nuisances, one of which is then turned
up.

`--document docs/explanation/audit-studies.md` updates both tables of that page.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest
from solidtouch.analysis.audit.dependence.taxels import TESTS, taxel_dependence
from solidtouch.analysis.audit.dependence.times import time_dependence
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import RigSettings, Rod, preset
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.taps import TapSet
from solidtouch.models.threads import one_blas_thread

from benchmarks.page import block_of, check_block, mean_interval, publish, share_interval, table, write_block
from benchmarks.studies.audit.figures import PowerCurve, power_figure
from benchmarks.study import thinned, until_interrupted, write_json

ALPHA = 0.05
PERMUTATIONS = 199
SAMPLES = (1, 3, 5)
STEP = 5
"""Of a simulated tap every so manieth sample counts, 10 of 50."""
RODS = (Rod("6 mm rod", 6.0), Rod("10 mm rod", 10.0))
_RIG = {"rods": RODS, "start_mm": 5.0, "end_mm": 11.0}
KNOBS = {
    "common_noise_counts": (0.25, 0.5, 1.0, 2.0),
    "taxel_noise_counts": (0.25, 0.5, 1.0, 2.0),
    "tap_depth_log_sd": (0.0025, 0.005, 0.01, 0.02, 0.05),
    "position_spread_mm": (0.05, 0.1, 0.25, 0.5, 1.0),
}
"""What is turned, and the values; all else is preset `ideal` at spread 0."""
NOTHING = "none"
_LEVELS = (*TESTS, "lag 1", "any lag")
EFFECTS = ("rank correlation", "distance correlation", "information (nats)", "autocorrelation, lag 1")
"""Effect sizes of the first four of them."""
_FIRST_RATE = 3 + len(TESTS) + 3
"""Column of the table of power in which rates begin."""


class Outcome(NamedTuple):
    """What the tests said of one data set.

    Attributes:
        pairs: Share of pairs of taxels with p at most `ALPHA`, of each test in `TESTS`; NaN without pairs.
        found: Whether each of `TESTS` and the time tests of lag 1 and of any lag rejected, NaN where not tested.
        mapped: Whether the false discovery map of each of `TESTS` has a pair.
        effect: Mean absolute effect of each of `TESTS` less that of permuted taps, autocorrelation of lag 1, effective
            share of the samples of a tap, and of all its values.
    """

    pairs: list[float]
    found: list[float]
    mapped: list[float]
    effect: list[float]


def outcome(taps: TapSet, permutations: int, seed: int) -> Outcome:
    """The tests on one data set of one session."""
    where, what = taps.indices(taps.grid())
    kept = (where >= 0) & (what >= 0)
    values, stratum = taps.taps[kept], (where * (what.max() + 1) + what)[kept]
    across = taxel_dependence(values, stratum, permutations=permutations, alpha=ALPHA, seed=seed)
    along = time_dependence(values, stratum, permutations=permutations, alpha=ALPHA, seed=seed)
    p = across["p"].values
    tested = np.isfinite(p).sum(axis=(1, 2))
    low = (p <= ALPHA).sum(axis=(1, 2))
    family = [*across["family_p"].values, *along["p"].values]
    J = values.shape[1]
    rho = along["autocorrelation"].values[1] if J > 1 else np.nan
    return Outcome(
        [float(a / b) if b else np.nan for a, b in zip(low, tested, strict=True)],
        [float(one <= ALPHA) if np.isfinite(one) else np.nan for one in family],
        [float(one) for one in across["rejected"].values.any(axis=(1, 2))],
        [float(one) for one in (across["mean_absolute"] - across["mean_absolute_null"]).values]
        + [float(rho), float(along["effective_samples"]) / J, float(along["effective_values"] / along["values"])],
    )


def model_taps(model: HistogramModel, J: int, taps_per_class: int, seed: int) -> TapSet:
    """Taps that fulfil what naive Bayes assumes."""
    return draw_taps(model.grid, model.probabilities, model.edges, Preprocessing(J), taps_per_class, seed)


def fitted_model() -> HistogramModel:
    """Histograms of two rods at six positions of the paper's rig."""
    taps = simulate_session(replace(preset("paper"), **_RIG), seed=1, session=0)
    return fit(taps, taps.grid())


def rig_with(knob: str, value: float) -> RigSettings:
    """A rig without nuisances and positions, but for one, and without the high-pass, which remembers other classes."""
    still: dict[str, Any] = {**_RIG, "position_spread_mm": 0.0, "highpass_hz": 0.0}
    return replace(preset("ideal"), **(still if knob == NOTHING else {**still, knob: value}))


def rig_taps(rig: RigSettings, seed: int) -> TapSet:
    """Thinned taps of a session."""
    return thinned(simulate_session(rig, seed, 0), STEP)


def level_of(model: HistogramModel, J: int, seed: int) -> Outcome:
    """One repetition."""
    return outcome(model_taps(model, J, 20, seed), PERMUTATIONS, seed)


def power_at(knob: str, value: float, seed: int) -> Outcome:
    """One repetition."""
    return outcome(rig_taps(rig_with(knob, value), seed), PERMUTATIONS, seed)


def column(outcomes: Sequence[Outcome], name: str, index: int) -> NDArray[np.float64]:
    """One number of every data set, those left out that have none."""
    values = np.array([getattr(one, name)[index] for one in outcomes], dtype=np.float64)
    return values[np.isfinite(values)]


def level_page(found: dict[int, list[Outcome]]) -> str:
    """Rates of rejection where nothing is to be found."""
    lines, inside, cells = [], 0, 0
    counted = [
        (J, name, column(outcomes, "found", t)) for J, outcomes in found.items() for t, name in enumerate(_LEVELS)
    ]
    counted = [one for one in counted if len(one[2])]
    for J, name, hits in counted:
        interval = binomtest(int(hits.sum()), len(hits)).proportion_ci(1 - ALPHA / len(counted), method="exact")
        inside, cells = inside + (interval.low <= ALPHA <= interval.high), cells + 1
        pairs, mapped = "-", "-"
        if name in TESTS:
            pairs = mean_interval(column(found[J], "pairs", TESTS.index(name)), 3)
            mapped = share_interval(int(column(found[J], "mapped", TESTS.index(name)).sum()), len(hits))
        lines.append([str(J), name, str(len(hits)), share_interval(int(hits.sum()), len(hits)), pairs, mapped])
    head = ["J", "test", "data sets", "rejects", "share of pairs with p at most .05", "a pair in the map"]
    return (
        "Two objects at six positions, 20 taps each, 12 taxels, drawn from histograms of the paper's rig; "
        f"{PERMUTATIONS} permutations, level {ALPHA}. Intervals are 95% Wilson intervals, or t-intervals of the mean "
        f"over data sets. Exact intervals with simultaneous 95% coverage contain {ALPHA} in {inside} of {cells} "
        f"rows.\n\n{table(head, lines)}"
    )


def power_page(found: dict[tuple[str, float], list[Outcome]]) -> str:
    """Rates of rejection and effects by what was turned, and how far."""
    lines = []
    for (knob, value), outcomes in found.items():
        rates = [column(outcomes, "found", t) for t in range(len(_LEVELS))]
        effects = [column(outcomes, "effect", e) for e in range(len(TESTS) + 3)]
        lines.append(
            [knob, "-" if knob == NOTHING else f"{value:g}", str(len(outcomes))]
            + [f"{effect.mean():.3f}" if len(effect) else "-" for effect in effects]
            + [f"{rate.mean():.2f}" if len(rate) else "-" for rate in rates]
        )
    head = ["knob", "value", "data sets"]
    head += ["rank effect", "distance effect", "table effect (nats)", "lag 1", "effective samples", "effective values"]
    head += [f"{name} rejects" for name in _LEVELS]
    return (
        f"Two objects at six positions, 20 taps each at the centre of their class, {50 // STEP} samples and 12 taxels "
        f"of preset `ideal` without its high-pass filter, which carries over from the previous class; {PERMUTATIONS} "
        f"permutations, level {ALPHA}. Effects are mean absolute values over pairs minus those of permuted taps; "
        f"effective numbers are fractions of all samples or values of a tap.\n\n{table(head, lines)}"
    )


class Point(NamedTuple):
    """Mean effect and number of rejections of one test where one knob is turned to one value."""

    effect: float
    hits: int
    data_sets: int


def points_of(found: dict[tuple[str, float], list[Outcome]]) -> list[tuple[str, list[Point]]]:
    """The knob of every value and a point for each of the tests in `EFFECTS`."""
    return [
        (
            knob,
            [
                Point(column(outcomes, "effect", i).mean(), int(hits.sum()), len(hits))
                for i in range(len(EFFECTS))
                for hits in [column(outcomes, "found", i)]
            ],
        )
        for (knob, _), outcomes in found.items()
    ]


def points_in(document: Path) -> list[tuple[str, list[Point]]]:
    """The same from the table of a page, where effects are rounded."""
    points = []
    for line in block_of(document, "audit-power").splitlines():
        cells = [cell.strip() for cell in line.strip("|").replace("−", "-").split("|")]
        if len(cells) > _FIRST_RATE and cells[0] in (*KNOBS, NOTHING):
            numbers = [float(cell) if cell != "-" else np.nan for cell in cells[2:]]
            n, effects, rates = int(numbers[0]), numbers[1:], numbers[_FIRST_RATE - 2 :]
            points.append((cells[0], [Point(effects[i], round(rates[i] * n), n) for i in range(len(EFFECTS))]))
    return points


def power_panels(points: list[tuple[str, list[Point]]]) -> dict[str, list[PowerCurve]]:
    """What the figure shows: the curves of three tests across taxels and of lag 1, with the point of no knob."""
    panels = {}
    for index, name in enumerate(EFFECTS):
        panels[name] = []
        for knob in KNOBS:
            own = [tests[index] for turned, tests in points if turned in (knob, NOTHING)]
            ends = [binomtest(point.hits, point.data_sets).proportion_ci(method="wilson") for point in own]
            effect, rate = (np.array(one) for one in zip(*((p.effect, p.hits / p.data_sets) for p in own), strict=True))
            low, high = (np.array([getattr(end, side) for end in ends]) for side in ("low", "high"))
            panels[name].append(PowerCurve(knob, effect, rate, low, high))
    return panels


def main() -> None:
    """Runs the studies as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--repetitions",
        type=int,
        help="data sets per point of the power study, default 20; the level study uses 20 times as many",
    )
    parser.add_argument("--quick", action="store_true", help="use 4 data sets instead of 20")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--document", type=Path, help="page to update")
    parser.add_argument("--redraw", action="store_true", help="only draw the figure of the page from its table")
    options = parser.parse_args()
    if options.redraw and options.document is not None:
        publish(power_figure(power_panels(points_in(options.document)), ALPHA), options.document, "audit-power")
        return
    repetitions = options.repetitions or (4 if options.quick else 20)
    check_block(options.document, "audit-levels", "audit-power")
    with one_blas_thread():
        model = fitted_model()
        levels = {}
        for J in SAMPLES:
            tasks = [partial(level_of, model, J, data_set_seed(options.seed, i)) for i in range(20 * repetitions)]
            levels[J] = list(until_interrupted(f"level, {J} samples", tasks))
        points = [(NOTHING, 0.0), *((knob, value) for knob, values in KNOBS.items() for value in values)]
        power = {}
        for knob, value in points:
            tasks = [partial(power_at, knob, value, data_set_seed(options.seed, i)) for i in range(repetitions)]
            power[knob, value] = list(until_interrupted(f"{knob} {value:g}", tasks))
    levels = {J: outcomes for J, outcomes in levels.items() if outcomes}
    power = {point: outcomes for point, outcomes in power.items() if outcomes}
    raw = {"levels": [[J, outcomes] for J, outcomes in levels.items()]}
    write_json("audit-levels", raw | {"power": [[*point, outcomes] for point, outcomes in power.items()]})
    pages = {"audit-levels": level_page(levels) if levels else "", "audit-power": power_page(power) if power else ""}
    print("\n\n".join(pages.values()))
    complete = sum(map(len, levels.values())) == 20 * repetitions * len(SAMPLES)
    if options.document is not None and complete and sum(map(len, power.values())) == repetitions * len(points):
        for name, text in pages.items():
            write_block(options.document, name, text)
        publish(power_figure(power_panels(points_of(power)), ALPHA), options.document, "audit-power")


if __name__ == "__main__":
    main()
