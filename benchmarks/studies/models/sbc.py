"""Simulation-based calibration of the fits: ranks of true parameters among posterior draws.

Parameters and taps are drawn from the NumPyro models under a proper prior; the fit uses the same prior. For an exact
posterior the rank of the true value among draws is uniform (Talts et al., "Validating Bayesian inference algorithms
with simulation-based calibration", 2018). Ranks are tested by their distribution function with a simultaneous band
(Sailynoja, Buerkner and Vehtari, Statistics and Computing 32 (2022) 32) and by chi-square.

`--document docs/explanation/model-studies.md` updates the table and the figure of that page.
"""

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from numpyro import handlers
from scipy.stats import binom, chisquare
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement import gaussian, histogram, matrix_normal, profile, profile_ar, profile_mvn
from solidtouch.models.measurement.fits.posterior import Posterior
from solidtouch.models.measurement.fits.priors import CellPrior, Taps
from solidtouch.models.measurement.histogram import HistogramPosterior
from solidtouch.models.measurement.histogram import fit as fit_histogram
from solidtouch.models.measurement.likelihood.bins import find_bins
from solidtouch.models.measurement.likelihood.forms import GaussianForm
from solidtouch.models.measurement.likelihood.shapes import Measure, Parameters
from solidtouch.models.measurement.registry import measurement_model
from solidtouch.models.measurement.scaling import Scaling
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, derived_seed, generator
from solidtouch.models.taps import TapSet

from benchmarks.page import parsed, publish, table, write_block
from benchmarks.studies.models.figures import RankPanel, rank_figure
from benchmarks.study import until_interrupted, write_json

DRAWS = 99
"""Draws from each posterior; ranks go from 0 to this."""
CHI_BINS = 20
_NULLS = 4000  # samples of uniform ranks that the simultaneous band comes from
_FALSE_ALARMS = 0.05

type Drawn = tuple[dict[str, NDArray[np.float64]], NDArray[np.float64]]
"""Parameters by name and samples of many data sets."""


class Sizes(NamedTuple):
    """Of the taps: L where classes, M objects, J samples, K taxels, B bins, and taps of each class."""

    L: int = 2
    M: int = 3
    J: int = 5
    K: int = 4
    B: int = 6
    repeats: int = 7


class Study(NamedTuple):
    """One fit under test.

    Attributes:
        name: Of the model.
        how: What its fit is.
        draw: Gives true parameters and taps of many data sets from a seed and their number.
        fit: The posterior of one data set's samples, shape (N, J, K).
        quantities: Numbers by name from parameters and samples.
    """

    name: str
    how: str
    draw: Callable[[int, int], Drawn]
    fit: Callable[[NDArray[np.float64]], Posterior]
    quantities: Callable[[Parameters, NDArray[np.float64]], dict[str, float]]


class Ranks(NamedTuple):
    """Ranks of the truth, of each quantity by name, each of shape (data sets,)."""

    study: Study
    rank: dict[str, NDArray[np.intp]]


