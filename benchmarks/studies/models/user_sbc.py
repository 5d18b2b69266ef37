"""Simulation-based calibration of the fits of users' models: `laplace` and `two_levels` by NUTS and by `svi`.

As in `sbc`, of the models of docs/how-to/your-own-model.md: parameters and taps are drawn from the model's prior, and
the fit gets the model and the taps. Each fit is compiled once for all data sets. Weighted draws from the prior are a
posterior without a fit, which shows what is due to the data sets.

`--document docs/explanation/model-studies.md` updates the table and the figure of that page.
"""

from argparse import ArgumentParser
from functools import cache, partial
from itertools import product
from math import log, pi
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpy.typing import NDArray
from scipy.special import logit
from solidtouch.models.measurement.fits.nuts import Chains
from solidtouch.models.measurement.fits.posterior import ESS, Convergence, Posterior
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.fit import Fit, Variational
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.shapes import Parameters
from solidtouch.models.seeds import Purpose, derived_seed

from benchmarks.own_stories import stories
from benchmarks.page import parsed
from benchmarks.studies.models import sbc

STORIES = ("laplace", "two_levels")
WEIGHTED = 500_000
"""Draws from the prior of a cell."""
METHODS = {
    "nuts": "4 Markov chains",
    "svi": "independent normals",
    "prior": f"{WEIGHTED} draws from the prior of each cell, weighted",
}
_SESSIONS = 3
SIZES = sbc.Sizes(L=1, M=2, J=5, K=1, repeats=10)


def fit_of(name: str, sizes: sbc.Sizes) -> Fit:
    """A fit of a user's model, in the units of its prior, to taps of known classes and of sessions in turn.

    All samples are 0 for now.
    """
    where, what = sbc.own_classes(sizes)
    shape = sizes.L, sizes.M, sizes.J, sizes.K
    story = StoryFunction.of(stories()[name], name)
    batch = StoryCall(where, what, shape, np.arange(float(sizes.L)), session=np.arange(len(where)) % _SESSIONS)
    return Fit(story, structure_of(story, batch), batch, np.zeros((len(where), sizes.J, sizes.K)), 0)


def study(name: str, method: str, sizes: sbc.Sizes, converged: list[bool]) -> sbc.Study:
    """One model and fit; `converged` gets whether each of its fits has."""
    begun = fit_of(name, sizes)
    own = begun.batch.where, begun.batch.what

    @cache
    def compiled() -> Any:
        if method == "svi":
            return Variational.of(begun, method)
        if method == "prior":
            return prior_of_cell(name)
        chains = Chains.of(begun.summed)
        return chains._replace(begin=jax.jit(chains.begin, static_argnums=1))

    def fit(samples: NDArray[np.float64]) -> Posterior:
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            if method == "nuts":
                found = compiled().posterior((samples,), lambda sites: {key: sites[key] for key in begun.names})
            elif method == "svi":
                found = compiled().posterior(begun._replace(samples=samples))
            else:
                found = Weighted.of(compiled(), own, sizes, samples)
        converged.append(found.convergence().converged)
        return found

    draw = partial(sbc.from_story, partial(begun.story, begun.batch))
    return sbc.Study(f"{name}, {method}", METHODS[method], draw, fit, partial(quantities, own))


def prior_of_cell(name: str) -> Parameters:
    """Draws from the prior of a cell by name, shape (draws,)."""
    one = fit_of(name, sbc.Sizes(L=1, M=1, J=1, K=1, repeats=1))
    drawn, _ = sbc.from_story(partial(one.story, one.batch), derived_seed(0, Purpose.PRIOR), WEIGHTED)
    return {key: drawn[key].ravel().astype(np.float32) for key in one.names}  # single precision is twice as fast


