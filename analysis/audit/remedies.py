"""Remedies for wrong beliefs: other exponents, other models, finer classes.

Each remedy changes one thing and, where it has one, tunes its exponent on sessions that did not train it: a model that
assumes less still deserves an exponent of its own. None sees the taps that it is later measured on.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...inference.tuning.tempering import best_power, judged_sets, learn_saturation
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.histogram import trim
from ...models.measurement.model import TapModel
from ...models.measurement.registry import fit_model, row, suited
from ...models.setting_file import Setting
from ...models.settings import FitSettings
from ...models.taps import TapSet
from ..stats.right_exponent import SIMULATIONS, Tuned, beside_right_model, simulate_tuned

BASELINE = "current setting"
EXPONENT = "exponent"
FALLING = "falling exponent"
FINER = "finer grid"
THRESHOLD = "threshold"
_FINER = 2  # where classes for one


class Remedy(NamedTuple):
    """A way to perceive that might be better.

    Attributes:
        name: For tables.
        title: What it is, in words.
        assumes: What it still assumes.
        setting: Everything chosen.
        model: Fitted to the training taps.
        grid: Its classes.
        how: How it was tuned, in a sentence.
        beside: What was tuned beside what a right model gives, where that was simulated.
    """

    name: str
    title: str
    assumes: str
    setting: Setting
    model: TapModel
    grid: ClassGrid
    how: str
    beside: Tuned | None = None


class RefusedRemedy(NamedTuple):
    """A remedy that these taps do not allow."""

    name: str
    reason: str


MODELS = {
    "time-indexed": (
        "profile",
        "a mean and a variance for each time of a tap",
        "samples independent given their time, taxels and taps independent",
    ),
    "taxel covariance": (
        "profile-mvn",
        "each sample predicted from the other taxels at the same time",
        "times and taps independent",
    ),
    "session state": (
        "session",
        "an unknown gain and offset of the session, marginalised exactly",
        "samples and taxels independent, sessions equal except for one gain and offset",
    ),
}
"""Remedies that are models of the catalogue: which, what it does, and what it still assumes."""
_MANY_TAXELS = 24
_FOR_MANY = (
    "matrix-normal",
    "one covariance across taxels times one in time",
    "the same taxel covariance at all times, taps independent",
)
"""What stands for taxel covariance where a forecast from every other taxel in every class would take minutes to fit."""
_PAPER = "samples, taxels and taps independent"


def no_change(setting: Setting, train: TapSet, grid: ClassGrid) -> Remedy:
    """The setting as it is.

    Raises:
        InputError: It cannot be fitted.
    """
    return Remedy(BASELINE, "no change", _assumes(setting), setting, _fit(setting, train, grid), grid, "")


def make_remedies(
    base: Remedy,
    train: TapSet,
    tune: Sequence[TapSet],
    n: int,
    seed: int,
    advance: Callable[[int], None],
    models: Sequence[str] = (),
) -> tuple[list[Remedy], list[RefusedRemedy]]:
    """The setting as it is, from `no_change`, and every remedy that the taps allow, fitted and tuned.

    Further `models` are remedies of their own names.
    """
    setting, used, grid = base.setting, base.model, base.grid
    remedies, refused = [base], list[RefusedRemedy]()

    def attempt(name: str, make: Callable[[], Remedy]) -> None:
        try:
            remedies.append(make())
        except InputError as error:
            refused.append(RefusedRemedy(name, str(error)))
        advance(1)

    def exponent() -> Remedy:
        learned = best_power(used, tune, n, seed)
        chosen = setting.changed(power=learned.power)
        title = "likelihoods are raised to one exponent for all numbers of taps"
        return Remedy(EXPONENT, title, _assumes(setting), chosen, _powered(used, chosen), grid, learned.sentence)

    def falling() -> Remedy:
        learned = learn_saturation(used, tune, seed=seed)
        limit = None if np.isinf(learned.saturation) else float(learned.saturation)
        chosen = setting.changed(power=learned.power, saturation=limit)
        title = "an exponent that decreases with the number of taps, so a sequence counts as a limited number of taps"
        assumes = "samples and taxels independent, taps dependent to the same degree everywhere"
        return Remedy(FALLING, title, assumes, chosen, _powered(used, chosen), grid, learned.sentence)

    def other(name: str) -> Remedy:
        model, title, assumes = _model_of(name, train)
        fitted = _fit(setting.changed(model=model), train, grid)
        learned = best_power(fitted, tune, n, seed)
        chosen = setting.changed(model=model, power=learned.power)
        return Remedy(name, title, assumes, chosen, _powered(fitted, chosen), grid, learned.sentence)

    def finer() -> Remedy:
        cell, fine = _finer(train, grid, setting)
        chosen = setting.changed(where_cell=cell, fixation=_same_place(setting.play.fixation, grid, fine))
        title = f"position classes half as wide, {cell}"
        return Remedy(FINER, title, _assumes(setting), chosen, _fit(chosen, train, fine), fine, "")

    attempt(EXPONENT, exponent)
    attempt(FALLING, falling)
    for name in (*MODELS, *models):
        if _model_of(name, train)[0] == setting.model:
            advance(1)
        else:
            attempt(name, lambda name=name: other(name))
    attempt(FINER, finer)
    return remedies, refused


def beside_right(
    remedies: Sequence[Remedy],
    train: TapSet,
    tune: Sequence[TapSet],
    n: int,
    seed: int,
    advance: Callable[[int], None],
    simulations: int = SIMULATIONS,
) -> list[Remedy]:
    """The remedies, exponents and saturation of the model in use beside those of a right one.

    Other models than that in use take minutes to be fitted and tuned as often.

    Args:
        remedies: From `make_remedies`, with the arguments that follow.
        train: Training taps.
        tune: Sessions by which exponents were chosen.
        n: Taps after which exponents were judged.
        seed: Of random draws.
        advance: Told of every simulated data set.
        simulations: Data sets; none leaves the remedies as they are.
    """
    base = remedies[0]
    tuned = {remedy.name: remedy.setting for remedy in remedies if remedy.name in (EXPONENT, FALLING)}
    if not tuned or not simulations:
        advance(simulations)
        return list(remedies)

    def again(sets: Sequence[TapSet]) -> Sequence[float]:
        model = _fit(base.setting, sets[0], base.grid)
        judged = judged_sets(model, sets[1:])
        falling = learn_saturation(model, judged, seed=seed)
        return best_power(model, judged, n, seed).power, falling.power, falling.saturation

    found = simulate_tuned(base.model, [train, *tune], again, 3, seed, simulations, advance)
    columns, beside = {EXPONENT: [0], FALLING: [1, 2]}, {}
    for name, setting in tuned.items():
        limit = None
        if name == FALLING:
            limit = np.inf if setting.fit.saturation is None else setting.fit.saturation
        beside[name] = beside_right_model(float(setting.fit.power), limit, found[:, columns[name]], base.model, train)
    return [remedy._replace(beside=beside.get(remedy.name)) for remedy in remedies]


def count_remedies(models: Sequence[str] = ()) -> int:
    """How often `make_remedies` reports progress."""
    return 3 + len(MODELS) + len(models)


def _model_of(name: str, train: TapSet) -> tuple[str, str, str]:
    """The model of a remedy, what it does, and what it still assumes."""
    if name == "taxel covariance" and train.dataset.sizes["taxel"] > _MANY_TAXELS:
        return _FOR_MANY
    if name in MODELS:
        return MODELS[name]
    relaxes, how = row(name)
    return name, how, relaxes


def _assumes(setting: Setting) -> str:
    known = {model: assumes for model, _, assumes in MODELS.values()}
    return _PAPER if setting.model == "histogram" else known.get(setting.model, f"what the model {setting.model} does")


def _fit(setting: Setting, train: TapSet, grid: ClassGrid) -> TapModel:
    settings = FitSettings(
        bins=setting.fit.bins,
        pseudocount=setting.fit.pseudocount,
        power=setting.fit.power,
        value_range=setting.fit.value_range,
        method=setting.fit.method,
        unconverged=setting.fit.unconverged,
        steps=setting.fit.steps,
        seed=setting.fit.seed,
    )
    used = suited(setting.model, settings)
    return _powered(fit_model(setting.model, train, grid, used, "the training taps of an audit").model, setting)


def _powered(model: TapModel, setting: Setting) -> TapModel:
    """The model at the power and saturation of a setting."""
    saturation = np.inf if setting.fit.saturation is None else setting.fit.saturation
    return replace(model, power=setting.fit.power, saturation=saturation)  # pyright: ignore[reportArgumentType]


def _finer(train: TapSet, grid: ClassGrid, setting: Setting) -> tuple[str, ClassGrid]:
    """Width of half a where class, and the classes of that width.

    Raises:
        InputError: Classes have no width, or their taps do not lie at several places.
    """
    if grid.where_edges is None or grid.L < 2:
        raise InputError("Position classes have no width to halve.")
    where, _ = train.indices(grid)
    several = [len(np.unique(train.where[where == l])) for l in np.unique(where[where >= 0])]
    if np.median(several) < _FINER:
        raise InputError("Taps of each position class lie at the same position, so finer classes would be empty.")
    width = float(np.diff(grid.where_edges).mean()) / _FINER
    cell = f"{width:.6g}{grid.where_unit.partition(' ')[0].rstrip(',;')}"
    return cell, trim(train.grid(cell, setting.what_cell), [train])[0]


def _same_place(fixation: int | None, grid: ClassGrid, finer: ClassGrid) -> int | None:
    """The finer class nearest to a fixation point, the lower one of two."""
    if fixation is None:
        return None
    return int(np.abs(finer.where_value - grid.where_value[fixation]).argmin())