def own_classes(sizes: Sizes) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where and what class of each tap."""
    where, what = np.indices((sizes.L, sizes.M))
    return np.repeat(where.ravel(), sizes.repeats), np.repeat(what.ravel(), sizes.repeats)


def studies(sizes: Sizes) -> list[Study]:
    """All fits under test."""
    L, M, J, K = sizes[:4]
    where, what = own_classes(sizes)
    prior = CellPrior(0.3, 0.5, 2.0 + np.arange(K), 1.0 + np.arange(K))
    around_0 = prior._replace(level=0.0)  # which `profile_mvn.fit` takes for granted
    wide = matrix_normal.weak_prior(J, K)._replace(strength=0.5)
    pairs = K * (K - 1) // 2
    typical = np.linspace(-0.4, 0.6, pairs)

    def taps(samples: Any) -> Taps:
        return Taps(samples, where, what, (L, M))

    def study(module: Any, how: str = "exact", **arguments: Any) -> Study:
        name = module.MODEL.name
        draw = partial(_from_built_in, partial(module.story, where, what, L=L, M=M, J=J, K=K, **arguments))
        fitted = lambda samples: module.fit(taps(samples), arguments["prior"])  # noqa: E731
        return Study(name, how, draw, fitted, partial(_quantities, name, (where, what)))

    return [
        _histogram_study(sizes),
        study(gaussian, prior=prior),
        study(profile, prior=prior),
        study(profile_ar, "exact up to a grid of slopes", prior=prior),
        study(
            profile_mvn,
            "slopes and cells factorised, typical slopes estimated",
            prior=around_0,
            typical=typical,
            tightness=4.0,
        ),
        study(matrix_normal, "both covariances factorised", prior=wide),
    ]


def from_story(story: Callable[[], None], seed: int, n: int) -> Drawn:
    """Parameters and samples of `n` data sets as a story without taps simulates them."""

    def one(key: Any) -> dict[str, Any]:
        sites = handlers.trace(handlers.seed(story, key)).get_trace()
        return {name: site["value"] for name, site in sites.items() if site["type"] == "sample"}

    with jax.enable_x64(True):
        values = jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(derived_seed(seed, Purpose.STUDY)), n))
        drawn = {name: np.asarray(value) for name, value in values.items()}
    return drawn, drawn.pop("taps")


def _from_built_in(story: Callable[[], None], seed: int, n: int) -> Drawn:
    """The same with parameters as posteriors name and shape them."""
    drawn, samples = from_story(story, seed, n)
    return _as_fitted(drawn), samples


def _as_fitted(drawn: dict[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Parameters of many data sets as posteriors name and shape them."""
    if "p" in drawn:
        return {"log_prob": np.log(drawn["p"])}
    found = {name: drawn[name] for name in ("level", "variance", "rho") if name in drawn}
    if "slope" in drawn:
        K = drawn["level"].shape[-1]
        found["slope"] = np.zeros((*drawn["slope"].shape[:3], K, K))
        found["slope"][..., *np.tril_indices(K, -1)] = drawn["slope"]
    if "time" in drawn:
        time, taxel = np.linalg.inv(drawn["time"]), np.linalg.inv(drawn["taxel"])
        unit = np.trace(time, axis1=-2, axis2=-1)[:, None, None] / time.shape[-1]
        found["time_covariance"] = time / unit
        found["taxel_covariance"] = taxel * unit[:, None, None]
    return found


def _histogram_study(sizes: Sizes) -> Study:
    """Bins are one unit wide; the prior is a Dirichlet of one count per bin, so that no probability is as good as 0."""
    pseudocount = 1.0
    where, what = own_classes(sizes)
    grid = ClassGrid(np.arange(float(sizes.L)), "mm", None, tuple((str(m),) for m in range(sizes.M)))
    edges = np.arange(sizes.B + 1) - 0.5

    told = partial(
        histogram.story, where, what, L=sizes.L, M=sizes.M, J=sizes.J, K=sizes.K, edges=edges, pseudocount=pseudocount
    )

    def fit(samples: NDArray[np.float64]) -> Posterior:
        taps = TapSet.from_arrays(
            samples, what, [str(m) for m in range(sizes.M)], preprocessing=Preprocessing(sizes.J), where=where
        )
        model = fit_histogram(taps, grid, bins=sizes.B, pseudocount=pseudocount, edges=edges)
        return HistogramPosterior.of(model)

    def quantities(parameters: Parameters, samples: NDArray[np.float64]) -> dict[str, float]:
        log_prob = parameters["log_prob"]
        own = where[:, None, None], what[:, None, None], np.arange(sizes.K), find_bins(samples, edges)
        return {
            "log P, first bin": log_prob[0, 0, 0, 0],
            "log P, last bin": log_prob[-1, -1, -1, -1],
            "entropy, mean": -(np.exp(log_prob) * log_prob).sum(axis=-1).mean(),
            "log likelihood": log_prob[own].sum(),
        }

    return Study("histogram", "exact", partial(_from_built_in, told), fit, quantities)


