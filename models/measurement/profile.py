"""`profile`: a mean and a variance for each class, taxel and time."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fits.cells import CELL, WEAK_CELLS, CellPosterior, cell_posterior, estimated_prior, prior_of_cells
from .fits.posterior import check_times
from .fits.priors import CellPrior, Taps
from .likelihood.forecasts import Unseen, cells_integrated, cells_left_out
from .likelihood.forms import GaussianForm
from .likelihood.shapes import NO_TAXEL, Measure, Parameters, chain_form
from .model import Row
from .scaling import Moments, least_deviation
from .story import Story


def story(
    where: Any, what: Any, taps: Any = None, *, L: int, M: int, J: int, K: int, prior: CellPrior = WEAK_CELLS
) -> None:
    """Generative model: a mean and a variance for each class, taxel and time; independent residuals.

    The variances of all classes and times of a taxel come from one inverse gamma distribution, as `prior` says.
    """
    from .fits.story_parts import cells, dist, jnp, numpyro, plates

    with plates(("L", L, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        level, variance = cells(prior)
    own = where, what
    with plates(("tap", len(where), -3), ("time", J, -2), ("taxel", K, -1)):
        numpyro.sample("taps", dist.Normal(level[own], jnp.sqrt(variance[own])), obs=taps)


def fit(taps: Taps, prior: CellPrior | None = None) -> CellPosterior:
    """Exact posterior of `story`."""
    moments = Moments.of(taps)
    count = moments.samples
    prior = prior or estimated_prior(count - 1, moments.square)
    return CellPosterior(cell_posterior(count, moments.mean, moments.square, prior), prior)


def form(parameters: Parameters, frame: Measure) -> GaussianForm:
    """Likelihood of bins under `story`."""
    J = parameters["level"].shape[2]
    return chain_form(parameters["level"][None], parameters["variance"], np.eye(J)[None], NO_TAXEL, frame)


def integrated(posterior: CellPosterior, frame: Measure, unseen: Unseen, _: np.random.Generator) -> NDArray[np.float64]:
    """Predictions with levels and variances integrated out."""
    return cells_integrated(form, posterior.point(), posterior.cells, frame, unseen)


def leave_out(posterior: CellPosterior, frame: Measure, known: Unseen) -> NDArray[np.float64]:
    """Training taps given all others."""
    return cells_left_out(posterior.cells, frame, known, least_deviation(frame.edges, known.taps.shape[2]))


MODEL = Story(
    name="profile",
    row=Row("exchangeable samples", "a mean and a variance for each time of a tap"),
    story=story,
    dims={"level": CELL, "variance": CELL},
    positive=("variance",),
    check=check_times,
    closed=fit,
    form=form,
    arguments=prior_of_cells,
    trained_only=True,
    integrated=integrated,
    leave_out=leave_out,
    independent=True,
    kept=CellPosterior,
)
