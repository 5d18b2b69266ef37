"""Gain of tuning in a new session, and the speed of learning online.

Simulated data sets of the paper's size. Three sessions of each are training data; fixation point and threshold are
chosen by leaving each session out in turn, or from the halves of the first session alone. A fourth session gives the
cost of an episode with these choices, with the default pair, and with the pair that is best in that session, which no
method could know. On the same session learners find both from the costs of single episodes.

`--document docs/how-to/tuning.md` updates the tables and figures of that page.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.tuning.online import ONLINE_THRESHOLDS
from solidtouch.analysis.tuning.run import Price, Tuning, tune_parts
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.moves.control import default_fixation
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.tuning.held_out import held_out, with_repeats
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import mean_interval, parsed, publish, table, write_block
from benchmarks.studies.strategies.figures import regret_figure, tuning_figure
from benchmarks.studies.strategies.learning_regret import regrets
from benchmarks.study import until_interrupted, write_json

BLOCKS = ("tuning-choice", "tuning-learning")
PRESETS = ("paper", "nodrift", "broken")
TRAINING = 3
DEFAULT_THETA = 0.95
COST = 50.0
WAYS = ("default", "one session", "three sessions", "best there")
SHOWN = (100, 300, 1000)
"""Episodes after which regret stands in the table."""


class Found(NamedTuple):
    """One data set.

    Attributes:
        pairs: Fixation point and threshold by way.
        outcome: Cost, error and taps in the fourth session by way.
        predicted: Cost predicted from the three sessions.
        regret: Of each learner after every episode.
        kept: What the pair that it recommends costs beyond the best one.
        tuning: What the three sessions gave.
    """

    pairs: Mapping[str, tuple[int, float]]
    outcome: Mapping[str, tuple[float, float, float]]
    predicted: float
    regret: Mapping[str, NDArray[np.float64]]
    kept: Mapping[str, float]
    tuning: Tuning


def data_set(name: str, seed: int, trials: int, episodes: int) -> Found:
    """Everything on one data set."""
    settings = preset(name)
    sessions = [simulate_session(settings, seed, s) for s in range(TRAINING + 1)]
    grid, train, test = sessions[0].grid(), concatenate(sessions[:TRAINING]), sessions[TRAINING]
    price = Price(COST)

    def tuned(taps: TapSet) -> Tuning:
        parts = with_repeats(held_out(taps, grid, fit), taps, fit)
        return tune_parts(parts, Setting(), price, trials=trials, seed=seed)

    one, three = tuned(sessions[0]), tuned(train)
    model = fit(train, grid)
    whole = tap_table(model, model.usable(test))
    plan = plan_trials(whole.pool, 4 * trials, seed)
    theta = np.union1d(three.threshold.theta, [DEFAULT_THETA])
    outcome = np.empty((grid.L, len(theta), 3))
    for l in range(grid.L):
        aimed = plan._replace(fixation=np.full_like(plan.fixation, l))
        played = run_trials(whole, aimed, theta, play=PlaySettings(theta_x=0.0), seed=seed)
        error = grid.what_error(played.what, plan.what[:, np.newaxis]).mean(axis=0)
        outcome[l] = np.stack([COST * error + played.taps.mean(axis=0), error, played.taps.mean(axis=0)], axis=-1)
    l, h = np.unravel_index(outcome[..., 0].argmin(), outcome.shape[:2])
    pairs = {
        "default": (default_fixation(grid.L), DEFAULT_THETA),
        "one session": (one.fixation.chosen, one.setting.play.threshold),
        "three sessions": (three.fixation.chosen, three.setting.play.threshold),
        "best there": (int(l), float(theta[h])),
    }
    at = {way: outcome[l, np.argmin(np.abs(theta - value))] for way, (l, value) in pairs.items()}
    lost, _ = regrets(
        whole, grid, range(grid.L), ONLINE_THRESHOLDS, COST, episodes=episodes, trials=4 * trials, seed=seed
    )
    return Found(
        pairs,
        {way: (float(row[0]), float(row[1]), float(row[2])) for way, row in at.items()},
        float(three.threshold.cost.mean[three.chosen]),
        {method: one.regret for method, one in lost.items()},
        {method: one.kept for method, one in lost.items()},
        three,
    )


def choice_table(results: Mapping[str, Sequence[Found]]) -> str:
    """What an episode costs in the fourth session, by the way in which the pair was chosen."""
    lines = []
    for name, sets in results.items():
        default = np.array([found.outcome["default"][0] for found in sets])
        for way in WAYS:
            at = np.array([found.outcome[way] for found in sets])
            pairs = [found.pairs[way] for found in sets]
            places = np.bincount([l for l, _ in pairs])
            told = ", ".join(f"{l}: {count}" for l, count in enumerate(places) if count)
            middle = np.median([theta for _, theta in pairs])
            saved = "-" if way == "default" else mean_interval(default - at[:, 0], 1)
            values = mean_interval(at[:, 0], 1), saved, mean_interval(at[:, 1], 3), mean_interval(at[:, 2], 1)
            lines.append([name, way, *values, told, f"{middle:.4g}"])
    head = ["preset", "pair by", "cost (taps)", "saving over default", "object error (mm)", "taps"]
    return table([*head, "fixation class: data sets", "median threshold"], lines)


def prediction_table(results: Mapping[str, Sequence[Found]]) -> str:
    """Cost predicted from three sessions, and cost in the fourth."""
    lines = []
    for name, sets in results.items():
        got = np.array([found.outcome["three sessions"][0] for found in sets])
        said = np.array([found.predicted for found in sets])
        lines.append([name, mean_interval(said, 1), mean_interval(got, 1), mean_interval(got - said, 1)])
    return table(["preset", "cost predicted", "cost in a new session", "difference"], lines)


def learning_table(results: Mapping[str, Sequence[Found]], episodes: int) -> str:
    """Regret of the learners in taps per episode, and of the pairs that they end with."""
    shown = [n for n in SHOWN if n <= episodes]
    lines = []
    for name, sets in results.items():
        for method in sets[0].regret:
            curve = np.array([found.regret[method] for found in sets])
            kept = [found.kept[method] for found in sets]
            each = (mean_interval(curve[:, n - 1] / n, 1) for n in shown)
            lines.append([name, method, *each, mean_interval(kept, 1)])
    return table(["preset", "learner", *(f"after {n}" for n in shown), "excess of the recommended pair"], lines)


def texts(results: Mapping[str, Sequence[Found]], seed: int, trials: int, episodes: int) -> dict[str, str]:
    """What stands in the page, by block."""
    n = max(map(len, results.values()))
    choice = (
        f"{n} data sets of each preset, seed {seed}; {trials} trials in each part of the training taps and "
        f"{4 * trials} in the new session; an error of 1 mm is worth {COST:g} taps. Intervals are 95% t-intervals of "
        f"the mean over data sets.\n\n{choice_table(results)}\n\n{prediction_table(results)}"
    )
    learning = (
        f"Regret per episode in taps over the first episodes, {n} data sets of each preset, {episodes} episodes, "
        f"{len(ONLINE_THRESHOLDS)} thresholds at each of 16 fixation points. The last column is the expected cost of "
        f"the recommended pair minus that of the best one.\n\n{learning_table(results, episodes)}"
    )
    return dict(zip(BLOCKS, (choice, learning), strict=True))


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=20, help="data sets per preset")
    parser.add_argument("--presets", nargs="*", choices=PRESETS, default=list(PRESETS))
    parser.add_argument("--trials", type=int, default=1000, help="trials per part of the training taps")
    parser.add_argument("--episodes", type=int, default=1000, help="episodes per learner")
    parser.add_argument("--seed", type=int, default=500)
    options = parsed(parser, *BLOCKS)
    seeds = [data_set_seed(options.seed, d) for d in range(options.data_sets)]
    tasks: list[Callable[[], tuple[str, Found]]] = [
        partial(_named, name, seed, options.trials, options.episodes) for seed in seeds for name in options.presets
    ]
    results: dict[str, list[Found]] = {}
    for name, found in until_interrupted("Tuning", tasks):
        results.setdefault(name, []).append(found)
    if not results:
        return
    write_json("tuning", [_plain(name, found) for name, sets in results.items() for found in sets])
    written = texts(results, options.seed, options.trials, options.episodes)
    whole = sum(map(len, results.values())) == len(tasks)
    for name, text in written.items():
        print(text, end="\n\n")
        if options.document is not None and whole:
            write_block(options.document, name, text)
    if options.document is not None and whole:
        publish(tuning_figure(results[options.presets[0]][0].tuning), options.document, "tuning")
        regret = {
            preset: {name: np.array([found.regret[name] for found in sets]) for name in sets[0].regret}
            for preset, sets in results.items()
        }
        publish(regret_figure(regret), options.document, "tuning-regret")


def _named(name: str, seed: int, trials: int, episodes: int) -> tuple[str, Found]:
    return name, data_set(name, seed, trials, episodes)


def _plain(name: str, found: Found) -> dict[str, Any]:
    regret = {method: values[:: max(1, len(values) // 50)].tolist() for method, values in found.regret.items()}
    rest = {"pairs": found.pairs, "outcome": found.outcome, "predicted": found.predicted, "kept": found.kept}
    return {"preset": name, **rest, "regret": regret}


if __name__ == "__main__":
    main()
