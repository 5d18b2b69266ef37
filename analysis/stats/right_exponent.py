"""Tuned exponents and saturations compared with those of a correct model, tuned on as many taps in the same way.

An exponent below 1 does not show that samples or taps depend on each other: tables of few training taps deserve less
than full weight too, and sequences that draw stored taps again deserve a saturation. So both stand beside what data
sets give in which the model is right: as many taps of each class and session, of independent samples, to which it is
fitted and tuned anew.

For histograms these are the taps at hand, each sample (taxel and time) shuffled between the taps of its class. Where
samples of a class are independent and sessions alike, shuffled taps are as probable as they were, whatever the
histograms, so the test has its level by itself. Taps drawn from the fitted histograms would be too easy to tell apart:
bins without a training sample never occur in them. Models that know of dependence, and others, have taps drawn from
their point estimate. Where belief in the true class is 1 to machine precision at several exponents, the smallest is
taken, so a right model need not give 1.
The test has one side, below: neither exponent nor saturation can be tuned above what independence allows.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.tuning.tempering import CONTACTS, learn_power
from ...models import seeds
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.fits.portable import PortableFit
from ...models.measurement.fits.posterior import EXACT
from ...models.measurement.generic.source import registered_of, take_over
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import Fitted, TapModel
from ...models.progress import silent
from ...models.settings import FitSettings
from ...models.taps import TapSet
from ..tasks.crew import THREADS, Crew
from .detection import LEVEL
from .right_model import Beside, compare, drawn_set

type Floats = NDArray[np.float64]

SIMULATIONS = 19
"""The fewest with which a value below all is significant at `detection.LEVEL`."""
MOST_TAPS = float(max(CONTACTS))
"""Saturation that stands for none: that of the longest sequence over which it is tuned."""


class Tuned(NamedTuple):
    """A tuned exponent, and saturation if any, compared with those of a correct model.

    Attributes:
        power: The exponent.
        saturation: In taps, at most `MOST_TAPS`; `None` where only an exponent was tuned.
        taps: Training taps of a class, the median.
        simulations: Data sets drawn from the fitted model.
    """

    power: Beside
    saturation: Beside | None
    taps: int
    simulations: int

    @property
    def sentence(self) -> str:
        """Both values and their tests, in a sentence."""
        parts = [self._beside("Exponent", self.power, _number)]
        if self.saturation is not None:
            parts.append(self._beside("Saturation", self.saturation, _limit))
        return " ".join(parts)

    def _beside(self, name: str, one: Beside, shown: Callable[[float], str]) -> str:
        if np.isnan(one.median):
            return f"{name} {shown(one.value)}; a correct model could not be simulated."
        found = (
            f"the {name.lower()} is lower, by a Monte Carlo test at 5% (p = {one.below:.2g})"
            if outside(one)
            else "it does not differ significantly from a correct model"
        )
        return (
            f"{name} {shown(one.value)}; a correct model on {self.taps} training tap{'s' * (self.taps > 1)} per class "
            f"gives {shown(one.median)} ({shown(one.low)} to {shown(one.high)}): {found}."
        )


def check_simulations(simulations: int) -> None:
    """Refuses too few.

    Raises:
        InputError: With so few data sets nothing is significant.
    """
    if simulations < SIMULATIONS:
        raise InputError(f"--simulations must be 0 or at least {SIMULATIONS}, got {simulations}.")


def simulate_tuned(
    model: TapModel,
    sets: Sequence[TapSet],
    tune: Callable[[Sequence[TapSet]], Sequence[float]],
    count: int,
    seed: int,
    simulations: int = SIMULATIONS,
    progress: Callable[[int], object] = silent,
    crew: Crew = THREADS,
) -> Floats:
    """Values tuned on data sets for which a model is correct.

    Args:
        model: The model; of its parameters the power and saturation do not count.
        sets: The taps at hand.
        tune: Fits and tunes on such sets; may raise `InputError`.
        count: C, how many numbers it returns.
        seed: Of all random numbers.
        simulations: S, how many data sets.
        progress: Called after every data set.
        crew: What does the work, a data set at a time.

    Returns:
        What `tune` returns, shape (S, C); NaN where it could not.
    """
    usable = [taps.select(known) for taps in sets if (known := model.known(taps)).any()]

    simulated = _Simulated(PortableFit(Fitted(model, None, EXACT)), usable, tune, seed, registered_of([model.kind]))
    found = crew(_tuned, range(simulations), simulated, progress)
    return np.array([[np.nan] * count if row is None else row for row in found])


class _Simulated(NamedTuple):
    """What data sets are simulated from, and what is done with each; with the function of a user's model."""

    made: PortableFit
    sets: list[TapSet]
    tune: Callable[[Sequence[TapSet]], Sequence[float]]
    seed: int
    functions: dict[str, Any]


