"""Data on which strategies are compared: simulated data sets, taps of a correct model, or a recording."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ...hardware.simulator.model_rig import draw_session
from ...hardware.simulator.session import simulate_session
from ...hardware.simulator.settings import PRESETS, preset
from ...inference.information import TapOutcomes, tap_outcomes
from ...inference.moves.table import held_out_tables
from ...inference.reference import Border
from ...inference.trials.records import TapTable, tap_table
from ...inference.tuning.tempering import best_power, learn_power
from ...models.errors import InputError
from ...models.grid import ClassGrid, can_act
from ...models.io.load import TapSource, names_of
from ...models.measurement.histogram import fit
from ...models.measurement.model import TapModel
from ...models.seeds import data_set_seed
from ...models.settings import TAPS, Division, FitSettings
from ...models.taps import TapSet
from ..experiment.sources import recorded_source, right_model
from ..stats.resampled_units import RESAMPLES

RIGHT = "model"
"""Preset whose taps are drawn from the model that perceives them."""
SAMPLES = 1
"""Of a tap of that preset: with more of them nothing is ever mistaken."""
_TEST_TAPS = 100  # of a class, as many that drawing them again and again hardly makes beliefs too sure
_TRAINING_TAPS = 20
_LEAST_TAPS = 2  # of a class in the pool


class Unit(NamedTuple):
    """One data set or fold.

    Attributes:
        train: Taps that train the model, and that strategies look at.
        test: Taps that trials draw.
        tune: Taps of another session, to learn the power with; `None` where there is none.
        right: The model that all taps were drawn from, if they were.
    """

    train: TapSet
    test: TapSet
    tune: TapSet | None = None
    right: TapModel | None = None

    def model(self, power: str, grid: ClassGrid, seed: int) -> TapModel:
        """What perceives: the right model, or the paper's histograms of the training taps.

        Args:
            power: `"J"`, `"none"` or `"learned"`, which takes the tuning taps, or else training sessions left out.
            grid: The classes.
            seed: Of the sequences that the power is learned from.

        Raises:
            InputError: As `learn_power`.
        """
        if self.right is not None:
            return self.right
        model = fit(self.train, grid, power="J" if power == "learned" else power)
        if power != "learned":
            return model
        if self.tune is not None:
            return replace(model, power=best_power(model, [self.tune], TAPS, seed).power)
        return replace(model, power=learn_power("histogram", self.train, grid, FitSettings(), TAPS, seed).power)

    def held_out(self, model: TapModel, grid: ClassGrid) -> list[TapTable]:
        """Training taps under models that they did not train, with the power of a model; for the strategy `table`."""
        if self.right is not None:
            return [tap_table(self.right, self.train)]
        return held_out_tables(self.train, grid, lambda taps, grid: fit(taps, grid, power=model.power))


class StrategyData(NamedTuple):
    """A kind of data.

    Attributes:
        name: For print.
        simulated: Whether no sensor was touched.
        folds: Data sets or folds.
        load: Gives one of them by its number.
        grid: The classes.
        units: What varies between the units, in a sentence.
        powers: Roots of the likelihood that are compared; the first has all strategies.
        border: What is done to belief that leaves the range.
    """

    name: str
    simulated: bool
    folds: int
    load: Callable[[int], Unit]
    grid: ClassGrid
    units: str
    powers: tuple[str, ...]
    border: Border

    @property
    def resamples(self) -> int:
        """Of test taps, which are the units where there is a single fold."""
        return 0 if self.folds > 1 else RESAMPLES

    @property
    def left_out(self) -> bool:
        """Whether the units are sessions, each tested with the model of the others."""
        return self.folds > 1 and not self.simulated


def simulated_bench(name: str, data_sets: int, seed: int) -> StrategyData:
    """Data sets of a preset, each of a sensor of its own with sessions to train, to test and to learn the power with.

    Raises:
        InputError: There is no such preset, or there are less than two data sets.
    """
    if data_sets < 2:
        raise InputError(f"At least two data sets are required, got {data_sets}.")
    if name == RIGHT:
        load, powers, border = partial(_draw, seed), ("none",), "clamp"
        units = f"Units are {data_sets} correct models, each with taps drawn from it; samples per tap: {SAMPLES}."
    else:
        preset(name, (RIGHT,))
        load, powers, border = partial(_simulate, name, seed), ("J", "learned", "none"), "uniform"
        units = f"Units are {data_sets} simulated data sets, each with its own sensor and sessions."
    grid = right_model(seed).grid if name == RIGHT else simulate_grid(name)
    return StrategyData(f"preset {name}", True, data_sets, load, grid, units, powers, border)


def recorded_bench(data: TapSource, division: Division | None = None) -> StrategyData:
    """A recording, whose sessions are left out in turn where there are three or more.

    Args:
        data: Taps or their file.
        division: The cells, and whether test taps that are among the training taps are kept.

    Raises:
        InputError: It cannot be read or divided, has a single place or object, or cells without a tap.
    """
    (name,), source = names_of([data]), recorded_source(data, division)
    if not can_act(source.grid):
        raise InputError(f"{name} has a single position or a single object, so there are no moves to compare.")
    sessions = []
    for number in range(source.folds):
        fold = source.load(number, 0.0)
        sessions.append(len(np.unique(fold.train.session)))
        for words, taps in (("training", fold.train), ("test", fold.test)):
            missing = _empty_cells(taps, source.grid)
            if missing:
                raise InputError(
                    f"{name} has no {words} tap in {missing} of {source.grid.L * source.grid.M} classes of a fold; "
                    "the comparison requires taps of every class, because moves can lead to any of them."
                )
    powers = ("J", *("learned",) * (min(sessions) > 1), *("none",) * (source.samples > 1))

    def load(number: int) -> Unit:
        fold = source.load(number, 0.0)
        return Unit(fold.train, fold.test)

    return StrategyData(source.name, False, source.folds, load, source.grid, source.units, powers, "uniform")


def pool_of(model: TapModel, train: TapSet, taps: int) -> TapOutcomes:
    """Training taps that strategies enumerate: of each class as many, evenly chosen, that there are about `taps`."""
    where, what = train.indices(model.grid)
    each = max(_LEAST_TAPS, taps // int(model.trained.sum()))
    chosen = []
    for l, m in np.argwhere(model.trained):
        own = np.flatnonzero((where == l) & (what == m))
        chosen.append(own[np.unique(np.linspace(0, len(own) - 1, min(each, len(own))).round().astype(np.intp))])
    return tap_outcomes(model.log_likelihood(train.taps[np.sort(np.concatenate(chosen))]), model.trained)


def simulate_grid(name: str) -> ClassGrid:
    """The classes of a preset."""
    settings = preset(name)
    return simulate_session(replace(settings, spacing_mm=settings.cell_mm / 2), 0, 0).grid()


def _simulate(name: str, seed: int, number: int) -> Unit:
    own = data_set_seed(seed, number)
    train, test, tune = (simulate_session(PRESETS[name], own, session) for session in range(3))
    return Unit(train, test, tune)


def _draw(seed: int, number: int) -> Unit:
    own = data_set_seed(seed, number)
    model = right_model(own, SAMPLES)
    train = draw_session(model, _TRAINING_TAPS, own, 0)
    return Unit(train, draw_session(model, _TEST_TAPS, own, 1), right=model)


def _empty_cells(taps: TapSet, grid: ClassGrid) -> int:
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    return grid.L * grid.M - len(np.unique(where[inside] * grid.M + what[inside]))
