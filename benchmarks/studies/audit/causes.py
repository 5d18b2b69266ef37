"""Whether an audit names the planted cause first, names none where none is planted, and recommends no needless remedy.

- Knobs: the simulated rig without nuisances, all taps of a class at one position, and one knob turned up: the audit
  should name that knob first.
- No cause: taps drawn from fitted histograms, for which independence holds. Counts how often a cause is named and how
  often the test of sessions rejects at .05.
- No remedy: recommendations of complete audits of such taps and of preset `ideal`.

`--document docs/explanation/audit-studies.md` updates the tables of that page.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from solidtouch.analysis.audit.leakage.run import leakage
from solidtouch.analysis.audit.remedies import make_remedies, no_change
from solidtouch.analysis.audit.remedy_scores import measure
from solidtouch.analysis.audit.variance.causes import SEQUENCE, split_variance
from solidtouch.analysis.audit.variance.split import session_p
from solidtouch.analysis.audit.verdict import calibration, first_cause, recommended
from solidtouch.analysis.experiment.parts import AuditParts, audit_parts
from solidtouch.analysis.stats.evidence import evidence
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import RigSettings, preset
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.measurement.model import TapModel
from solidtouch.models.seeds import Purpose, data_set_seed, derived_seed
from solidtouch.models.setting_file import Setting
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.study import until_interrupted, write_json

SESSIONS = 3
CLEAN = replace(preset("ideal"), position_spread_mm=0.0)
"""Nothing but white noise of 1.7 counts; all taps of a class at its centre."""
PAPER = preset("paper")
DRIFT = ("session_gain_log_sd", "session_taxel_gain_log_sd", "mounting_x_mm", "mounting_y_mm")
SAMPLES = (1, 3, 5)
LEVEL = 0.05
TRAINING_TAPS = 400
"""Of each class in the training file of drawn taps, so that the fitted tables are nearly the true ones."""


class Knob(NamedTuple):
    """A knob turned to one value."""

    name: str
    cause: str
    value: str
    rig: RigSettings


def knobs() -> list[Knob]:
    """All knobs, each at three values."""
    found = []
    for name, field, cause, values in (
        ("noise common to taxels (counts)", "common_noise_counts", "common", (1.0, 2.0, 4.0)),
        ("autocorrelated noise of each taxel (counts)", "taxel_noise_counts", "noise", (1.0, 2.0, 4.0)),
        ("spread of tap depth (relative)", "tap_depth_log_sd", "gain", (0.05, 0.1, 0.2)),
        ("position spread (mm)", "position_spread_mm", "place", (0.25, 0.5, 1.0)),
    ):
        found += [Knob(name, cause, f"{value:g}", replace(CLEAN, **{field: value})) for value in values]
    for scale in (0.25, 0.5, 1.0, 2.0):
        rig = replace(CLEAN, **{field: scale * getattr(PAPER, field) for field in DRIFT})
        found.append(Knob("drift between sessions (of preset paper)", "session", f"{scale:g}", rig))
    return found


def named(parts: AuditParts, grid: ClassGrid, seed: int, permutations: int = 199) -> tuple[str | None, float]:
    """The first cause of beliefs that are too sure, and the p-value of the test of sessions."""
    model = fit(parts.train, grid)
    taps = parts.all_taps
    found = evidence(parts.train, taps, grid, model)
    p = session_p(taps, found, permutations, seed)
    leaks = leakage(concatenate([parts.train, *parts.tune]), parts.measure, grid, seed)
    return first_cause(leaks, split_variance(taps, found, seed), p, float("inf"), "overconfident").name, p


def of_sets(sets: Sequence[TapSet]) -> tuple[AuditParts, ClassGrid]:
    """The parts of an audit of these sessions."""
    grid = sets[0].grid()
    return audit_parts(sets, [f"session {number}" for number in range(len(sets))], grid), grid


def turned(knob: Knob, seed: int) -> tuple[Knob, str | None, float]:
    """What is named first on one data set of a knob, and the p-value of the test of sessions."""
    parts, grid = of_sets([simulate_session(knob.rig, seed, session) for session in range(SESSIONS)])
    return knob, *named(parts, grid, seed)


def source(seed: int) -> HistogramModel:
    """Histograms of the simulated rig, from which taps are drawn."""
    taps = simulate_session(PAPER, seed, 0)
    return fit(taps, taps.grid())


def small(model: HistogramModel) -> HistogramModel:
    """The same for every other position of three objects only."""
    where, what = range(4, 12), range(3)
    counts = model.counts[4:12, :3].copy()
    return replace(model, grid=model.grid.select(where, what), counts=counts, left_out=())


def unbroken(model: TapModel, samples: int, seed: int) -> tuple[int, str | None, float]:
    """The same on taps of which independence holds."""
    parts, grid = of_sets([draw_session(model, 20, seed, session, samples) for session in range(SESSIONS)])
    return samples, *named(parts, grid, seed)


def well_alone(name: str, sets: Callable[[], Sequence[TapSet]], power: str, seed: int) -> tuple[str, str, str]:
    """What an audit recommends, and how beliefs are."""
    parts, grid = of_sets(sets())
    remedies, _ = make_remedies(
        no_change(Setting.of(power=power), parts.train, grid), parts.train, parts.tune, SEQUENCE, seed, lambda _: None
    )
    measured = measure(remedies, parts.measure, SEQUENCE, 2000, seed, lambda _: None)
    return name, calibration(measured.judged), recommended(measured) or "nothing"


def drawn_files(model: TapModel, samples: int, seed: int) -> list[TapSet]:
    """A large training file and two smaller ones."""
    return [draw_session(model, TRAINING_TAPS if s == 0 else 40, seed, s, samples) for s in range(SESSIONS)]


def simulated_files(name: str, seed: int) -> list[TapSet]:
    """Sessions of a preset."""
    return [simulate_session(preset(name), seed, session) for session in range(SESSIONS)]


def knob_table(results: Sequence[tuple[Knob, str | None, float]]) -> str:
    """How often the knob was named, a line for each value."""
    lines = []
    for knob in dict.fromkeys((one.name, one.value, one.cause) for one, *_ in results):
        own = [(name, p) for one, name, p in results if (one.name, one.value, one.cause) == knob]
        names = [name for name, _ in own]
        found = f"{sum(p <= LEVEL for _, p in own)} of {len(own)}"
        others = Counter(str(name) for name in names if name != knob[2])
        listed = ", ".join(f"{name} {count}" for name, count in others.most_common()) or "-"
        lines.append([knob[0], knob[1], knob[2], f"{names.count(knob[2])} of {len(names)}", listed, found])
    return table(["disturbance", "value", "cause", "main cause", "others named", "sessions, p <= .05"], lines)


def level_table(results: Sequence[tuple[int, str | None, float]]) -> str:
    """How often something is named or found where nothing is."""
    lines = []
    for samples in dict.fromkeys(one[0] for one in results):
        own = [one for one in results if one[0] == samples]
        causes = sum(one[1] is not None for one in own)
        rejected = sum(one[2] <= LEVEL for one in own)
        lines.append(
            [str(samples), str(len(own)), share_interval(causes, len(own)), share_interval(rejected, len(own))]
        )
    return table(["samples of a tap", "data sets", "any cause named", "sessions, p <= .05"], lines)


def alone_table(results: Sequence[tuple[str, str, str]]) -> str:
    """What was recommended."""
    counted = Counter(results)
    return table(
        ["data", "beliefs", "recommended", "data sets"],
        [[*row, str(count)] for row, count in sorted(counted.items())],
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=10, help="data sets per value of a knob")
    parser.add_argument("--repetitions", type=int, default=200, help="data sets for which independence holds")
    parser.add_argument("--alone", type=int, default=5, help="complete audits of each kind")
    parser.add_argument("--seed", type=int, default=1)
    options = parsed(parser, "knobs", "unbroken", "alone")
    seeds = [data_set_seed(options.seed, d) for d in range(options.data_sets)]
    knob_tasks = [partial(turned, knob, seed) for knob in knobs() for seed in seeds]
    model = source(options.seed)
    few = small(model)
    level_tasks = [
        partial(unbroken, few, samples, derived_seed(options.seed, Purpose.REPEAT, r))
        for samples in SAMPLES
        for r in range(options.repetitions)
    ]
    alone_tasks = [
        task
        for seed in (data_set_seed(options.seed, d) for d in range(options.alone))
        for task in (
            *(
                partial(well_alone, f"model, J=4, power {power}", partial(drawn_files, model, 4, seed), power, seed)
                for power in ("none", "J")
            ),
            partial(well_alone, "ideal, power J", partial(simulated_files, "ideal", seed), "J", seed),
        )
    ]
    turned_knobs = list(until_interrupted("Knobs", knob_tasks))
    nothing = list(until_interrupted("Nothing broken", level_tasks))
    alone = list(until_interrupted("Well alone", alone_tasks))
    texts = {"knobs": knob_table(turned_knobs), "unbroken": level_table(nothing), "alone": alone_table(alone)}
    for text in texts.values():
        print(text, end="\n\n")
    write_json(
        "audit-causes",
        {
            "knobs": [[knob.name, knob.value, knob.cause, name, p] for knob, name, p in turned_knobs],
            "unbroken": nothing,
            "alone": alone,
        },
    )
    whole = (len(turned_knobs), len(nothing), len(alone)) == (len(knob_tasks), len(level_tasks), len(alone_tasks))
    if options.document is not None and whole:
        for name, text in texts.items():
            write_block(options.document, name, text)


if __name__ == "__main__":
    main()
