"""Data of a comparison: simulated data sets or one recording, with their units; and a correct model."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.simulator.session import cut_session, session_counts, simulate_session
from ...hardware.simulator.settings import preset
from ...models.grid import ClassGrid, policies
from ...models.io.load import TapSource, names_of, taps_of
from ...models.io.recording import naming
from ...models.measurement.histogram import HistogramModel, fit, trim
from ...models.seeds import data_set_seed
from ...models.settings import Division
from ...models.splits import Fold, load_experiment
from ..stats.resampled_units import RESAMPLES, resampled_sentence
from ..tasks.kept import Kept

_FEWEST_SESSIONS = 3
_KEPT = 128  # simulated sessions, of the paper 1 MB each, that are not simulated again for another filter


class Source(NamedTuple):
    """Source of the units of a comparison.

    Attributes:
        name: For print.
        simulated: Whether it can be simulated anew with another high-pass.
        folds: Data sets or folds.
        load: Gives one of them, by its number and the cut-off of the high-pass.
        grid: The classes.
        samples: J.
        units: What varies between the units, in a sentence.
    """

    name: str
    simulated: bool
    folds: int
    load: Callable[[int, float], Fold]
    grid: ClassGrid
    samples: int
    units: str

    @property
    def resamples(self) -> int:
        """Of test taps, which are the units where there is a single fold."""
        return 0 if self.folds > 1 else RESAMPLES

    @property
    def left_out(self) -> bool:
        """Whether the units are sessions, each tested with the model of the others."""
        return self.folds > 1 and not self.simulated

    @property
    def number_of_units(self) -> int:
        """Data sets, sessions or resamples of test taps."""
        return self.resamples or self.folds

    @property
    def scope(self) -> str:
        """What sure differences are limited to where there is one fold; empty where units are data of their own."""
        return "" if self.folds > 1 else f"for taps of {'this data set' if self.simulated else 'these sessions'}"

    @property
    def policies(self) -> tuple[str, ...]:
        """The policies that mean anything; the last one is the one that choices are ranked by."""
        return policies(self.grid)


def simulated_source(name: str, data_sets: int, seed: int) -> Source:
    """Data sets of a preset, each of a sensor of its own with one session to train and one to test.

    Raises:
        InputError: There is no such preset.
    """
    settings = preset(name)
    load = partial(_simulate, name, seed, Kept(_KEPT))
    first = load(0, settings.highpass_hz)
    grid = first.train.grid()
    units = (
        f"Units are {data_sets} simulated data sets, each with its own sensor, training session and test session."
        if data_sets > 1
        else f"There is one simulated data set. {resampled_sentence(first.test, grid)}"
    )
    title = f"simulated, preset {name}"
    return Source(title, True, data_sets, load, grid, settings.preprocessing.samples, units)


def recorded_source(data: TapSource, division: Division | None = None) -> Source:
    """A recording, whose sessions are left out in turn where there are three or more.

    Args:
        data: Taps or their file.
        division: The cells, and whether test taps that are among the training taps are kept.

    Raises:
        InputError: It cannot be read or divided.
    """
    (name,), taps = names_of([data]), taps_of(data)
    with naming(name):
        method = "leave-one-session-out" if len(set(taps.session.tolist())) >= _FEWEST_SESSIONS else None
        parts, grid = load_experiment([taps], (division or Division()).changed(split=method))
        grid, _ = trim(grid, [fold.train for fold in parts.folds])
    folds = list(parts.folds)
    units = (
        f"Units are {len(folds)} sessions, each tested with the model of the others."
        if len(folds) > 1
        else f"{parts.description} {resampled_sentence(folds[0].test, grid)}"
    )
    samples = folds[0].train.preprocessing.samples
    units = f"{units} {parts.warning}".strip()
    return Source(Path(name).stem, False, len(folds), lambda number, _: folds[number], grid, samples, units)


def right_model(seed: int, samples: int = 4, power: str = "none") -> HistogramModel:
    """The model of preset `model`: histograms of a simulated session of the paper, for taps of a few samples."""
    taps = simulate_session(preset("paper"), seed, 0)
    model = fit(taps, taps.grid(), power=power)
    return replace(model, preprocessing=model.preprocessing.of_length(samples))


def _simulate(
    name: str,
    seed: int,
    kept: Kept[NDArray[np.uint8]],
    number: int,
    highpass_hz: float,
) -> Fold:
    settings, own = preset(name), data_set_seed(seed, number)
    filtered = replace(settings, highpass_hz=highpass_hz)
    counts = [kept((own, session), partial(session_counts, settings, own, session)) for session in (0, 1)]
    train, test = (cut_session(filtered, own, session, counts[session]) for session in (0, 1))
    return Fold(train, test, f"data set {number}")
