"""Session states on taps of known truth: log probabilities and beliefs beside those of an observer who knows all.

Levels, noise, and the spread of gains and offsets between sessions are known to the observer, who integrates over the
gain and offset of a new session. The models know training taps alone.

`--document docs/explanation/model-studies.md` updates the table of that page.
"""

import argparse
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from solidtouch.models.measurement.draws import plug_in
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, generator
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

from benchmarks.page import mean_interval, parsed, table, write_block
from benchmarks.studies.models.sessions import log_belief, sequences
from benchmarks.study import until_interrupted, write_json

M, K, REPEATS, TESTED, EPISODE = 4, 2, 10, 20, 5
"""Objects, taxels, taps per object and session, test sessions, and taps of an episode; samples have a noise of 1."""
TRAINED, SAMPLES = (2, 3, 5, 10), (3, 50)
TRUTHS = ((22.0, 0.0, 0.0), (22.0, 0.05, 0.0), (22.0, 0.0, 1.0), (22.0, 0.05, 0.5), (0.0, 0.3, 0.0))
"""Mean level, standard deviation of the log gain (about 0), and of the offset."""
MODELS = ("gaussian", "session:gaussian")
KNOWN = "observer"
_POINTS = np.linspace(-4, 4, 41)  # standard deviations of what the observer integrates over


class Scores(NamedTuple):
    """Means over the test taps and episodes of a data set, in nats.

    Attributes:
        samples: Samples of a tap.
        sessions: Training sessions.
        truth: One of `TRUTHS`.
        tap: Log probability of a tap under its object, by model.
        belief: Log belief in the true object after an episode, by model.
    """

    samples: int
    sessions: int
    truth: tuple[float, float, float]
    tap: dict[str, float]
    belief: dict[str, float]


def draw(
    rng: np.random.Generator, level: NDArray[np.float64], J: int, sessions: int, gain_sd: float, offset_sd: float
) -> TapSet:
    """Taps of new sessions of objects with these levels (M, K)."""
    gain, offset = np.exp(gain_sd * rng.normal(size=sessions)), offset_sd * rng.normal(size=sessions)
    session, _, what = (index.ravel() for index in np.indices((sessions, REPEATS, M)))
    taps = level[what][:, None] + rng.normal(size=(len(what), J, K))
    taps = gain[session, None, None] * taps + offset[session, None, None]
    names = [f"object {m}" for m in range(M)]
    return TapSet.from_arrays(taps, what, names, preprocessing=Preprocessing(samples=J), session=session)


def observed(
    taps: TapSet, level: NDArray[np.float64], gain_sd: float, offset_sd: float, width: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Log probability of the bins of taps under objects in states, shape (N, 1, S M), and the log prior, (1, S M)."""
    axes = [_POINTS if sd else np.zeros(1) for sd in (gain_sd, offset_sd)]
    z = np.array(list(product(*axes)))
    gain, offset = np.exp(gain_sd * z[:, 0]), offset_sd * z[:, 1]
    prior = norm.logpdf(z).sum(axis=1)
    J, K = taps.tap_shape
    mean = (taps.taps.mean(axis=1)[:, None] - offset[:, None]) / gain[:, None]  # of samples at rest, (N, S, K)
    within = (taps.taps.var(axis=1).sum(axis=1)[:, None] / gain**2)[:, :, None]
    apart = np.stack([((mean - one) ** 2).sum(axis=2) for one in level], axis=2)
    log_width = (np.log(width) - np.log(gain) - 0.5 * np.log(2 * np.pi))[:, None]
    log_likelihood = J * K * log_width - 0.5 * J * (within + apart)
    log_prior = np.repeat(prior - np.logaddexp.reduce(prior) - np.log(M), M)
    return log_likelihood.reshape(len(taps), 1, -1), log_prior[None]


def measured(J: int, sessions: int, truth: tuple[float, float, float], number: int) -> Scores:
    """Scores of one data set."""
    middle, *sds = truth
    rng = generator(number, Purpose.STUDY, J, sessions, TRUTHS.index(truth))
    level = middle + rng.normal(size=(M, K))
    train, test = draw(rng, level, J, sessions, *sds), draw(rng, level, J, TESTED, *sds)
    reach = 8 + 0.25 * middle
    settings = FitSettings(power="none", edges=np.linspace(middle - reach, middle + reach, 201))
    grid, tap, belief = train.grid(), {}, {}
    for name in MODELS:
        fitted = fit_model(name, train, grid, settings)
        model = fitted.model
        tap[name] = float(plug_in(fitted, test.taps, test.indices(grid)).mean())
        sums, _, what = sequences(model, test, model.log_likelihood(test.taps), EPISODE)
        belief[name] = _mean_belief(sums + model.log_prior, what)
    likelihood, prior = observed(test, level, *sds, width=2 * reach / 200)
    rows, states = np.arange(len(test)), likelihood.shape[2] // M
    own = (likelihood + prior).reshape(len(test), states, M)[rows, :, test.what] + np.log(M)
    tap[KNOWN] = float(np.logaddexp.reduce(own, axis=1).mean())
    sums, _, what = sequences(model, test, likelihood, EPISODE)
    belief[KNOWN] = _mean_belief(sums + prior, what)
    return Scores(J, sessions, truth, tap, belief)


def _mean_belief(log_joint: NDArray[np.float64], what: NDArray[np.intp]) -> float:
    return float(log_belief(log_joint, M)[np.arange(len(what)), 0, what].mean())


def shown(results: Sequence[Scores]) -> str:
    """Means with 95% t-intervals over data sets, a line for each kind of data."""
    lines = []
    for J, sessions, truth in dict.fromkeys(one[:3] for one in results):
        own = [one for one in results if one[:3] == (J, sessions, truth)]
        taps = [mean_interval([one.tap[name] - one.tap[KNOWN] for one in own]) for name in MODELS]
        beliefs = [mean_interval([one.belief[name] for one in own]) for name in MODELS]
        known = f"{np.mean([one.belief[KNOWN] for one in own]):.2f}"
        lines.append([str(J), str(sessions), *(f"{value:g}" for value in truth), *taps, *beliefs, known])
    heads = [f"tap, {name} less {KNOWN}" for name in MODELS] + [f"belief, {name}" for name in (*MODELS, KNOWN)]
    return table(["samples", "sessions", "mean level", "sd of log gain", "sd of offset", *heads], lines)


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=30, help="data sets of each kind")
    options = parsed(parser, "session-states")
    kinds = list(product(SAMPLES, TRAINED, TRUTHS))
    tasks = [partial(measured, *kind, number) for kind in kinds for number in range(options.data_sets)]
    results = list(until_interrupted("Session states", tasks))
    if not results:
        return
    write_json("session-states", [one._asdict() for one in results])
    text = f"{shown(results)}\n\nMeans of {options.data_sets} data sets with 95% t-intervals, in nats."
    print(text)
    if len(results) == len(tasks):
        write_block(options.document, "session-states", text)


if __name__ == "__main__":
    main()