class Weighted(NamedTuple):
    """Posterior of a model with independent cells.

    Attributes:
        prior: Draws from the prior of a cell by name, shape (draws,).
        weight: Their cumulated weights in each cell, shape (L, M, K, draws).
    """

    prior: Parameters
    weight: NDArray[np.float64]

    @classmethod
    def of(
        cls, prior: Parameters, own: tuple[NDArray[np.intp], NDArray[np.intp]], sizes: sbc.Sizes, samples: Any
    ) -> "Weighted":
        """Posterior given taps."""
        weight = np.empty((*sizes[:2], sizes.K, WEIGHTED))
        for l, m, k in np.ndindex(weight.shape[:3]):
            inside = (own[0] == l) & (own[1] == m)
            weight[l, m, k] = _weights(prior, samples[inside, :, k].ravel().astype(np.float32))
        return cls(prior, weight.cumsum(axis=-1))

    def point(self) -> Parameters:
        """Means."""
        return {key: np.diff(self.weight, prepend=0.0) @ values for key, values in self.prior.items()}

    def draw(self, generator: np.random.Generator) -> Parameters:
        """A draw of all cells."""
        cells = self.weight.reshape(-1, WEIGHTED)
        at = np.array([np.searchsorted(cell, generator.random() * cell[-1]) for cell in cells])
        return {key: values[at].reshape(self.weight.shape[:3]).astype(np.float64) for key, values in self.prior.items()}

    def convergence(self) -> Convergence:
        """Whether enough draws have weight."""
        least = float((1 / (np.diff(self.weight, prepend=0.0) ** 2).sum(axis=-1)).min())
        return Convergence(least >= ESS, f"Least effective sample size {least:.0f} (at least {ESS:g}).", {})


@jax.jit
def _weights(prior: Any, samples: Any) -> Any:
    """Weights of draws from the prior of a cell given its samples, with sum 1."""
    added = lambda total, sample: (total + log_density(prior, sample, jnp), None)  # noqa: E731
    return jax.nn.softmax(jax.lax.scan(added, jnp.zeros(WEIGHTED, dtype=jnp.float32), samples)[0])


def quantities(
    own: tuple[NDArray[np.intp], NDArray[np.intp]], parameters: Parameters, samples: NDArray[np.float64]
) -> dict[str, float]:
    """Parameters of the first cell and their means, and the log density of the taps."""
    loose = {
        name: {"share": logit, "scale": np.log, "gap": np.log}.get(name, np.asarray)(parameters[name])
        for name in ("loc", "low", "gap", "scale", "share")
        if name in parameters
    }
    words = {"gap": "log gap", "scale": "log scale", "share": "logit of the share"}
    found = {}
    for name, values in loose.items():
        told = words.get(name, name)
        found |= {f"{told}, a cell": float(values[0, 0, 0]), f"{told}, mean": float(values.mean())}
    each = {name: parameters[name][own][:, None] for name in loose}
    return found | {"log likelihood": float(log_density(each, samples).sum())}


def log_density(each: Parameters, samples: Any, xp: Any = np) -> Any:
    """Log densities of samples at parameters of either model, broadcast against each other, by NumPy or `jax.numpy`."""
    log_scale = xp.log(each["scale"])
    if "loc" in each:
        return -abs(samples - each["loc"]) / each["scale"] - log_scale - log(2)
    from_low = (samples - each["low"]) / each["scale"]
    lower, upper = (-0.5 * z**2 for z in (from_low, from_low - each["gap"] / each["scale"]))
    both = xp.logaddexp(xp.log1p(-each["share"]) + lower, xp.log(each["share"]) + upper)
    return both - log_scale - 0.5 * log(2 * pi)


def main() -> None:
    """Runs the study as the command line says."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=300, help="data sets per model and fit")
    parser.add_argument("--seed", type=int, default=1)
    options = parsed(parser, "user-sbc")
    results, parts = [], []
    for name, method in product(STORIES, METHODS):
        converged: list[bool] = []
        result = sbc.run(study(name, method, SIZES, converged), options.repetitions, options.seed)
        results.append(result)
        if not all(converged):
            parts.append(only(result, np.array(converged)))
    sbc.report(results, SIZES, options, "user-sbc", "calibration-of-user-models", parts)


def only(result: sbc.Ranks, converged: NDArray[np.bool_]) -> sbc.Ranks:
    """Ranks in the data sets whose fit has converged; a posterior that is exact is so for these alone, too."""
    name = f"{result.study.name}, {converged.sum()} converged"
    return sbc.Ranks(result.study._replace(name=name), {key: rank[converged] for key, rank in result.rank.items()})


if __name__ == "__main__":
    main()
