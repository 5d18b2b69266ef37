"""What can be told without touch: from samples before contact, and from offsets that were subtracted from the taps.

Where classes were recorded one after another, a slow drift of the sensor tells them apart before the finger touches
anything, and a classifier that knows the drift looks like one that feels. So the same classifier that tells what and
where from whole taps is given the samples before contact only, the offsets only, and whole taps from which each tap's
own samples before contact were subtracted (tared).

**Samples before contact** are found from the training taps alone, see `leading_samples`. **The classifier** is the
better of the paper's histogram and a normal distribution per class and taxel (`CLASSIFIERS`), for each source and
quantity by itself, since a classifier that is weak on few samples would hide a leak. **Intervals** of accuracies are
Wilson's, at as many taps as are left after errors that persist within a class are counted once. **The share** of the
accuracy above chance that is told without touch has a percentile interval from resampling whole classes, in which both
accuracies pair.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from ..models import seeds
from ..models.catalogue import FitSettings, fit_model
from ..models.classes import ClassGrid
from ..models.errors import InputError
from ..models.scaling import sum_by
from ..models.taps import TapSet, check_compatible
from .metrics import CONFIDENCE
from .suspicions import in_blocks, recorded_order

CLASSIFIERS = ("histogram", "gaussian")
BEFORE, OFFSET, WHOLE, TARED = "before contact", "offset", "whole taps", "tared taps"
SOURCES = (BEFORE, OFFSET, WHOLE, TARED)

type Verdict = Literal[
    "yes", "mostly", "partly", "no", "former taps", "touch already", "nothing to explain", "not enough data"
]
type Leading = Literal["stretch", "first sample", "none"]

_STILL = 1e-3  # of the largest squared change: 3 % of the largest change
_UNREST = 0.3
_SURE = 0.8
_MOST, _HALF = 0.75, 0.5
_RESAMPLES = 2000
_FEWEST = 10
_SETTLED = 4.0  # time constants after which 2 % of a step is left
_GRAVEST_FIRST: tuple[Verdict, ...] = (
    "yes",
    "mostly",
    "partly",
    "former taps",
    "not enough data",
    "touch already",
    "nothing to explain",
    "no",
)
_OBJECTS = {"what": "object", "where": "position", "joint": "object and position together"}


class Lead(NamedTuple):
    """The samples before contact.

    Attributes:
        samples: How many samples at the beginning of a tap are taken for free of contact; 0 for none.
        kind: `"stretch"`: classes stay alike in what changes for two samples or more, so taps begin before contact;
            `"first sample"`: they change at once, so the first sample may be touch already; `"none"`: one sample per
            tap, or samples that change from the first to the second nearly as much as ever.
        class_change: Squared change of the class means since the first sample, freed of noise, over its largest value,
            shape (J,).
        change: Root mean square change of single taps since the first sample, over its largest value, shape (J,).
    """

    samples: int
    kind: Leading
    class_change: NDArray[np.float64]
    change: NDArray[np.float64]


class Leakage(NamedTuple):
    """What can be told without touch, and whether that explains what whole taps tell.

    Attributes:
        told: Dims (source, quantity): `accuracy`, `low`, `high` after one tap, `classifier`, and of sources without
            touch the `share` of the accuracy of whole taps above chance, with `share_low` and `share_high`; dim
            quantity: `chance`, and `lost`, `lost_low`, `lost_high`: accuracy that taring costs. NaN where a source is
            not there.
        lead: The samples before contact.
        blocks: Whether classes were recorded in blocks, by side and session, then by quantity.
        explains: Whether leakage explains the accuracy of each quantity.
        sentences: The same in words, the gravest first.
        test_taps: On how many taps accuracies rest.
    """

    told: xr.Dataset
    lead: Lead
    blocks: dict[str, dict[str, bool]]
    explains: dict[str, Verdict]
    sentences: tuple[str, ...]
    test_taps: int

    @property
    def explained(self) -> tuple[str, ...]:
        """The quantities whose accuracy leakage explains, wholly or mostly."""
        return tuple(name for name, verdict in self.explains.items() if verdict in ("yes", "mostly"))


def leakage(train: TapSet, test: TapSet, grid: ClassGrid, seed: int = 0) -> Leakage:
    """What one tap tells without touch, beside what it tells with.

    Leakage explains a quantity where the samples before contact, or the offsets, tell nearly as much above chance as
    whole taps: `"yes"` where the interval of that share begins at three quarters or above, `"mostly"` at a half or
    above, `"partly"` where it begins above zero, else `"no"`, or `"not enough data"` where the interval leaves
    both open. Two things that tell classes before contact are touch all the same. A high-pass forgets slow drift
    and keeps, for its memory, the former taps of the class in the samples before contact: `"former taps"`.
    Where the first sample alone is before contact, if that, and classes were not recorded in blocks, there is no drift
    to tell them: `"touch already"`.

    Args:
        train: Training taps; the extra array `offset` (tap, taxel) is used where both sets have it.
        test: Test taps, in the best case of other sessions.
        grid: The classes.
        seed: Of the resamples.

    Raises:
        InputError: The sets do not fit together, or no test tap belongs to a trained class.
    """
    check_compatible(train, test)
    train, test = _inside(train, grid), _inside(test, grid)
    where, what = train.indices(grid)
    trained = np.unique(where * grid.M + what)
    known = np.isin(np.ravel_multi_index(test.indices(grid), grid.shape), trained)
    if not known.any():
        raise InputError("No test tap belongs to a class with a training tap.")
    test = test.select(known)
    lead = leading_samples(train.taps, where * grid.M + what)
    quantities = _quantities(grid)
    correct = {
        source: _correct(*pair, grid, quantities) for source, pair in _sources(train, test, lead).items() if pair
    }
    cell = np.ravel_multi_index(test.indices(grid), grid.shape)
    chance = {name: _chance(test, grid, name, len(trained)) for name in quantities}
    told = _told(correct, chance, cell, seeds.generator(seed, seeds.Purpose.LEAKAGE))
    former = _former_taps(train)
    blocks = _blocks(train, test, grid, quantities)
    explains: dict[str, Verdict] = {
        name: _verdict(told, name, former, _may_drift(lead, blocks, name), len(test)) for name in quantities
    }
    sentences = tuple(_sentences(told, lead, blocks, explains, train, former))
    return Leakage(told, lead, blocks, explains, sentences, len(test))


def leading_samples(taps: NDArray[np.floating], cell: NDArray[np.intp]) -> Lead:
    """How many samples at the beginning of taps are free of contact, as far as the samples themselves tell.

    Touch is what differs between classes. So of each class the mean change since the first sample is taken, squared,
    freed of its expected share of noise, and averaged over classes and taxels: before contact it stays at zero however
    noisy the sensor. The leading samples are those before this exceeds 3 % of its largest value (as an amplitude), less
    a fifth, since contact begins before that, and at least the first one. Where samples change by 30 % of their largest
    change already from the first to the second, as in taps that begin in contact or whose samples are exchangeable,
    there are none.

    Args:
        taps: Shape (N, J, K).
        cell: Class of each tap, shape (N,). Classes of one tap are left out unless there are no others; then noise
            counts as change, and the stretch is found too short.
    """
    J = taps.shape[1]
    change = np.asarray(taps, dtype=np.float64) - taps[:, :1]
    single = np.sqrt((change**2).mean(axis=(0, 2)))
    if J == 1 or not single.any():
        return Lead(0, "none", np.zeros(J), np.zeros(J))
    single = single / single.max()
    between = _between_classes(change, cell)
    between = between / between.max() if between.max() > 0 else single**2
    if single[1] > _UNREST:
        return Lead(0, "none", between, single)
    moved = (between > _STILL) | (single > _UNREST)
    samples = int(np.ceil(_SURE * (np.argmax(moved) if moved.any() else J)))
    return Lead(samples, "stretch" if samples > 1 else "first sample", between, single)


def _between_classes(change: NDArray[np.float64], cell: NDArray[np.intp]) -> NDArray[np.float64]:
    """Mean square over classes and taxels of their mean change, without the share of noise in it, shape (J,)."""
    index = np.unique(cell, return_inverse=True)[1]
    count = np.bincount(index)
    mean = sum_by(index, change, len(count)) / count[:, None, None]
    repeated = count > 1
    if not repeated.any():
        return (mean**2).mean(axis=(0, 2))
    square = sum_by(index, (change - mean[index]) ** 2, len(count))[repeated]
    n = count[repeated][:, None, None]
    return (mean[repeated] ** 2 - square / (n * (n - 1))).mean(axis=(0, 2))


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


def _sources(train: TapSet, test: TapSet, lead: Lead) -> dict[str, tuple[TapSet, TapSet] | None]:
    """Training and test taps of each source, nothing where there are none."""

    def both(samples: Mapping[str, NDArray[np.floating]]) -> tuple[TapSet, TapSet]:
        return with_samples(train, samples["train"]), with_samples(test, samples["test"])

    sets = {"train": train, "test": test}
    n = lead.samples
    has_offset = all(
        "offset" in taps.dataset and taps.dataset["offset"].dims == ("tap", "taxel") for taps in (train, test)
    )
    return {
        BEFORE: both({side: taps.taps[:, :n] for side, taps in sets.items()}) if n else None,
        OFFSET: both({side: taps.dataset["offset"].values[:, np.newaxis] for side, taps in sets.items()})
        if has_offset
        else None,
        WHOLE: (train, test),
        TARED: both({side: taps.taps - taps.taps[:, :n].mean(axis=1, keepdims=True) for side, taps in sets.items()})
        if n
        else None,
    }


def with_samples(taps: TapSet, samples: NDArray[np.floating]) -> TapSet:
    """Taps of the same labels with other samples, shape (N, any number, K)."""
    J = samples.shape[1]
    # What started a tap says nothing of a part of it.
    record = replace(taps.preprocessing, samples=J, pre_samples=0)
    dataset = taps.dataset.drop_dims("sample").assign(taps=(("tap", "sample", "taxel"), samples))
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
        log_belief = model.log_likelihood(test.taps) + model.log_prior
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
    z = float(norm.ppf(0.5 + CONFIDENCE / 2))
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


def _former_taps(taps: TapSet) -> float:
    """Seconds for which a high-pass remembers; 0 where there is none, or it remembers half a session or more.

    Such a filter forgets the slow drift that would tell blocks of classes apart, and keeps what was just touched.
    """
    record = taps.preprocessing
    if not record.highpass_hz or not record.rate_hz:
        return 0.0
    memory = _SETTLED / (2 * np.pi * record.highpass_hz)
    session = len(taps) / len(np.unique(taps.session)) * record.samples / record.rate_hz
    return float(memory) if memory < session / 2 else 0.0


def _verdict(told: xr.Dataset, name: str, former: float, drift: bool, test_taps: int) -> Verdict:
    at = told.sel(quantity=name)
    if test_taps < _FEWEST:
        return "not enough data"
    if not float(at["low"].sel(source=WHOLE)) > float(at["chance"]):
        return "nothing to explain"
    order: tuple[Verdict, ...] = ("yes", "mostly", "partly", "not enough data", "former taps", "touch already", "no")
    found = {_of_source(at.sel(source=source), source, former, drift) for source in (BEFORE, OFFSET)}
    return next(verdict for verdict in order if verdict in found)


def _of_source(at: xr.Dataset, source: str, former: float, drift: bool) -> Verdict:
    if np.isnan(at["share"]):
        return "no"
    low, high = float(at["share_low"]), float(at["share_high"])
    if not (float(at["low"]) > float(at["chance"]) and low > 0):
        return "no" if high < _HALF else "not enough data"
    if source == BEFORE and former:
        return "former taps"
    if source == BEFORE and not drift:
        return "touch already"
    return "yes" if low >= _MOST else "mostly" if low >= _HALF else "partly"


def _may_drift(lead: Lead, blocks: dict[str, dict[str, bool]], name: str) -> bool:
    """Whether what tells classes before contact can be something else than the beginning of touch.

    Where not even two samples are seen to be free of contact, only classes recorded in blocks speak for drift.
    """
    own = ("what", "where", "joint") if name == "joint" else (name,)
    return lead.kind == "stretch" or any(of.get(part, False) for of in blocks.values() for part in own)


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


def _sentences(
    told: xr.Dataset,
    lead: Lead,
    blocks: dict[str, dict[str, bool]],
    explains: dict[str, Verdict],
    train: TapSet,
    former: float,
) -> Iterator[str]:
    if np.isnan(told["accuracy"].sel(source=[BEFORE, OFFSET])).all():
        yield "There is nothing to tell classes from without touch: no samples before contact, and no offsets."
    else:
        for verdict in _GRAVEST_FIRST:
            names = [name for name in explains if explains[name] == verdict]
            if verdict == "former taps" and names:
                yield _of_former_taps(told, names, lead, former)
            elif names:
                yield from (_finding(told, name, verdict, lead) for name in names)
            if verdict in ("yes", "mostly", "former taps"):
                known = [name for name in names if not np.isnan(told["lost"].sel(quantity=name))]
                yield from (_tared(told.sel(quantity=name), lead) for name in known)
    yield _lead_sentence(lead, train)
    yield from _block_sentences(blocks)


def _of_former_taps(told: xr.Dataset, names: list[str], lead: Lead, former: float) -> str:
    numbers = "; ".join(f"the {_OBJECTS[name]} {_compared(told.sel(quantity=name), [BEFORE], lead)}" for name in names)
    return (
        f"Samples before contact tell classes, but not without touch ({numbers}): the high-pass remembers {former:.1f} "
        "s, so they hold the former taps, which were of the same class or of its neighbour. A tap "
        "then tells part of what several tell, and less after a move."
    )


def _compared(at: xr.Dataset, there: list[str], lead: Lead) -> str:
    """Accuracies of sources without touch, of whole taps and by chance."""
    before = "the first sample" if lead.samples == 1 else f"the first {lead.samples} samples"
    names = {BEFORE: before, OFFSET: "the offsets that were subtracted"}
    told_by = " and ".join(f"{_number(at, source)} from {names[source]}" for source in there)
    return f"{told_by}, {_number(at, WHOLE)} from whole taps, chance {float(at['chance']):.2f}"


def _finding(told: xr.Dataset, name: str, verdict: Verdict, lead: Lead) -> str:
    at, what = told.sel(quantity=name), _OBJECTS[name]
    there = [source for source in (BEFORE, OFFSET) if not np.isnan(at["accuracy"].sel(source=source))]
    numbers = _compared(at, there, lead)
    share = at["share"].fillna(-np.inf)
    best = there[int(np.argmax([float(share.sel(source=source)) for source in there]))]
    part = f"{float(at['share'].sel(source=best)):.0%} ({_span(at, best)})"
    match verdict:
        case "yes":
            return (
                f"Without touch the {what} is told as well as with it, or nearly ({numbers}): {part} of what whole "
                f"taps tell above chance. The accuracy of the {what} on these taps is no evidence of touch."
            )
        case "mostly" | "partly":
            return (
                f"Without touch the {what} is {verdict} told ({numbers}): {part} of what whole taps tell above chance."
            )
        case "touch already":
            return (
                f"The first sample tells the {what} ({numbers}), but classes were not recorded in blocks, so that no "
                "drift tells them: touch has begun by then."
            )
        case "nothing to explain":
            return f"Whole taps tell the {what} no better than chance ({numbers}), so there is nothing to explain."
        case "not enough data":
            return f"There are not enough test taps to say whether the {what} is told without touch ({numbers})."
        case _:
            return f"The {what} is not told without touch ({numbers})."


def _number(at: xr.Dataset, source: str) -> str:
    row = at.sel(source=source)
    return f"{float(row['accuracy']):.2f} ({float(row['low']):.2f} to {float(row['high']):.2f})"


def _span(at: xr.Dataset, source: str) -> str:
    row = at.sel(source=source)
    return f"{float(row['share_low']):.0%} to {float(row['share_high']):.0%}"


def _tared(at: xr.Dataset, lead: Lead) -> str:
    low, high = float(at["lost_low"]), float(at["lost_high"])
    name, numbers = _OBJECTS[str(at["quantity"].values)], f"{_number(at, TARED)} against {_number(at, WHOLE)}"
    before = "the first sample" if lead.samples == 1 else f"the mean of the first {lead.samples} samples"
    beginning = f"With {before} of each tap subtracted, whole taps tell the {name} "
    if low > 0:
        return f"{beginning}less well ({numbers}; {low:.2f} to {high:.2f} lost): part of it hung on the level before."
    return f"{beginning}about as well ({numbers}), so it does not hang on the level before alone."


def _lead_sentence(lead: Lead, train: TapSet) -> str:
    if lead.kind == "stretch":
        return f"Taps begin before contact: classes do not part in the first {lead.samples} samples."
    if lead.kind == "first sample":
        return (
            "Whether taps begin before contact cannot be seen: classes part from the second sample on, so the first "
            "one stands for what comes before contact and may be touch already."
        )
    if train.taps.shape[1] == 1:
        return "There is one sample per tap, so nothing before contact."
    return (
        "There are no samples free of contact: samples change from the first to the second by "
        f"{lead.change[1]:.0%} of what they change at most."
    )


def _block_sentences(blocks: dict[str, dict[str, bool]]) -> Iterator[str]:
    names = {"what": "object", "where": "position", "joint": "(where, what) cell"}
    quantities = list(next(iter(blocks.values())))
    found = {name: [side for side, of in blocks.items() if of[name]] for name in quantities}
    for name, sides in found.items():
        if sides:
            yield f"Recorded in blocks: in {', '.join(sides)} the taps of each {names[name]} follow one another."
    if not any(found.values()):
        yield "Classes were not recorded in blocks."
