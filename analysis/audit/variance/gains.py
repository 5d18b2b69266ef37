"""Variation of gain and offset between taps and sessions, and the effective number of taps in a sequence.

Every tap is laid over the mean tap of its class: its deviation is regressed on what the mean tap does after its first
sample, and on a constant. The slope is the gain of the tap, less 1, and the constant its offset. What noise adds to
them is seen from the scatter over taxels, whose noise is independent; noise common to all taxels is an offset that
differs between taps. `models/measurement/gain_variance.py` says how gains and offsets come about; its posterior is
sampled by NUTS.

Taps of one class in one session share what the session does to the sensor and how the object was mounted. The more of
the variance of gains that is, the less more taps help: n taps have as much to say about the gain as
`n / (1 + (n - 1) rho)` taps of as many sessions, where `rho`, the intraclass correlation, is the share of the session
and the mounting in the variance between taps without the noise of single taxels.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ....models.blocks import ScaledSamples
from ....models.errors import InputError
from ....models.measurement.fits.priors import Taps
from ....models.measurement.scaling import class_sums, sum_by
from ....models.seeds import Purpose, derived_seed
from ....models.threads import one_blas_thread
from ...page.numbers import spanned

if TYPE_CHECKING:
    from ....models.measurement.gain_variance import GainCells

QUANTITIES = ("gain", "offset")
PROBABILITY = 0.9
"""Of the intervals."""
SEQUENCES = (1, 2, 5, 10, 20, 50)
"""Lengths of sequences whose effective number of taps is given."""

MOST_CLASSES = 150
"""Of more classes than these, as many evenly chosen ones are sampled from: they tell enough, and it takes seconds."""
CHAINS, WARM_UP, DRAWS = 4, 300, 500
_ACCEPT = 0.9
_R_HAT, _ESS = 1.03, 200.0
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
        data: ArviZ tree with the groups `posterior` (standard deviations by quantity, offsets in the unit of the
            samples, and `rho`) and `sample_stats`; `None` where nothing can be told.
        summary: Dims (quantity, component): `mean`, `low` and `high` of standard deviations, `r_hat`, `ess_bulk` and
            `ess_tail`; NaN for what cannot be told.
        rho: Dim quantity: `mean`, `low` and `high` of the intraclass correlation.
        effective: Dim n: `mean`, `low` and `high` of the effective number of independent taps of n, for the gain.
        converged: Whether the chains did.
        sentences: The same in words.
    """

    data: xr.DataTree | None
    summary: xr.Dataset
    rho: xr.Dataset
    effective: xr.Dataset
    converged: bool
    sentences: tuple[str, ...]


def effective_taps(n: ArrayLike, rho: ArrayLike) -> NDArray[np.float64]:
    """Independent taps that n taps of one session and class are worth, `n / (1 + (n - 1) rho)`; broadcast."""
    n = np.asarray(n, dtype=np.float64)
    return n / (1 + (n - 1) * np.asarray(rho))


def import_samplers() -> None:
    """Imports what `variance_components` needs, before it runs beside other threads.

    SciPy looks into a JAX that is there, and fails if another thread has imported half of it.
    """
    import numpyro.infer  # noqa: F401, PLC0415 - as in `_sample`

    from ....models.measurement import gain_variance  # noqa: F401, PLC0415


