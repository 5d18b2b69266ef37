"""Variation of gain and offset between taps and sessions, and the effective number of taps in a sequence.

Every tap is laid over the mean tap of its class: its deviation is regressed on what the mean tap does after its first
sample, and on a constant. The slope is the gain of the tap, less 1, and the constant its offset. What noise adds to
them is seen from the scatter over taxels, whose noise is independent; noise common to all taxels is an offset that
differs between taps. `models/measurement/gain_variance.py` says how gains and offsets come about, and has the
posterior.

Taps of one class in one session share what the session does to the sensor and how the object was mounted. The more of
the variance of gains that is, the less more taps help: n taps have as much to say about the gain as
`n / (1 + (n - 1) rho)` taps of as many sessions, where `rho`, the intraclass correlation, is the share of the session
and the mounting in the variance between taps without the noise of single taxels.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ....models.blocks import ScaledSamples
from ....models.errors import InputError
from ....models.measurement.fits.priors import Taps
from ....models.measurement.gain_variance import COMPONENTS, GainCells, GainPosterior, gain_posteriors
from ....models.measurement.scaling import class_sums, sum_by
from ...page.numbers import spanned

QUANTITIES = ("gain", "offset")
PROBABILITY = 0.9
"""Of the intervals."""
_ENDS = ("mean", "low", "high")
SEQUENCES = (1, 2, 5, 10, 20, 50)
"""Lengths of sequences whose effective number of taps is given."""

MOST_CLASSES = 150
"""Of more classes than these, as many evenly chosen ones are used: they tell enough."""
MOST_SESSIONS = 50
"""Likewise of sessions; time grows with the cube of their number."""
_FLAT = 10.0  # variance of a mean tap over that of its noise, below which its slope says little of a gain
_SPREAD = 1e-9  # of its square: a mean tap that varies less is constant


class TapGains(NamedTuple):
    """Gain and offset of every tap against the mean tap of its class.

    Attributes:
        value: Gain less 1, and offset in the unit of the samples, shape (2, N); NaN in a class that is left out.
        error: Variance of what noise of single taxels adds to `value`, the same for all taps of a session and class,
            shape (2, N).
        amplitude: Root mean square change of the mean taps since their first sample, in the unit of the samples.
        used: Which classes have a mean tap that stands out of the noise, shape (C,).
        separable: Whether gain and offset can be told apart at all.
        scatter: Whether there is more than one taxel to see noise by.
    """

    value: NDArray[np.float64]
    error: NDArray[np.float64]
    amplitude: float
    used: NDArray[np.bool_]
    separable: bool
    scatter: bool


class Components(NamedTuple):
    """Variance components of gain and offset.

    Attributes:
        summary: Dims (quantity, component): `mean`, `low` and `high` of standard deviations, offsets in the unit of the
            samples; NaN for what cannot be told.
        rho: Dim quantity: `mean`, `low` and `high` of the intraclass correlation.
        effective: Dim n: `mean`, `low` and `high` of the effective number of independent taps of n, for the gain.
        converged: Whether the integrals over standard deviations did.
        sentences: The same in words.
    """

    summary: xr.Dataset
    rho: xr.Dataset
    effective: xr.Dataset
    converged: bool
    sentences: tuple[str, ...]


def effective_taps(n: ArrayLike, rho: ArrayLike) -> NDArray[np.float64]:
    """Independent taps that n taps of one session and class are worth, `n / (1 + (n - 1) rho)`; broadcast."""
    n = np.asarray(n, dtype=np.float64)
    return n / (1 + (n - 1) * np.asarray(rho))


def variance_components(
    taps: NDArray[np.floating] | ScaledSamples,
    own: NDArray[np.integer],
    session: NDArray[np.integer],
) -> Components:
    """How much gains and offsets of taps differ between sessions, classes of a session, and taps.

    Half-normal priors of scale 0.2 for standard deviations of gains, and of 0.2 times the amplitude of the mean taps
    for those of offsets. With two sessions the intervals are wide, with one only the tap can be told.

    Args:
        taps: Shape (N, J, K); those of a large recording are read in blocks.
        own: Class of each tap, shape (N,), any numbers.
        session: Session of each tap, shape (N,).

    Raises:
        InputError: The arrays do not fit together, or hold no tap.
    """
    samples: Any = taps if isinstance(taps, ScaledSamples) else np.asarray(taps)
    own, session = np.asarray(own), np.asarray(session)
    if len(samples.shape) != 3 or not len(samples) or not own.shape == session.shape == (len(samples),):
        raise InputError(
            "Variance components need taps of shape (N, J, K) with a class and a session each, got shapes "
            f"{samples.shape}, {own.shape} and {session.shape}."
        )
    all_classes, all_sessions = len(np.unique(own)), len(np.unique(session))
    kept = _evenly(session, MOST_SESSIONS)
    kept[kept] = _evenly(own[kept], MOST_CLASSES)
    if not kept.all():
        samples = samples.chosen(kept) if isinstance(samples, ScaledSamples) else samples[kept]
        own, session = own[kept], session[kept]
    gains = tap_gains(samples, own, session)
    if not gains.separable:
        return _untold(gains)
    cells = collapse(gains, own, session)
    components = _summarise(gain_posteriors(cells), cells, gains)
    if kept.all():
        return components
    used = {"classes": (len(gains.used), all_classes), "sessions": (len(np.unique(session)), all_sessions)}
    parts = " and ".join(f"{some} of {all_} {name}" for name, (some, all_) in used.items() if some < all_)
    chosen = f"Variance components were estimated from {parts}."
    return components._replace(sentences=(chosen, *components.sentences))


def _evenly(values: NDArray[np.integer], most: int) -> NDArray[np.bool_]:
    """Which values are among so many different ones, evenly chosen, or among all."""
    known = np.unique(values)
    return np.isin(values, known[np.linspace(0, len(known) - 1, min(most, len(known))).round().astype(np.intp)])


def tap_gains(
    taps: NDArray[np.floating] | ScaledSamples, own: NDArray[np.integer], session: NDArray[np.integer]
) -> TapGains:
    """Gain and offset of every tap against the mean tap of its class, by least squares.

    The mean tap of a class is the mean over sessions of its means in them. The errors come from how taps differ from
    the mean of their session and class, by a sandwich over taxels with the leverage of each taken out once, so that
    they are right on average for alike taxels, however few carry the signal.

    Args:
        taps: Shape (N, J, K).
        own: Class of each tap, shape (N,).
        session: Session of each tap, shape (N,).
    """
    samples: Any = taps if isinstance(taps, ScaledSamples) else np.asarray(taps, dtype=np.float64)
    _, J, K = samples.shape
    classes, cell, of_cell = _cells(own, session)
    count = np.bincount(cell)
    parts = Taps(samples, cell, np.zeros_like(cell), (len(count), 1))
    cell_mean = class_sums(parts, lambda block, _: block)[:, 0] / count[:, None, None]
    sessions = np.bincount(of_cell)
    template = sum_by(of_cell, cell_mean, len(sessions)) / sessions[:, None, None]
    signal = template - template[:, :1] if J > 1 else template
    centred = signal - signal.mean(axis=(1, 2), keepdims=True)
    spread = (centred**2).sum(axis=(1, 2))
    varies = spread > _SPREAD * (template**2).sum(axis=(1, 2))

    def of_block(block: NDArray[np.float64], which: slice) -> NDArray[np.float64]:
        """Mean square of what nothing explains, gain and offset, and their scatter over taxels, shape (n, 5)."""
        index, found = classes[which], np.full((len(block), 5), np.nan)
        within, chosen = block - cell_mean[cell[which]], varies[index]
        found[:, 0] = (_rest(within, signal[index], chosen) ** 2).mean(axis=(1, 2))
        if chosen.any():
            index, block = index[chosen], block[chosen]
            deviation = block - template[index]
            single = count[cell[which][chosen]] == 1
            scatter = np.where(single[:, None, None], deviation, within[chosen])
            found[chosen, 1:3], found[chosen, 3:] = _regress(deviation, signal[index]), _scatter(scatter, signal[index])
        return found

    square, *value, gain, offset = np.concatenate(list(parts.over_blocks(of_block))).T
    noise = _noise_of_template(square, classes, cell, count) * (2 if J > 1 else 1)
    used = varies & (spread > _FLAT * J * K * noise)
    amplitude = float(np.sqrt((signal[used] ** 2).mean())) if used.any() else 0.0
    chosen = used[classes]
    value, error = np.where(chosen, value, np.nan), np.full((2, len(cell)), np.nan)
    if chosen.any():
        single = count[cell[chosen]] == 1
        freedom = np.where(single, 1.0, 1 - 1 / count[cell[chosen]])
        scatter = np.stack([gain, offset])[:, chosen] / freedom
        error[:, chosen] = _pooled(scatter, cell[chosen], classes[chosen], single)
    return TapGains(value, error, amplitude, used, bool(used.any()), K > 1)


def _cells(
    own: NDArray[np.integer], session: NDArray[np.integer]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Class and cell of each tap, shapes (N,), and class of each cell, all counted from 0."""
    classes = np.unique(own, return_inverse=True)[1]
    sessions = np.unique(session, return_inverse=True)[1]
    present, cell = np.unique(classes * (sessions.max() + 1) + sessions, return_inverse=True)
    return classes, cell, present // (sessions.max() + 1)