def _quantities(
    name: str,
    own: tuple[NDArray[np.intp], NDArray[np.intp]],
    parameters: Parameters,
    samples: NDArray[np.float64],
) -> dict[str, float]:
    """Some numbers that parameters of a normal model say, and the log density of the taps under them."""
    level = parameters["level"]
    found = {"level of a cell": level[0, 0, 0, 0], "level, mean": level.mean()}
    if "variance" in parameters:
        log_variance = np.log(parameters["variance"])
        found |= {"log variance of a cell": log_variance[-1, -1, -1, -1], "log variance, mean": log_variance.mean()}
    if "rho" in parameters:
        found |= {"rho of the first taxel": parameters["rho"][0], "rho of the last taxel": parameters["rho"][-1]}
    if "slope" in parameters:
        slope = parameters["slope"]
        found |= {"a slope": slope[0, 0, 1, 0], "another slope": slope[-1, -1, -1, 0], "slope, mean": slope.mean()}
    if "time_covariance" in parameters:
        time, taxel = parameters["time_covariance"], parameters["taxel_covariance"]
        found |= {
            "correlation in time": _correlation(time, 1, 0),
            "correlation of taxels": _correlation(taxel[0, 0], 1, 0),
            "log variance of a taxel": np.log(taxel[-1, -1, -1, -1]),
            "log variance, mean": np.log(np.diagonal(taxel, axis1=-2, axis2=-1)).mean(),
        }
    return {key: float(value) for key, value in found.items()} | {
        "log likelihood": _log_density(name, own, parameters, samples)
    }


def _correlation(covariance: NDArray[np.float64], i: int, j: int) -> float:
    return covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j])


def _log_density(
    name: str,
    own: tuple[NDArray[np.intp], NDArray[np.intp]],
    parameters: Parameters,
    samples: NDArray[np.float64],
) -> float:
    """Of taps, up to a constant."""
    if name == "gaussian":
        innovation, scale = samples - parameters["level"][own], np.sqrt(parameters["variance"][own])
        scale = np.broadcast_to(scale, innovation.shape)
    else:
        K = samples.shape[2]
        frame = Measure(Scaling(np.zeros(K), np.ones(K)), np.zeros(2), np.zeros((0, 0, 0)))
        story: Any = measurement_model(name)
        form = story.form(parameters, frame)
        if not isinstance(form, GaussianForm):
            raise TypeError(f"{name} has no Gaussian form.")
        innovation, scale = form.innovations(samples, *own), form.scale[0][own]
    return float(-(0.5 * (innovation / scale) ** 2 + np.log(scale)).sum())


def ranks_of(study: Study, truth: Parameters, samples: NDArray[np.float64], seed: int) -> dict[str, int]:
    """How many of `DRAWS` draws from the posterior lie below the truth."""
    posterior, chance = study.fit(samples), generator(seed, Purpose.STUDY)
    true = study.quantities(truth, samples)
    below = dict.fromkeys(true, 0)
    for _ in range(DRAWS):
        drawn = study.quantities(posterior.draw(chance), samples)
        for name, value in true.items():
            below[name] += drawn[name] < value
    return below


def run(study: Study, repetitions: int, seed: int) -> Ranks:
    """Ranks in many data sets."""
    parameters, samples = study.draw(seed, repetitions)
    tasks = [
        partial(
            ranks_of,
            study,
            {name: value[i].astype(np.float64) for name, value in parameters.items()},
            samples[i],
            derived_seed(seed, Purpose.REPEAT, i),
        )
        for i in range(repetitions)
    ]
    found = list(until_interrupted(study.name, tasks))
    return Ranks(study, {name: np.array([one[name] for one in found]) for name in found[0]} if found else {})


class Band(NamedTuple):
    """What the distribution function of uniform ranks may do by chance.

    Attributes:
        z: Where it is looked at, shape (`DRAWS`,).
        low: Lower end at the same places, minus `z`.
        high: Upper end, likewise.
        null: Least pointwise probability of each of many samples of uniform ranks, sorted.
    """

    z: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    null: NDArray[np.float64]


def simultaneous_band(n: int, seed: int = 0) -> Band:
    """A band that the distribution function of `n` uniform ranks leaves anywhere with probability 5%."""
    generator = np.random.default_rng(seed)
    z = np.arange(1, DRAWS + 1) / (DRAWS + 1)
    counts = generator.multinomial(n, np.full(DRAWS + 1, 1 / (DRAWS + 1)), size=_NULLS)
    null = np.sort(_least(counts[:, :-1].cumsum(axis=1), n, z))
    level = np.quantile(null, _FALSE_ALARMS)
    low, high = binom.ppf(level / 2, n, z), binom.isf(level / 2, n, z)
    return Band(z, low / n - z, high / n - z, null)