def variance_components(
    taps: NDArray[np.floating] | ScaledSamples,
    own: NDArray[np.integer],
    session: NDArray[np.integer],
    seed: int = 0,
) -> Components:
    """How much gains and offsets of taps differ between sessions, classes of a session, and taps.

    Half-normal priors of scale 0.2 for standard deviations of gains, and of 0.2 times the amplitude of the mean taps
    for those of offsets. With two sessions the intervals are wide, with one only the tap can be told.

    Args:
        taps: Shape (N, J, K); those of a large recording are read in blocks.
        own: Class of each tap, shape (N,), any numbers.
        session: Session of each tap, shape (N,).
        seed: Of the chains.

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
    classes = np.unique(own)
    all_classes = len(classes)
    if all_classes > MOST_CLASSES:
        kept = np.isin(own, classes[np.linspace(0, all_classes - 1, MOST_CLASSES).round().astype(np.intp)])
        samples = samples.chosen(kept) if isinstance(samples, ScaledSamples) else samples[kept]
        own, session = own[kept], session[kept]
    gains = tap_gains(samples, own, session)
    if not gains.separable:
        return _untold(gains)
    cells = collapse(gains, own, session)
    data = _sample(cells, gains.amplitude, seed)
    components = _summarise(data, cells, gains)
    if all_classes == len(gains.used):
        return components
    chosen = f"Variance components were estimated from {len(gains.used)} of {all_classes} classes."
    return components._replace(sentences=(chosen, *components.sentences))


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


def collapse(gains: TapGains, own: NDArray[np.integer], session: NDArray[np.integer]) -> "GainCells":
    """Cell means and sums of squares of the classes that are used; offsets in units of the amplitude.

    Args:
        gains: Of all taps.
        own: Class of each tap, shape (N,).
        session: Session of each tap, shape (N,).
    """
    from ....models.measurement.gain_variance import GainCells  # noqa: PLC0415 - NumPyro takes seconds to import

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


def _sample(cells: "GainCells", amplitude: float, seed: int) -> xr.DataTree:
    import arviz as az  # noqa: PLC0415 - as are JAX and NumPyro, slow to import
    import jax  # noqa: PLC0415
    from numpyro.infer import MCMC, NUTS  # noqa: PLC0415
    from numpyro.infer.util import potential_energy  # noqa: PLC0415

    from ....models.measurement.gain_variance import COMPONENTS, components  # noqa: PLC0415

    @jax.jit  # as a whole: JAX would compile the story operation by operation, which takes longer than the chains
    def potential(log_sd: dict[str, Any]) -> Any:
        return potential_energy(components, (cells,), {}, log_sd)

    start = {name: np.full((CHAINS, len(QUANTITIES)), np.log(0.03)) for name in COMPONENTS}
    with jax.enable_x64(True), one_blas_thread():
        sampler = MCMC(
            NUTS(potential_fn=potential, target_accept_prob=_ACCEPT),
            num_warmup=WARM_UP,
            num_samples=DRAWS,
            num_chains=CHAINS,
            chain_method="vectorized",
            progress_bar=False,
        )
        sampler.run(jax.random.key(derived_seed(seed, Purpose.COMPONENTS)), init_params=start)
        sites = {name: np.exp(values) for name, values in sampler.get_samples(group_by_chain=True).items()}
        diverging = np.asarray(sampler.get_extra_fields(group_by_chain=True)["diverging"])
    shared = sites["session"] ** 2 + sites["mounting"] ** 2
    rho = shared / (shared + sites["tap"] ** 2)
    unit = np.array([1.0, amplitude])
    posterior = {name: sites[name] * unit for name in COMPONENTS} | {"rho": rho}
    return az.from_dict(
        {"posterior": posterior, "sample_stats": {"diverging": diverging}},
        coords={"quantity": list(QUANTITIES)},
        dims={name: ["quantity"] for name in posterior},
    )


def _summarise(data: xr.DataTree, cells: "GainCells", gains: TapGains) -> Components:
    import arviz as az  # noqa: PLC0415

    from ....models.measurement.gain_variance import COMPONENTS  # noqa: PLC0415

    posterior = data["posterior"].dataset
    told = _told(cells)
    sds = posterior[list(COMPONENTS)].to_array("component")
    statistics = {
        "r_hat": az.rhat(posterior),
        "ess_bulk": az.ess(posterior, method="bulk"),
        "ess_tail": az.ess(posterior, method="tail"),
    }
    summary = _interval(sds).assign(
        {name: values[list(COMPONENTS)].to_array("component") for name, values in statistics.items()}
    )
    mask = xr.DataArray([told[name] for name in COMPONENTS], dims="component")
    summary = summary.transpose("quantity", "component").where(mask)
    rho_told = all(told.values())
    rho = _interval(posterior["rho"]).where(rho_told)
    n = xr.DataArray(list(SEQUENCES), dims="n", coords={"n": list(SEQUENCES)})
    effective = _interval(n / (1 + (n - 1) * posterior["rho"].sel(quantity="gain", drop=True))).where(rho_told)
    diverged = int(data["sample_stats"].dataset["diverging"].sum())
    worst_r, least_ess = (
        (float(statistics["r_hat"].to_array().max())),
        float(min(statistics[name].to_array().min() for name in ("ess_bulk", "ess_tail"))),
    )
    converged = bool(worst_r <= _R_HAT and least_ess >= _ESS and diverged <= CHAINS * DRAWS // 100)
    chains = (
        f"NUTS, {CHAINS} chains of {DRAWS} draws: worst R-hat {worst_r:.3f} (at most {_R_HAT:g}), smallest effective "
        f"sample size {least_ess:.0f} (at least {_ESS:.0f}), {diverged} divergences."
    )
    if not converged:
        chains = f"The chains did not converge, so the intervals are unreliable. {chains}"
    sentences = (*_sentences(summary, rho, effective, cells, gains), chains)
    return Components(data, summary, rho, effective, converged, sentences)


def _interval(draws: xr.DataArray) -> xr.Dataset:
    """Mean and central interval over chains and draws."""
    dims = ("chain", "draw")
    ends = draws.quantile([(1 - PROBABILITY) / 2, (1 + PROBABILITY) / 2], dims)
    return xr.Dataset(
        {
            "mean": draws.mean(dims),
            "low": ends.isel(quantile=0, drop=True),
            "high": ends.isel(quantile=1, drop=True),
        }
    )


def _told(cells: "GainCells") -> dict[str, bool]:
    """Which components the taps can tell of at all."""
    sessions = (cells.taps > 0).sum(axis=0)
    several = int((sessions > 1).sum())
    return {"session": several >= 2, "mounting": several >= 2, "tap": bool((cells.taps > 1).any())}


def _sentences(
    summary: xr.Dataset, rho: xr.Dataset, effective: xr.Dataset, cells: "GainCells", gains: TapGains
) -> Iterator[str]:
    told, R = _told(cells), int((cells.taps > 0).any(axis=1).sum())
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
    from ....models.measurement.gain_variance import COMPONENTS  # noqa: PLC0415

    coords = {"quantity": list(QUANTITIES), "component": list(COMPONENTS)}
    nothing = np.full((len(QUANTITIES), len(COMPONENTS)), np.nan)
    three, six = ("mean", "low", "high"), ("mean", "low", "high", "r_hat", "ess_bulk", "ess_tail")
    summary = xr.Dataset(dict.fromkeys(six, (("quantity", "component"), nothing)), coords)
    rho = xr.Dataset(dict.fromkeys(three, ("quantity", nothing[:, 0])), {"quantity": list(QUANTITIES)})
    lost = np.full(len(SEQUENCES), np.nan)
    effective = xr.Dataset(dict.fromkeys(three, ("n", lost)), {"n": list(SEQUENCES)})
    sentence = (
        f"Variance components cannot be estimated: none of {len(gains.used)} mean taps varies enough, relative to its "
        "noise, to separate a gain from an offset."
    )
    return Components(None, summary, rho, effective, True, (sentence,))