def _rest(
    deviation: NDArray[np.float64], signal: NDArray[np.float64], varies: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """What no gain and offset explains of the taps whose signal varies, shape (N, J, K)."""
    rest = deviation.copy()
    if varies.any():
        slope, intercept = _regress(deviation[varies], signal[varies]).T[..., None, None]
        rest[varies] -= slope * signal[varies] + intercept
    return rest


def _noise_of_template(
    rest: NDArray[np.float64], classes: NDArray[np.intp], cell: NDArray[np.intp], count: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Variance of a sample of each class's mean tap, shape (C,), from the mean square of what is left of each tap.

    0 where no two taps of a cell show it.
    """
    square = np.bincount(classes, weights=rest)
    freedom = np.bincount(classes, weights=1 - 1 / count[cell])
    return square / np.maximum(freedom, 1e-9) / np.bincount(classes)


def _normal_matrix(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over time of products of the signal and a constant at each taxel, shape (N, K, 2, 2)."""
    ones = np.broadcast_to(float(signal.shape[1]), signal.sum(axis=1).shape)
    cross = signal.sum(axis=1)
    return np.stack([np.stack([(signal**2).sum(axis=1), cross], -1), np.stack([cross, ones], -1)], -2)


def _regress(deviation: NDArray[np.float64], signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slope and intercept of each tap's deviation on its signal, both of shape (N, J, K); shape (N, 2)."""
    right = np.stack([(signal * deviation).sum(axis=(1, 2)), deviation.sum(axis=(1, 2))], -1)
    return np.linalg.solve(_normal_matrix(signal).sum(axis=1), right[..., None])[..., 0]


def _scatter(deviation: NDArray[np.float64], signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance of slope and intercept by the scatter over taxels, shape (N, 2); 0 where there is one taxel."""
    by_taxel = _normal_matrix(signal)
    total = by_taxel.sum(axis=1)
    slope, intercept = _regress(deviation, signal).T[..., None, None]
    residual = deviation - slope * signal - intercept
    score = np.stack([(signal * residual).sum(axis=1), residual.sum(axis=1)], -1)
    rest = total[:, None] - by_taxel
    known = np.linalg.det(rest) > _SPREAD * np.linalg.det(total)[:, None]
    rest = np.where(known[..., None, None], rest, np.eye(2))
    plain = np.linalg.solve(total[:, None], score[..., None])[..., 0]
    left_out = np.linalg.solve(rest, score[..., None])[..., 0]
    return np.maximum((plain * left_out * known[..., None]).sum(axis=1), 0.0)


def _pooled(
    error: NDArray[np.float64], cell: NDArray[np.intp], classes: NDArray[np.intp], single: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Means over the taps of a cell; cells of one tap take those of the others of their class, shape (2, N)."""

    def mean_by(group: NDArray[np.intp], weight: NDArray[np.float64]) -> NDArray[np.float64]:
        total = np.bincount(group, weights=weight)
        sums = np.stack([np.bincount(group, weights=weight * values) for values in error])
        return np.where(total > 0, sums / np.maximum(total, 1), np.nan)[:, group]

    repeated = mean_by(classes, (~single).astype(np.float64))
    own = mean_by(cell, np.ones(len(cell)))
    return np.where(single & np.isfinite(repeated), repeated, own)


def collapse(gains: TapGains, own: NDArray[np.integer], session: NDArray[np.integer]) -> GainCells:
    """Cell means and sums of squares of the classes that are used; offsets in units of the amplitude.

    Args:
        gains: Of all taps.
        own: Class of each tap, shape (N,).
        session: Session of each tap, shape (N,).
    """
    chosen = np.isfinite(gains.value[0])
    classes = np.unique(own[chosen], return_inverse=True)[1]
    sessions = np.unique(session, return_inverse=True)[1]
    shape = int(sessions.max()) + 1, int(classes.max()) + 1
    cell = np.ravel_multi_index((sessions[chosen], classes), shape)
    unit = np.array([1.0, gains.amplitude])[:, None]
    value, error = gains.value[:, chosen] / unit, gains.error[:, chosen] / unit**2
    count = np.bincount(cell, minlength=shape[0] * shape[1])

    def totals(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.bincount(cell, weights=row, minlength=len(count)) for row in values])

    mean = totals(value) / np.maximum(count, 1)
    square = totals((value - mean[:, cell]) ** 2)
    least = (1e-6) ** 2  # a variance of exactly 0 would make the density of a tap infinite
    known = np.maximum(totals(error) / np.maximum(count, 1), least)
    by_cell = (-1, *shape)
    return GainCells(
        count.reshape(shape), mean.reshape(by_cell), np.maximum(square, least).reshape(by_cell), known.reshape(by_cell)
    )


def _summarise(posteriors: list[GainPosterior], cells: GainCells, gains: TapGains) -> Components:
    n = np.array(SEQUENCES)
    sds = np.full((len(QUANTITIES), len(COMPONENTS), len(_ENDS)), np.nan)
    rhos, worth = np.full((len(QUANTITIES), len(_ENDS)), np.nan), np.full((len(n), len(_ENDS)), np.nan)
    for quantity, (of, unit) in enumerate(zip(posteriors, (1.0, gains.amplitude), strict=True)):
        for component, told in enumerate(cells.told):
            if told:
                sds[quantity, component] = _interval(unit * of.sd[component], of.marginal(component))
        if all(cells.told):
            session, mounting, tap = np.ix_(*(sd**2 for sd in of.sd))
            shared = session + mounting
            rho = (shared / np.maximum(shared + tap, np.finfo(float).tiny)).ravel()
            rhos[quantity] = _interval(rho, of.weight.ravel())
            if QUANTITIES[quantity] == "gain":
                _, most, fewest = effective_taps(n[:, None], rhos[quantity]).T
                worth = np.stack([effective_taps(n[:, None], rho) @ of.weight.ravel(), fewest, most], axis=-1)
    coords = {"quantity": list(QUANTITIES), "component": list(COMPONENTS), "n": n}
    summary, share, effective = (
        xr.DataArray(values, {dim: coords[dim] for dim in dims}, [*dims, "end"])
        .assign_coords(end=list(_ENDS))
        .to_dataset("end")
        for values, dims in ((sds, ("quantity", "component")), (rhos, ("quantity",)), (worth, ("n",)))
    )
    converged = all(of.converged for of in posteriors)
    sentences = tuple(_sentences(summary, share, effective, cells, gains))
    if not converged:
        sentences += ("The integrals over standard deviations did not converge, so the intervals are unreliable.",)
    return Components(summary, share, effective, converged, sentences)


def _interval(values: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean and ends of the central interval of values with probabilities."""
    order = values.argsort()
    below = weight[order].cumsum() - weight[order] / 2
    ends = np.interp([(1 - PROBABILITY) / 2, (1 + PROBABILITY) / 2], below, values[order])
    return np.array([values @ weight, *ends])


def _sentences(
    summary: xr.Dataset, rho: xr.Dataset, effective: xr.Dataset, cells: GainCells, gains: TapGains
) -> Iterator[str]:
    told: dict[str, bool] = dict(zip(COMPONENTS, cells.told, strict=True))
    R = int((cells.taps > 0).any(axis=1).sum())
    left_out = int((~gains.used).sum())
    if left_out:
        yield f"{left_out} of {len(gains.used)} classes were left out because their mean tap does not exceed the noise."
    if not gains.scatter:
        yield "With one taxel, noise cannot be separated from differences between taps."
    if R == 1:
        yield "With one session, differences between sessions cannot be estimated."
    elif not told["session"]:
        yield "Differences between sessions cannot be estimated: fewer than two classes have taps in several sessions."
    if not told["tap"]:
        yield "Differences between taps cannot be separated from mounting: no class has two taps in one session."
    for quantity, of, unit in (("gain", "gain", "%"), ("offset", "offset (unit of the samples)", "")):
        row, factor = summary.sel(quantity=quantity), 100.0 if unit else 1.0
        parts = [
            f"{label} {_range(row.sel(component=name), factor, unit)}"
            for name, label in (
                ("session", "between sessions"),
                ("mounting", "between classes of a session"),
                ("tap", "between taps"),
            )
            if told[name]
        ]
        if parts:
            yield f"Standard deviation of the {of}: {', '.join(parts)}."
    if all(told.values()):
        yield (
            f"The taps of a class in one session share {_range(rho.sel(quantity='gain'), 100.0, '%')} of the variance "
            f"of the gain, so 20 taps are worth {_range(effective.sel(n=20), 1.0, '')} independent ones."
        )
    if told["session"] and R == 2:
        yield "With two sessions, the interval of the variance between sessions is wide."


def _range(row: xr.Dataset, factor: float, unit: str) -> str:
    mean, low, high = (float(row[name]) * factor for name in ("mean", "low", "high"))
    return spanned(mean, low, high, unit)


def _untold(gains: TapGains) -> Components:
    coords = {"quantity": list(QUANTITIES), "component": list(COMPONENTS)}
    nothing = np.full((len(QUANTITIES), len(COMPONENTS)), np.nan)
    lost = np.full(len(SEQUENCES), np.nan)
    summary = xr.Dataset(dict.fromkeys(_ENDS, (("quantity", "component"), nothing)), coords)
    rho = xr.Dataset(dict.fromkeys(_ENDS, ("quantity", nothing[:, 0])), {"quantity": list(QUANTITIES)})
    effective = xr.Dataset(dict.fromkeys(_ENDS, ("n", lost)), {"n": list(SEQUENCES)})
    sentence = (
        f"Variance components cannot be estimated: none of {len(gains.used)} mean taps varies enough, relative to its "
        "noise, to separate a gain from an offset."
    )
    return Components(summary, rho, effective, True, (sentence,))
