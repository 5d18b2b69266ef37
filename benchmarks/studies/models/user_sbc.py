"""Simulation-based calibration of the fits of users' models: `laplace` and `two_levels` by NUTS and by `svi`.

As in `sbc`, of the models of docs/how-to/your-own-model.md: parameters and taps are drawn from the model's prior, and
the fit gets the model and the taps. Each fit is compiled once for all data sets.

`--document docs/explanation/model-studies.md` updates the table and the figure of that page.
"""

from argparse import ArgumentParser
from functools import cache, partial
from itertools import product
from typing import Any

import jax
import numpy as np
import numpyro
from numpy.typing import NDArray
from scipy.special import logit
from scipy.stats import laplace, norm
from solidtouch.models.measurement.fits.nuts import Chains
from solidtouch.models.measurement.fits.posterior import Posterior
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.fit import Fit, Variational
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.shapes import Parameters

from benchmarks.own_stories import stories
from benchmarks.page import parsed
from benchmarks.studies.models import sbc

STORIES = ("laplace", "two_levels")
METHODS = {"nuts": "4 Markov chains", "svi": "independent normals"}
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

    @cache
    def compiled() -> Any:
        if method != "nuts":
            return Variational.of(begun, method)
        chains = Chains.of(begun.summed)
        return chains._replace(begin=jax.jit(chains.begin, static_argnums=1))

    def fit(samples: NDArray[np.float64]) -> Posterior:
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            if method == "nuts":
                found = compiled().posterior((samples,), lambda sites: {key: sites[key] for key in begun.names})
            else:
                found = compiled().posterior(begun._replace(samples=samples))
        converged.append(found.convergence().converged)
        return found

    draw = partial(sbc.from_story, partial(begun.story, begun.batch))
    own = begun.batch.where, begun.batch.what
    return sbc.Study(f"{name}, {method}", METHODS[method], draw, fit, partial(quantities, own))


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
    return found | {"log likelihood": log_density({k: parameters[k][own][:, None] for k in loose}, samples)}


def log_density(each: Parameters, samples: NDArray[np.float64]) -> float:
    """Log density of taps (N, J, K) at parameters (N, 1, K) of either model."""
    if "loc" in each:
        return float(laplace.logpdf(samples, each["loc"], each["scale"]).sum())
    low, gap, scale, share = (each[name] for name in ("low", "gap", "scale", "share"))
    lower = np.log1p(-share) + norm.logpdf(samples, low, scale)
    return float(np.logaddexp(lower, np.log(share) + norm.logpdf(samples, low + gap, scale)).sum())


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
