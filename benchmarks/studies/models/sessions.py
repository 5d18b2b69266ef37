"""Gain of models with a gain and offset shared by all taps of an episode over the same models without.

Simulated data sets have eight sessions: four for training, two for fitting the exponent of the likelihood, two for
testing. Both models of a pair get the same sequences of taps of one class and session, with the paper's exponent 1/J
and with an exponent fitted for each model.

`--document docs/explanation/model-studies.md` updates its tables and figure; with
`--from runs/studies/sessions.json` from earlier measurements.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import RigSettings, preset
from solidtouch.inference.filter import log_fold
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.model import TapModel
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.measurement.shared_gain import session_spread
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import mean_interval, parsed, publish, table, write_block
from benchmarks.studies.models.figures import Gain, session_figure
from benchmarks.study import thinned, until_interrupted, write_json

TRAIN, HELD_OUT, TEST = slice(0, 4), slice(4, 6), slice(6, 8)
"""Sessions of a data set."""
CONTACTS = (1, 5, 20)
EXPONENTS = np.geomspace(1e-4, 1, 65)
CALIBRATION_BINS = 10
POWERS = ("power J", "fitted power")
SCORES = {
    "log_score_joint": "log score, class (nats)",
    "accuracy_joint": "accuracy, class",
    "accuracy_what": "accuracy, object",
    "calibration_what": "calibration error, object",
}


class Pair(NamedTuple):
    """Two models to compare and the size of the data that they meet.

    Attributes:
        plain: Name of the model without states.
        name: Name of the same in states.
        step: Every how manyth sample of a tap is kept.
        positions: Where classes that are kept, in the middle of the range; 0 for all.
        data_sets: How many there are of each preset.
    """

    plain: str
    name: str
    step: int = 1
    positions: int = 0
    data_sets: int = 12


PAIRS = (Pair("histogram", "session"), Pair("profile", "session:profile", step=2, positions=8, data_sets=8))


class Result(NamedTuple):
    """What one data set said.

    Attributes:
        preset: Of the simulated rig.
        pair: Name of the model in states.
        seed: Of the data set.
        scores: `SCORES` after each of `CONTACTS`, by `"power, model"`.
        exponents: Fitted, by the model's name.
        gain_sd: Of the log gain between training sessions, as fitted.
    """

    preset: str
    pair: str
    seed: int
    scores: dict[str, dict[str, list[float]]]
    exponents: dict[str, float]
    gain_sd: float


def data_set(rig: RigSettings, pair: Pair, seed: int) -> tuple[list[TapSet], ClassGrid]:
    """Eight sessions of the taps that a pair meets, and their classes."""
    sessions = [thinned(simulate_session(rig, seed, session), pair.step) for session in range(TEST.stop)]
    grid = sessions[0].grid()
    if pair.positions:
        first = (grid.L - pair.positions) // 2
        grid = grid.select(range(first, first + pair.positions), range(grid.M))
        sessions = [taps.select(np.minimum(*taps.indices(grid)) >= 0) for taps in sessions]
    return sessions, grid


def compare(name: str, rig: RigSettings, pair: Pair, seed: int) -> Result:
    """Both models of a pair on one data set."""
    sessions, grid = data_set(rig, pair, seed)
    train, held_out, test = (concatenate(sessions[part]) for part in (TRAIN, HELD_OUT, TEST))
    scores, exponents, gain_sd = {}, {}, 0.0
    for model_name in (pair.plain, pair.name):
        model = fit_model(model_name, train, grid, FitSettings(power="none")).model
        exponents[model_name] = fitted_exponent(model, held_out, CONTACTS[-1])
        taps = model.log_likelihood(test.taps)
        played = [sequences(model, test, taps, n) for n in CONTACTS]
        for power, exponent in zip(POWERS, (1 / test.preprocessing.samples, exponents[model_name]), strict=True):
            each = [score(exponent * sums + model.log_prior, where, what, grid.M) for sums, where, what in played]
            scores[f"{power}, {model_name}"] = {key: [one[key] for one in each] for key in SCORES}
        gain_sd = session_spread(train, grid, model.edges).gain_sd
    return Result(name, pair.name, seed, scores, exponents, gain_sd)


def fitted_exponent(model: TapModel, taps: TapSet, n: int) -> float:
    """The exponent of `EXPONENTS` with the highest mean log belief in the true class after `n` taps of a session."""
    sums, where, what = sequences(model, taps, model.log_likelihood(taps.taps), n)
    M = model.grid.M
    scores = [log_belief(exponent * sums + model.log_prior, M)[_each(where, what)].mean() for exponent in EXPONENTS]
    return float(EXPONENTS[int(np.argmax(scores))])


def sequences(
    model: TapModel, taps: TapSet, log_likelihood: NDArray[np.float64], n: int
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """Sums of the log-likelihoods of `n` taps of one class and session, shape (Q, L, S M), and their class.

    No tap is in two sequences; those of one are of all over their class, and taps that are left over are not used.
    """
    where, what = taps.indices(model.grid)
    key = np.stack([taps.session, where, what])
    order = np.lexsort(key)
    _, first, count = np.unique(key[::-1, order], axis=1, return_index=True, return_counts=True)
    members = []
    for begin, size in zip(first, count, strict=True):
        whole = size // n
        members += list(order[begin : begin + whole * n].reshape(n, whole).T)
    members = np.array(members)
    return log_likelihood[members].sum(axis=1), where[members[:, 0]], what[members[:, 0]]


def log_belief(log_joint: NDArray[np.float64], M: int) -> NDArray[np.float64]:
    """Normalised log beliefs (Q, L, M) from log joint probabilities of where and hypothesis (Q, L, S M)."""
    folded = log_fold(log_joint, M)
    return folded - np.logaddexp.reduce(folded, axis=(1, 2))[:, None, None]


def score(log_joint: NDArray[np.float64], where: NDArray[np.intp], what: NDArray[np.intp], M: int) -> dict[str, float]:
    """`SCORES` of sequences."""
    log_joint = log_belief(log_joint, M)
    what_belief = np.exp(log_joint).sum(axis=1)
    top, right = what_belief.max(axis=1), what_belief.argmax(axis=1) == what
    values = (
        log_joint[_each(where, what)].mean(),
        (log_joint.reshape(len(where), -1).argmax(axis=1) == where * M + what).mean(),
        right.mean(),
        calibration_error(top, right),
    )
    return {key: float(value) for key, value in zip(SCORES, values, strict=True)}


def calibration_error(belief: NDArray[np.float64], right: NDArray[np.bool_]) -> float:
    """Mean distance of belief and fraction right over bins of about equally many sequences by belief."""
    parts = np.array_split(np.argsort(belief, kind="stable"), CALIBRATION_BINS)
    return float(sum(abs((right[part] - belief[part]).sum()) for part in parts) / len(belief))


def _each(where: NDArray[np.intp], what: NDArray[np.intp]) -> tuple[NDArray[np.intp], ...]:
    return np.arange(len(where)), where, what


def gains(results: Sequence[Result], score: str, power: str, plain: str) -> NDArray[np.float64]:
    """A score of the model in states less that of the plain one, shape (data sets, contacts)."""
    pairs = [(one.scores[f"{power}, {one.pair}"][score], one.scores[f"{power}, {plain}"][score]) for one in results]
    return np.array([np.subtract(*pair) for pair in pairs])


def gain_table(results: Sequence[Result], pair: Pair) -> str:
    """Differences over data sets, a line for each kind of data, power and number of taps."""
    lines = []
    for name in dict.fromkeys(one.preset for one in results):
        own = [one for one in results if one.preset == name]
        for power in POWERS:
            found = {score: gains(own, score, power, pair.plain) for score in SCORES}
            for i, n in enumerate(CONTACTS):
                log_score = found["log_score_joint"][:, i]
                better = f"{(log_score > 0).sum()} of {len(log_score)}"
                cells = [mean_interval(found[score][:, i], 3) for score in SCORES]
                lines.append([name, power, str(n), *cells, better])
    return table(["data", "power", "taps", *SCORES.values(), "better log score in"], lines)


def level_table(results: Sequence[Result], pair: Pair) -> str:
    """Mean scores of both models after the most taps."""
    lines = []
    for name in dict.fromkeys(one.preset for one in results):
        own = [one for one in results if one.preset == name]
        for power in POWERS:
            for model in (pair.plain, pair.name):
                scores = [np.mean([one.scores[f"{power}, {model}"][score][-1] for one in own]) for score in SCORES]
                exponent = np.median([one.exponents[model] for one in own])
                shown = f"{exponent:.2g}" if power == POWERS[1] else "1/J"
                lines.append([name, power, model, shown, *(f"{value:.3f}" for value in scores)])
    return table(["data", "power", "model", "median exponent", *SCORES.values()], lines)


def texts(results: Sequence[Result]) -> str:
    """Both tables of every pair."""
    parts = []
    for pair in PAIRS:
        own = [one for one in results if one.pair == pair.name]
        if own:
            count = len({one.seed for one in own})
            head = f"`{pair.name}` minus `{pair.plain}`, mean with a 95% t-interval over {count} data sets each:"
            parts += [head, gain_table(own, pair)]
            parts += [f"Both models after {CONTACTS[-1]} taps, means over data sets:", level_table(own, pair)]
    return "\n\n".join(parts)


def panels(results: Sequence[Result]) -> list[Gain]:
    """What the figure shows."""
    found = []
    for pair in PAIRS:
        for name in dict.fromkeys(one.preset for one in results):
            own = [one for one in results if one.pair == pair.name and one.preset == name]
            if own:
                values = {power: gains(own, "log_score_joint", power, pair.plain) for power in POWERS}
                title = f"{name}: {pair.name} less {pair.plain}"
                found.append(Gain(title, np.array(CONTACTS), values))
    return found


def page(results: Sequence[Result], seed: int) -> str:
    """What the page says of the results."""
    return (
        f"Data sets have seed {seed}; of their sessions 4 are for training, 2 for fitting the exponent and 2 for "
        "testing. `session` uses all 16 x 5 classes and 50 samples per tap; `session:profile`, which is slower, the 8 "
        f"middle positions and every second sample.\n\n{texts(results)}"
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, help="data sets per preset and pair")
    parser.add_argument("--presets", nargs="*", default=["paper", "nodrift"])
    parser.add_argument("--pairs", nargs="*", default=[pair.name for pair in PAIRS])
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--from", dest="measured", type=Path, help="rewrite tables and figure from these measurements")
    options = parsed(parser, "sessions")
    tasks: list[Callable[[], Result]] = [
        partial(compare, name, preset(name), pair, data_set_seed(options.seed, i))
        for pair in PAIRS
        if pair.name in options.pairs
        for i in range(options.data_sets or pair.data_sets)
        for name in options.presets
    ]
    if options.measured:
        results = [Result(**one) for one in json.loads(options.measured.read_text("utf-8"))]
    else:
        results = list(until_interrupted("Sessions", tasks))
    if not results:
        return
    write_json("sessions", [one._asdict() for one in results])
    text = page(results, options.seed)
    print(text)
    if options.document is not None and len(results) == len(tasks):
        figure = session_figure(panels(results), "gain in log score, class (nats)")
        publish(figure, options.document, "sessions")
        write_block(options.document, "sessions", text)


if __name__ == "__main__":
    main()