def _tuned(number: int, given: _Simulated) -> Sequence[float] | None:
    """Values tuned on a simulated data set; `None` where it cannot be."""
    take_over(given.functions)
    generator = seeds.generator(given.seed, seeds.Purpose.RIGHT_EXPONENT, number)
    try:
        return given.tune(right_sets(given.made.fitted.model, given.sets, generator))
    except InputError:
        return None


def right_sets(model: TapModel, sets: Sequence[TapSet], generator: np.random.Generator) -> list[TapSet]:
    """As many taps of each class and session, of which a model is right.

    Returns:
        For a histogram the same samples, shuffled between the taps of their class; in a model with states of an
        episode, between those of their session. For others, taps drawn from the model.
    """
    if not isinstance(model, HistogramModel):
        return [drawn_set(model, taps, generator) for taps in sets]
    known = [one.taps if one.scanned is None else one.samples for one in sets]
    made = [np.empty(samples.shape, samples.dtype) for samples in known]
    where, what = (np.concatenate(columns) for columns in zip(*(one.indices(model.grid) for one in sets), strict=True))
    ends = np.cumsum([len(one) for one in sets])[:-1]
    group = where * model.grid.M + what
    if len(model.states.gain) > 1:
        part, session = np.repeat(np.arange(len(sets)), [len(one) for one in sets]), [one.session for one in sets]
        group = np.unique(np.stack([group, part, np.concatenate(session)]), axis=1, return_inverse=True)[1]
    number = np.split(np.unique(group, return_inverse=True)[1], ends)
    for own in range(max(each.max() for each in number) + 1):
        members = [np.flatnonzero(each == own) for each in number]
        own_taps = [np.asarray(samples[rows]) for samples, rows in zip(known, members, strict=True)]
        shuffled = generator.permuted(np.concatenate(own_taps), axis=0)
        ends = np.cumsum([len(rows) for rows in members])
        for taps, rows, chosen in zip(made, members, np.split(shuffled, ends[:-1]), strict=True):
            taps[rows] = chosen
    return [TapSet(one.dataset.assign(taps=(one.samples.dims, taps))) for one, taps in zip(sets, made, strict=True)]


def beside_right_model(
    power: float, saturation: float | None, simulated: Floats, model: TapModel, train: TapSet
) -> Tuned:
    """Tuned values beside simulated ones.

    Args:
        power: The exponent.
        saturation: In taps, infinity for no limit; `None` where only an exponent was tuned.
        simulated: Exponents and, where one was tuned, saturations of simulated data sets, shape (S, 1) or (S, 2).
        model: The model.
        train: Its training taps.
    """
    where, what = model.usable(train).indices(model.grid)
    count = np.unique(where * model.grid.M + what, return_counts=True)[1]
    limit = None
    if saturation is not None:
        limit = compare_below(min(saturation, MOST_TAPS), np.minimum(simulated[:, 1], MOST_TAPS))
    return Tuned(compare_below(power, simulated[:, 0]), limit, int(np.median(count)), len(simulated))


def compare_below(value: float, simulated: Floats) -> Beside:
    """A tuned value beside simulated ones, shape (S,), its ends those of a test that it is not below them.

    The value is below `low` just where `below` is at most `LEVEL`, if no simulation failed; `high` is the largest.
    Exponents and saturations are bounded above, so values above those of a right model mean nothing.
    """
    found = compare(value, simulated)
    known = np.sort(simulated[~np.isnan(simulated)])
    if np.isnan(found.median):
        return found
    most = max(int(LEVEL * (1 + len(simulated)) + 1e-9), 1)  # simulations up to the value with which it is significant
    return found._replace(low=float(known[min(most, len(known)) - 1]), high=float(known[-1]))


def outside(beside: Beside) -> bool:
    """Whether a tuned value is below that of a correct model, by a test at `LEVEL`."""
    return beside.below <= LEVEL


def learned_beside(
    name: str,
    model: TapModel,
    taps: TapSet,
    settings: FitSettings,
    n: int,
    simulations: int = SIMULATIONS,
    progress: Callable[[int], object] = silent,
    crew: Crew = THREADS,
) -> Tuned:
    """A power of `tempering.learn_power` beside those of a right model.

    Args:
        name: Of the model.
        model: Fitted to all training taps, at the learned power.
        taps: Training taps.
        settings: How it was fitted.
        n: Taps after which the power was judged.
        simulations: Data sets.
        progress: Called after every data set.
        crew: What does the work, a data set at a time.
    """
    tune = partial(_learned, name, model.grid, settings, n)
    found = simulate_tuned(model, [taps], tune, 1, settings.seed, simulations, progress, crew)
    return beside_right_model(model.exponent, None, found, model, taps)


def _learned(name: str, grid: ClassGrid, settings: FitSettings, n: int, sets: Sequence[TapSet]) -> Sequence[float]:
    return [learn_power(name, sets[0], grid, settings, n, settings.seed).power]


def _number(value: float) -> str:
    return f"{value:.2g}"


def _limit(taps: float) -> str:
    return "no limit" if taps >= MOST_TAPS else f"{taps:.2g}"
