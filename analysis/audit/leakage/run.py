"""Accuracy of samples before contact at identifying the class, compared with whole taps.

Where classes were recorded one after another, a slow drift of the sensor separates them before the finger touches
anything, and a classifier that has learned the drift looks like one that feels. So the same classifier that infers
object and position from whole taps is given the samples before contact only, and whole taps from which each tap's own
samples before contact were subtracted (tared).

**Samples before contact** must be known, see `before_contact`: the samples alone do not show whether a tap begins in
contact. Without them nothing can be said, and nothing is. **Offsets** that were subtracted when the taps were recorded
never reach the filter, so they explain none of its accuracy; where they differ between classes, classes were recorded
in blocks or under conditions that lasted. **The classifier** is the better of the paper's histogram and a normal
distribution per class and taxel (`CLASSIFIERS`), for each source and quantity by itself, since a classifier that is
weak on few samples would hide a leak. **Intervals** of accuracies are Wilson's, at as many taps as are left after
errors that persist within a class are counted once. **The share** of the accuracy above chance that is reached without
touch has a percentile interval from resampling whole classes, in which both accuracies pair.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtri
from xarray import Variable

from ....models import seeds
from ....models.blocks import TaredSamples, tared
from ....models.errors import InputError
from ....models.grid import ClassGrid
from ....models.measurement.registry import fit_model
from ....models.settings import FitSettings
from ....models.taps import TapSet, check_compatible
from ...experiment.before_contact import Before, before_contact, filter_memory
from ...experiment.data_warnings import in_blocks, recorded_order
from ...stats.metrics import CONFIDENCE
from .words import BEFORE, OFFSET, TARED, UNJUDGED, WHOLE, Verdict, leakage_sentences, unjudged_sentence

CLASSIFIERS = ("histogram", "gaussian")
SOURCES = (BEFORE, OFFSET, WHOLE, TARED)
_MOST, _HALF = 0.75, 0.5
_RESAMPLES = 2000
_FEWEST = 10


class Leakage(NamedTuple):
    """Accuracy without touch, and whether it explains that of whole taps.

    Attributes:
        told: Dims (source, quantity): `accuracy`, `low`, `high` after one tap, `classifier`, and of sources without
            touch the `share` of the accuracy of whole taps above chance, with `share_low` and `share_high`; dim
            quantity: `chance`, and `lost`, `lost_low`, `lost_high`: accuracy that taring costs. NaN where a source is
            not there.
        before: The samples before contact.
        blocks: Whether classes were recorded in blocks, by side and session, then by quantity.
        explains: Whether leakage explains the accuracy of each quantity.
        sentences: The findings as sentences, the gravest first.
        test_taps: On how many taps accuracies rest.
    """

    told: xr.Dataset
    before: Before
    blocks: dict[str, dict[str, bool]]
    explains: dict[str, Verdict]
    sentences: tuple[str, ...]
    test_taps: int

    @property
    def explained(self) -> tuple[str, ...]:
        """The quantities whose accuracy leakage explains, wholly or mostly."""
        return tuple(name for name, verdict in self.explains.items() if verdict in ("yes", "mostly"))

    @property
    def unjudged(self) -> str:
        """Why nothing can be said of leakage, in a sentence; empty where it can."""
        return unjudged_sentence(self.before) if UNJUDGED in self.explains.values() else ""


def leakage(train: TapSet, test: TapSet, grid: ClassGrid, seed: int = 0, pre: int | None = None) -> Leakage:
    """Accuracy of one tap without touch, compared with whole taps.

    Leakage explains a quantity where the samples before contact infer nearly as much above chance as whole taps:
    `"yes"` where the interval of that share begins at three quarters or above, `"mostly"` at a half or above,
    `"partly"` where it begins above zero, else `"no"`, or `"not enough data"` where the interval leaves both open;
    `"cannot be judged"` where no sample is known to be before contact. A high-pass forgets slow drift and keeps, for
    its memory, the former taps of the class in the samples before contact, which is touch all the same:
    `"former taps"`.

    Args:
        train: Training taps; the extra array `offset` (tap, taxel) is used where both sets have it.
        test: Test taps, in the best case of other sessions.
        grid: The classes.
        seed: Seed of the resamples.
        pre: How many samples at the beginning of each tap are before contact; `None` for what the taps' record says.

    Raises:
        InputError: The sets do not fit together, no test tap belongs to a trained class, or `pre` does not fit.
    """
    check_compatible(train, test)
    train, test = _inside(train, grid), _inside(test, grid)
    where, what = train.indices(grid)
    trained = np.unique(where * grid.M + what)
    known = np.isin(np.ravel_multi_index(test.indices(grid), grid.shape), trained)
    if not known.any():
        raise InputError("No test tap belongs to a class with a training tap.")
    test = test.select(known)
    before = before_contact(train, where * grid.M + what, pre)
    quantities = _quantities(grid)
    correct = {
        source: _correct(*pair, grid, quantities) for source, pair in _sources(train, test, before).items() if pair
    }
    cell = np.ravel_multi_index(test.indices(grid), grid.shape)
    chance = {name: _chance(test, grid, name, len(trained)) for name in quantities}
    told = _told(correct, chance, cell, seeds.generator(seed, seeds.Purpose.LEAKAGE))
    former = filter_memory(train)
    blocks = _blocks(train, test, grid, quantities)
    explains: dict[str, Verdict] = {name: _verdict(told, name, former, before, len(test)) for name in quantities}
    sentences = tuple(leakage_sentences(told, before, blocks, explains, former))
    return Leakage(told, before, blocks, explains, sentences, len(test))


def _inside(taps: TapSet, grid: ClassGrid) -> TapSet:
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    if not inside.any():
        raise InputError("No tap belongs to a class of the grid.")
    return taps if inside.all() else taps.select(inside)


def _quantities(grid: ClassGrid) -> tuple[str, ...]:
    """What there is to tell."""
    names = [name for name, size in (("what", grid.M), ("where", grid.L)) if size > 1]
    return (*names, "joint") if len(names) == 2 else tuple(names or ["what"])


def _sources(train: TapSet, test: TapSet, before: Before) -> dict[str, tuple[TapSet, TapSet] | None]:
    """Training and test taps of each source, nothing where there are none."""

    def both(samples: Mapping[str, Variable | NDArray[np.floating]]) -> tuple[TapSet, TapSet]:
        return with_samples(train, samples["train"]), with_samples(test, samples["test"])

    sets = {"train": train, "test": test}
    n = before.samples
    has_offset = all(
        "offset" in taps.dataset and taps.dataset["offset"].dims == ("tap", "taxel") for taps in (train, test)
    )
    return {
        BEFORE: both({side: taps.samples[:, :n] for side, taps in sets.items()}) if n else None,
        OFFSET: both({side: taps.dataset["offset"].values[:, np.newaxis] for side, taps in sets.items()})
        if has_offset
        else None,
        WHOLE: (train, test),
        TARED: both({side: _tared(taps, n) for side, taps in sets.items()}) if n else None,
    }


def _tared(taps: TapSet, first: int) -> Variable | NDArray[np.floating]:
    """Samples less the mean of the first ones, in memory or to be read."""
    large = taps.scanned is not None
    samples = taps.samples
    return TaredSamples(samples, first, samples.dtype).variable(samples) if large else tared(taps.taps, first)


def with_samples(taps: TapSet, samples: Variable | NDArray[np.floating]) -> TapSet:
    """Taps of the same labels with other samples, shape (N, any number, K)."""
    J = samples.shape[1]
    # What started a tap says nothing of a part of it.
    record = replace(taps.preprocessing.of_length(J), pre_samples=0)
    variable = samples if isinstance(samples, Variable) else Variable(("tap", "sample", "taxel"), samples)
    dataset = taps.dataset.drop_dims("sample").assign(taps=variable)
    dataset = dataset.assign_coords(time=("sample", np.arange(J) / (record.rate_hz or 1.0)))
    return TapSet(dataset.assign_attrs(preprocessing=record.to_json()))


def _correct(
    train: TapSet, test: TapSet, grid: ClassGrid, quantities: tuple[str, ...]
) -> dict[str, tuple[str, NDArray[np.bool_]]]:
    """Of each quantity, the better classifier and which test taps it is right about, shape (N,)."""
    best: dict[str, tuple[str, NDArray[np.bool_]]] = {}
    for classifier in CLASSIFIERS:
        try:
            model = fit_model(classifier, train, grid, FitSettings()).model
        except InputError:
            continue  # too few taps per class for this one
        log_belief = model.log_likelihood(test.samples) + model.log_prior
        belief = np.exp(log_belief - log_belief.max(axis=(1, 2), keepdims=True))
        where, what = test.indices(grid)
        right = {
            "what": belief.sum(axis=1).argmax(axis=1) == what,
            "where": belief.sum(axis=2).argmax(axis=1) == where,
            "joint": belief.reshape(len(belief), -1).argmax(axis=1) == where * grid.M + what,
        }
        for name in quantities:
            if name not in best or right[name].mean() > best[name][1].mean():
                best[name] = classifier, right[name]
    return best


def _chance(test: TapSet, grid: ClassGrid, name: str, cells: int) -> float:
    """The better of a guess among the trained classes and of always saying the most frequent one."""
    where, what = test.indices(grid)
    labels, classes = {
        "what": (what, grid.M),
        "where": (where, grid.L),
        "joint": (where * grid.M + what, cells),
    }[name]
    return max(1 / classes, float(np.bincount(labels).max() / len(labels)))


def accuracy_interval(right: NDArray[np.bool_], cell: NDArray[np.intp]) -> tuple[float, float]:
    """Wilson interval of a share, at the number of taps that is left when errors persist within classes.

    Args:
        right: Whether each tap was told rightly, shape (N,).
        cell: Class of each tap, shape (N,).
    """
    n, p = len(right), float(right.mean())
    residual = np.bincount(np.unique(cell, return_inverse=True)[1], weights=right - p)
    G, binomial = len(residual), p * (1 - p) * n
    clustered = float((residual**2).sum()) * G / max(G - 1, 1)
    n = n / max(1.0, clustered / binomial if binomial > 0 else 1.0)
    z = float(ndtri(0.5 + CONFIDENCE / 2))
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def _told(
    correct: dict[str, dict[str, tuple[str, NDArray[np.bool_]]]],
    chance: dict[str, float],
    cell: NDArray[np.intp],
    generator: np.random.Generator,
) -> xr.Dataset:
    """The table `Leakage.told`."""
    quantities = tuple(chance)
    index = np.unique(cell, return_inverse=True)[1]
    G = index.max() + 1
    weights = generator.multinomial(G, np.full(G, 1 / G), size=_RESAMPLES)[:, index].astype(np.float64)
    dims, shape = ("source", "quantity"), (len(SOURCES), len(quantities))
    two = {name: np.full(shape, np.nan) for name in ("accuracy", "low", "high", "share", "share_low", "share_high")}
    one = {name: np.full(len(quantities), np.nan) for name in ("lost", "lost_low", "lost_high")}
    classifier = np.full(shape, "", dtype="<U9")
    resampled: dict[tuple[str, str], NDArray[np.float64]] = {}
    for source, by_quantity in correct.items():
        for name, (used, right) in by_quantity.items():
            at = SOURCES.index(source), quantities.index(name)
            resampled[source, name] = (weights @ right) / weights.sum(axis=1)
            two["accuracy"][at], classifier[at] = right.mean(), used
            two["low"][at], two["high"][at] = accuracy_interval(right, cell)
    for q, name in enumerate(quantities):
        whole = two["accuracy"][SOURCES.index(WHOLE), q]
        for source in (BEFORE, OFFSET):
            if (source, name) in resampled and whole > chance[name]:
                at = SOURCES.index(source), q
                above = np.maximum(resampled[WHOLE, name] - chance[name], 1e-9)
                share = (resampled[source, name] - chance[name]) / above
                two["share"][at] = (two["accuracy"][at] - chance[name]) / (whole - chance[name])
                two["share_low"][at], two["share_high"][at] = _percentiles(share)
        if (TARED, name) in resampled:
            one["lost"][q] = whole - two["accuracy"][SOURCES.index(TARED), q]
            one["lost_low"][q], one["lost_high"][q] = _percentiles(resampled[WHOLE, name] - resampled[TARED, name])
    return xr.Dataset(
        {key: (dims, values) for key, values in two.items()}
        | {key: ("quantity", values) for key, values in one.items()}
        | {"classifier": (dims, classifier), "chance": ("quantity", [chance[name] for name in quantities])},
        {"source": list(SOURCES), "quantity": list(quantities)},
        {"interval": CONFIDENCE},
    )


def _percentiles(resampled: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.quantile(resampled, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return float(low), float(high)


def _verdict(told: xr.Dataset, name: str, former: float, before: Before, test_taps: int) -> Verdict:
    at = told.sel(quantity=name)
    if test_taps < _FEWEST:
        return "not enough data"
    if not float(at["low"].sel(source=WHOLE)) > float(at["chance"]):
        return "nothing to explain"
    if not before.samples:
        return UNJUDGED
    at = at.sel(source=BEFORE)
    low, high = float(at["share_low"]), float(at["share_high"])
    if not (float(at["low"]) > float(at["chance"]) and low > 0):
        return "no" if high < _HALF else "not enough data"
    if former:
        return "former taps"
    return "yes" if low >= _MOST else "mostly" if low >= _HALF else "partly"


def _blocks(train: TapSet, test: TapSet, grid: ClassGrid, quantities: tuple[str, ...]) -> dict[str, dict[str, bool]]:
    result = {}
    for side, taps in (("training", train), ("test", test)):
        where, what = taps.indices(grid)
        labels = {"what": what, "where": where, "joint": where * grid.M + what}
        for session in np.unique(taps.session).tolist():
            chosen = np.flatnonzero(taps.session == session)
            chosen = chosen[recorded_order(taps.trial[chosen])]
            result[f"{side} session {session}"] = {name: in_blocks(labels[name][chosen]) for name in quantities}
    return result