def _least(cumulative: NDArray[np.intp], n: int, z: NDArray[np.float64]) -> NDArray[np.float64]:
    """The least two-sided pointwise probability of distribution functions (..., DRAWS)."""
    below, above = binom.cdf(cumulative, n, z), binom.sf(cumulative - 1, n, z)
    return 2 * np.minimum(below, above).min(axis=-1)


def distribution(rank: NDArray[np.intp]) -> NDArray[np.float64]:
    """The empirical distribution function of ranks minus that of uniform ones, shape (DRAWS,)."""
    counts = np.bincount(rank, minlength=DRAWS + 1)[:-1].cumsum()
    return counts / len(rank) - np.arange(1, DRAWS + 1) / (DRAWS + 1)


def p_values(rank: NDArray[np.intp], band: Band) -> tuple[float, float]:
    """Of uniform ranks: by the distribution function anywhere, and by chi-square over `CHI_BINS` bins."""
    counts = np.bincount(rank, minlength=DRAWS + 1)
    least = _least(counts[:-1].cumsum(), len(rank), band.z)
    anywhere = (np.searchsorted(band.null, least, side="right") + 1) / (len(band.null) + 1)
    square = chisquare(counts.reshape(CHI_BINS, -1).sum(axis=1)).pvalue
    return float(anywhere), float(square)


def result_table(results: Sequence[Ranks]) -> str:
    """A line for each quantity."""
    tests = sum(len(result.rank) for result in results)
    lines = []
    for result in results:
        for name, rank in result.rank.items():
            anywhere, square = p_values(rank, simultaneous_band(len(rank)))
            share = (rank + 0.5) / (DRAWS + 1)
            width = share.var() / ((1 - (DRAWS + 1.0) ** -2) / 12)
            failed = "no" if min(anywhere, square) >= _FALSE_ALARMS / (2 * tests) else "yes"
            numbers = f"{share.mean():.3f}", f"{width:.2f}", _p(anywhere), _p(square)
            lines.append([result.study.name, name, *numbers, failed])
    head = ["model", "quantity", "mean rank", "spread", "p, anywhere in the band", "p, chi-square", "fails"]
    return table(head, lines)


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


def panels(results: Sequence[Ranks]) -> list[RankPanel]:
    """What the figure shows."""
    found = []
    for result in results:
        band = simultaneous_band(len(next(iter(result.rank.values()))))
        curves = {name: distribution(rank) for name, rank in result.rank.items()}
        found.append(RankPanel(result.study.name, band.z, band.low, band.high, curves))
    return found


def page(results: Sequence[Ranks], sizes: Sizes, repetitions: int, seed: int) -> str:
    """What the page says of the results."""
    (L, M, J, K), tests = sizes[:4], 2 * sum(len(result.rank) for result in results)
    how = "; ".join(f"`{result.study.name}`: {result.study.how}" for result in results)
    return (
        f"{L} x {M} classes, {J} samples, {K} taxel{'s' * (K > 1)}, {sizes.repeats} taps per class; "
        f"{repetitions} data sets for each model, {DRAWS} draws from each posterior, seed {seed}. "
        f"A quantity fails if either of its two p-values is below 0.05 divided by {tests}, the number of tests. "
        f"Posteriors: {how}.\n\n{result_table(results)}"
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=500, help="data sets per model")
    parser.add_argument("--models", nargs="*", help="models to run")
    parser.add_argument("--seed", type=int, default=1)
    options = parsed(parser, "sbc")
    sizes = Sizes()
    chosen = [study for study in studies(sizes) if not options.models or study.name in options.models]
    results = [run(study, options.repetitions, options.seed) for study in chosen]
    report(results, sizes, options, "sbc", "calibration-of-fits")


def report(
    results: Sequence[Ranks], sizes: Sizes, options: Namespace, block: str, figure: str, parts: Sequence[Ranks] = ()
) -> None:
    """Prints and writes what is finished, and the page if all is; `parts` are rows for some of the data sets."""
    results = [result for result in results if result.rank]
    if not results:
        return
    write_json(block, [{"model": r.study.name, "rank": {k: v.tolist() for k, v in r.rank.items()}} for r in results])
    text = page([*results, *parts], sizes, options.repetitions, options.seed)
    print(text)
    complete = all(len(rank) == options.repetitions for result in results for rank in result.rank.values())
    if options.document is not None and complete:
        publish(rank_figure(panels(results)), options.document, figure)
        write_block(options.document, block, text)


if __name__ == "__main__":
    main()
