"""`gaussian`: normal samples for each class and taxel; exchangeable as in the paper, but without bins."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fits.cells import WEAK_CELLS, CellPosterior, cell_posterior, estimated_prior, prior_of_cells
from .fits.posterior import check_cells
from .fits.priors import CellPrior, Taps
from .likelihood.bins import TableForm
from .likelihood.forecasts import Unseen, cells_left_out, log_normal_probability, log_student_probability
from .likelihood.shapes import Measure, Parameters, standardised
from .model import Row
from .scaling import Moments
from .story import Story


def story(
    where: Any, what: Any, taps: Any = None, *, L: int, M: int, J: int, K: int, prior: CellPrior = WEAK_CELLS
) -> None:
    """Generative model: normal samples for each class and taxel, at any time.

    The variances of all classes of a taxel come from one inverse gamma distribution, as `prior` says.
    """
    from .fits.story_parts import cells, dist, jnp, numpyro

    with numpyro.plate("L", L, dim=-4), numpyro.plate("M", M, dim=-3), numpyro.plate("K", K, dim=-1):
        level, variance = cells(prior)
    own = where, what
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(level[own], jnp.sqrt(variance[own])), obs=taps)


def fit(taps: Taps, prior: CellPrior | None = None) -> CellPosterior:
    """Exact posterior of `story`; samples of all times are pooled."""
    count, mean, square = Moments.of(taps).pooled()
    prior = prior or estimated_prior(count - 1, square)
    return CellPosterior(cell_posterior(count, mean, square, prior), prior)


def form(parameters: Parameters, frame: Measure) -> TableForm:
    """Likelihood of bins under `story`."""
    lower, upper = standardised(parameters["level"], np.sqrt(parameters["variance"]), frame)
    return TableForm(log_normal_probability(lower, upper))


def integrated(posterior: CellPosterior, frame: Measure, unseen: Unseen, _: np.random.Generator) -> NDArray[np.float64]:
    """Log probability of taps with each sample predicted from the training taps and the previous samples of its tap."""
    taps, (samples, below, above) = unseen.taps, unseen.gaps
    centre, unit = frame.scaling
    samples, below, above = (samples - centre) / unit, below / unit, above / unit
    level, strength, a, b = (array[unseen.own][:, 0].astype(np.float64) for array in posterior.cells)
    total = np.zeros(len(taps))
    for j in range(taps.shape[1]):
        scale = np.sqrt(b / a * (1 + 1 / np.maximum(strength, 1.0)))  # only cells without a sample have less
        gap, there = samples[:, j] - level, ~np.isnan(taps[:, j])
        total += log_student_probability((below[:, j] + gap) / scale, (above[:, j] + gap) / scale, 2 * a).sum(axis=1)
        b = b + there * 0.5 * strength / (strength + 1) * gap**2
        level, strength, a = level + there * gap / (strength + 1), strength + there, a + 0.5 * there
    return total


def leave_out(posterior: CellPosterior, frame: Measure, known: Unseen) -> NDArray[np.float64]:
    """Training taps given all others."""
    return cells_left_out(posterior.cells, frame, known)


MODEL = Story(
    name="gaussian",
    row=Row("bins", "a normal distribution per class and taxel"),
    story=story,
    dims={"level": ("where", "what", "once", "taxel"), "variance": ("where", "what", "once", "taxel")},
    positive=("variance",),
    exchangeable=True,
    check=check_cells,
    closed=fit,
    form=form,
    arguments=prior_of_cells,
    trained_only=True,
    integrated=integrated,
    leave_out=leave_out,
    independent=True,
    kept=CellPosterior,
)
