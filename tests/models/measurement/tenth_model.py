"""A further model as its author would add it to `models/measurement`: this file, and the name `tenth-model`."""

from typing import Any, NamedTuple

import numpy as np
from scipy.stats import laplace
from solidtouch.models.measurement.fits.posterior import EXACT, check_cells
from solidtouch.models.measurement.likelihood.bins import TableForm
from solidtouch.models.measurement.likelihood.shapes import standardised
from solidtouch.models.measurement.model import Row
from solidtouch.models.measurement.story import Story


def story(where, what, taps=None, *, L, M, J, K):
    """Generative model: Laplace distributed samples for each class and taxel."""
    import numpyro
    import numpyro.distributions as dist

    with numpyro.plate("L", L, dim=-4), numpyro.plate("M", M, dim=-3), numpyro.plate("K", K, dim=-1):
        level: Any = numpyro.sample("level", dist.Normal(0.0, 10.0))
        scale: Any = numpyro.sample("scale", dist.LogNormal(0.0, 1.0))
    own = where, what
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Laplace(level[own], scale[own]), obs=taps)


class Posterior(NamedTuple):
    """Most probable values under flat priors, with their deviations for many taps."""

    level: np.ndarray
    scale: np.ndarray
    samples: np.ndarray

    def point(self):
        return {"level": self.level, "scale": self.scale}

    def draw(self, generator):
        noise = generator.standard_normal((2, *self.level.shape)) / np.sqrt(self.samples)
        return {"level": self.level + self.scale * noise[0], "scale": self.scale * np.exp(noise[1])}

    def convergence(self):
        return EXACT


def fit(taps):
    """Medians and mean deviations from them; those of a class without taps are 0 and 1."""
    (L, M), (_, _, K) = taps.shape, taps.samples.shape
    found = Posterior(np.zeros((L, M, 1, K)), np.ones((L, M, 1, K)), np.ones((L, M, 1, 1)))
    for l, m in set(zip(taps.where.tolist(), taps.what.tolist(), strict=True)):
        samples = taps.samples[(taps.where == l) & (taps.what == m)].reshape(-1, K)
        found.level[l, m, 0] = np.median(samples, axis=0)
        found.scale[l, m, 0] = abs(samples - found.level[l, m]).mean(axis=0)
        found.samples[l, m] = len(samples)
    return found


def form(parameters, frame):
    """Likelihood of bins under `story`, on the side of the level where distribution functions are small."""
    lower, upper = standardised(parameters["level"], parameters["scale"], frame)
    right = lower + upper > 0
    low, high = np.where(right, -upper, lower), np.where(right, -lower, upper)
    return TableForm(laplace.logcdf(high) + np.log1p(-np.exp(laplace.logcdf(low) - laplace.logcdf(high))))


CELL = ("where", "what", "once", "taxel")
MODEL = Story(
    name="tenth-model",
    row=Row("bins", "a Laplace distribution per class and taxel"),
    story=story,
    dims={"level": CELL, "scale": CELL},
    positive=("scale",),
    exchangeable=True,
    check=check_cells,
    closed=fit,
    form=form,
)
