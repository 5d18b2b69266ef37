"""Decisions of a correct model on as many taps, as a reference distribution.

The reference of every verdict on beliefs: data sets of the same design, as many taps of each class, are drawn from the
fitted model and played in the same way. Where what was observed exceeds what they give in all but a few of them,
the model is not right; how few taps there are, how they are drawn and how trials stop is in the reference as well.

An exponent below 1 says that the J samples of a tap are worth fewer independent ones. So that beliefs are right in the
reference, a tap then has as many different samples as the exponent counts, each of them repeated: at the paper's root
J one sample of each taxel, J times. Below one sample nothing makes beliefs right, and the reference is cautious.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...inference.moves.control import check_fixation
from ...inference.trials.records import TapTable, plan_trials
from ...inference.trials.run import LoopPlayer, empty_trials, make_rule
from ...models import seeds
from ...models.measurement.likelihood.bins import PreparedTable, TableForm
from ...models.measurement.model import TapModel
from ...models.setting_file import Setting
from ...models.settings import PlaySettings
from ...models.taps import TapSet
from ...models.threads import cores, in_order
from .decided import decided_about

type Floats = NDArray[np.float64]

SIMULATIONS = 199


class Reference(NamedTuple):
    """Decisions of S simulated data sets at H thresholds, for all objects and each.

    Attributes:
        factor: Wrong decisions over the doubt in them, all decisions counted, shape (S, H, 1 + M); without doubt
            infinite where some are wrong, else NaN.
        missed: Share of the trials that stopped for another object; overall of those that stopped, shape (S, H, 1 + M).
    """

    factor: Floats
    missed: Floats


class Beside(NamedTuple):
    """An observed value compared with those of a correct model.

    Attributes:
        value: What was observed.
        median: What a right model gives.
        low: Lower end of where 95% of its data sets lie.
        high: Upper end.
        above: P-value of the test that the value is not above what a right model gives.
        below: Likewise below.
    """

    value: float
    median: float
    low: float
    high: float
    above: float
    below: float


def simulate(
    model: TapModel,
    table: TapTable,
    thresholds: ArrayLike,
    *,
    play: PlaySettings,
    trials: int,
    seed: int,
    simulations: int = SIMULATIONS,
    draw: Callable[[np.random.Generator], TapTable] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Reference:
    """Data sets drawn from a fitted model and played like the one at hand.

    Args:
        model: The model in use, with its power and saturation.
        table: The taps at hand, of which only the number in each class matters.
        thresholds: theta_W, shape (H,).
        play: How trials are played.
        trials: In each data set.
        seed: Of all random numbers.
        simulations: Data sets.
        draw: Makes one; `None` draws as many taps of each class from `equivalent` of the model.
        progress: Called after every data set.
    """
    thresholds = np.asarray(thresholds, dtype=np.float64)
    drawn = equivalent(model)
    aim = check_fixation(play.fixation, model.grid.L) if model.grid.M > 1 else 0
    rule = make_rule(thresholds, play, seed)._replace(fresh=True)
    draw = partial(drawn_table, drawn, table) if draw is None else draw

    def one(number: int) -> tuple[Floats, Floats]:
        generator = seeds.generator(seed, seeds.Purpose.RIGHT_MODEL, number)
        subject = decided_about(draw(generator), drawn.grid)
        plan = plan_trials(subject.table.pool, trials, seed, aim, first_stream=number * trials)
        played = empty_trials(trials, len(thresholds))
        LoopPlayer(subject.table, rule)(plan, 0, trials, played)
        return described(played.what, plan.what, played.belief, played.stopped, len(subject.names))

    found = []
    for result in in_order((partial(one, number) for number in range(simulations)), cores(None)):
        found.append(result)
        if progress is not None:
            progress(1)
    factor, missed = zip(*found, strict=True)
    return Reference(np.array(factor), np.array(missed))


def reference_factors(
    model: TapModel,
    table: TapTable,
    setting: Setting,
    policy: str,
    trials: int,
    seed: int,
    simulations: int = SIMULATIONS,
    progress: Callable[[int], None] | None = None,
) -> Floats:
    """Factors of data sets played at a setting, of all objects and each, shape (S, 1 + M); see `simulate`.

    Args:
        model: The model in use.
        table: The taps at hand.
        setting: How trials move and stop.
        policy: `"passive"` or `"active"`.
        trials: In each data set.
        seed: Of all random numbers.
        simulations: Data sets.
        progress: Called after every data set.
    """
    return simulate(
        model,
        table,
        [setting.play.threshold],
        play=setting.play.changed(passive=policy == "passive"),
        trials=trials,
        seed=seed,
        simulations=simulations,
        progress=progress,
    ).factor[:, 0]


def described(
    decided: NDArray[np.integer], true: NDArray[np.integer], belief: Floats, stopped: NDArray[np.bool_], M: int
) -> tuple[Floats, Floats]:
    """`Reference` of one data set, shapes (H, 1 + M); all arrays have the shape (n, H) but `true` (n,)."""
    wrong = decided != true[:, np.newaxis]
    columns = np.ones(belief.shape), wrong, np.clip(1 - belief, 0.0, 1.0), stopped, stopped & wrong
    sums = np.array([[np.bincount(true, one, M) for one in np.transpose(column)] for column in columns])
    count, mistakes, doubt, ended, missed = np.concatenate([sums.sum(axis=2, keepdims=True), sums], axis=2)
    among = count.copy()
    among[:, 0] = ended[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return mistakes / doubt, missed / among


def exact(model: TapModel) -> bool:
    """Whether beliefs are right in the reference, the border aside; a saturation makes them cautious there."""
    J = model.preprocessing.samples
    worth = model.exponent * J
    fewest = 1 if model.form.exchangeable else J  # samples of a model of their times cannot be fewer
    whole = bool(np.isclose(worth, round(worth))) and fewest <= round(worth) <= J
    return whole and bool(np.isinf(model.saturation))


def equivalent(model: TapModel) -> TapModel:
    """The model of taps with as many samples as its exponent counts, under which it means the same."""
    J = model.preprocessing.samples
    worth = model.exponent * J
    samples = int(np.clip(round(worth), 1, J)) if model.form.exchangeable else J
    record = model.preprocessing.of_length(samples)
    return replace(model, preprocessing=record, power=worth / samples)  # pyright: ignore[reportArgumentType]


def compare(value: float, reference: Floats) -> Beside:
    """A Monte Carlo test of a value against simulated ones, shape (S,).

    Both may be infinite: decisions are wrong that leave no doubt. Simulated ones that are NaN, without a mistake or a
    doubt, count as 0 when asked whether the value is above, and on the side of the value when whether it is below.
    """
    known = reference[~np.isnan(reference)]
    S, free = len(reference), len(reference) - len(known)
    if np.isnan(value):
        return Beside(value, np.nan, np.nan, np.nan, 1.0, 1.0)
    median, low, high = quantiles(known, [0.5, 0.025, 0.975])
    more, less = (known >= value).sum() + (0 if value > 0 else free), (known <= value).sum() + free
    above, below = (1 + more) / (1 + S), (1 + less) / (1 + S)
    return Beside(float(value), float(median), float(low), float(high), float(above), float(below))


def quantiles(values: Floats, at: ArrayLike) -> Floats:
    """Quantiles of values that may be infinite; NaN where there is none."""
    at = np.asarray(at, dtype=np.float64)
    if not len(values):
        return np.full(at.shape, np.nan)
    # Between two values nothing can be interpolated if one is infinite.
    return np.quantile(values, at, method="linear" if np.isfinite(values).all() else "higher")


def drawn_table(model: TapModel, table: TapTable, generator: np.random.Generator) -> TapTable:
    """A table of taps drawn from the model, as many of each class, in one state in each session that trials stay in."""
    pool = table.pool
    count = pool.count.ravel()
    session, where, what = (np.repeat(index.ravel(), count) for index in np.indices(pool.count.shape))
    form, prepared = model.form, model.prepared
    # Samples of a table would only be put into the same bins again.
    if isinstance(form, TableForm) and isinstance(prepared, PreparedTable):
        hypothesis = _hypotheses(model, what, session, generator)
        bins = form.sample_bins(where, hypothesis, model.preprocessing.samples, generator)
        log_likelihood = prepared.of_bins(bins, model.exponent)
    else:
        log_likelihood = model.log_likelihood(drawn_taps(model, where, what, session, generator))
    first = (np.cumsum(count) - count).reshape(pool.count.shape)
    return table._replace(
        log_likelihood=log_likelihood,
        pool=pool._replace(order=np.arange(len(where)), first=first),
        session=None,
    )


def drawn_set(model: TapModel, taps: TapSet, generator: np.random.Generator) -> TapSet:
    """Taps drawn from the model, as many of each class and session; the classes are trained ones."""
    session = np.unique(taps.session, return_inverse=True)[1]
    drawn = drawn_taps(model, *taps.indices(model.grid), session, generator)
    return TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, drawn)))


def drawn_taps(
    model: TapModel,
    where: NDArray[np.intp],
    what: NDArray[np.intp],
    session: NDArray[np.intp],
    generator: np.random.Generator,
) -> Floats:
    """Taps of given classes drawn from the model, those of a session (from 0 on) in one state; shape (N, J, K)."""
    hypothesis = _hypotheses(model, what, session, generator)
    return model.form.sample(where, hypothesis, model.edges, model.preprocessing.samples, generator)


def _hypotheses(
    model: TapModel, what: NDArray[np.intp], session: NDArray[np.intp], generator: np.random.Generator
) -> NDArray[np.intp]:
    """Objects in the states drawn for their sessions, shape (N,)."""
    chance = np.exp(model.states.log_prior)
    state = generator.choice(len(chance), size=session.max() + 1, p=chance)[session]
    return state * model.grid.M + what
