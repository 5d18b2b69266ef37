"""Log probability of new taps under their own classes, integrated over the posterior of a model or at one point.

Levels and variances of cells are integrated exactly, which makes forecasts Student's t; what cells share is integrated
by averaging over draws. Averaging over draws of everything would not do: a tap has hundreds of samples, and the mean of
so many factors is carried by draws too rare to be seen.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from .catalogue import Fitted
from .fits.cells import ArPosterior, CellPosterior, Cells, MvnPosterior
from .fits.curves import CurvePosterior
from .fits.kronecker import KroneckerPosterior
from .histogram import HistogramModel
from .likelihood.bins import find_bins
from .likelihood.forms import GaussianForm, TableForm, bin_gaps
from .likelihood.masses import log_student_mass
from .parametric import FORMS, ParametricModel
from .posterior import HistogramPosterior
from .true_class import Own, OwnTaps

DRAWS = 16
"""Draws of what cells share."""
_MANY_DRAWS = 100
"""Draws where nothing is integrated exactly."""


def plug_in(fitted: Fitted, taps: NDArray[np.floating], own: Own) -> NDArray[np.float64]:
    """Log probability of the bins of taps (N, J, K) at the parameters with which the model decides, shape (N,)."""
    model = fitted.model
    return OwnTaps(taps, own, model.edges, model.states).log_probability(model.plain_form)


def integrated(
    fitted: Fitted, taps: NDArray[np.floating], own: Own, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Log probability of the bins of taps (N, J, K), each given the training taps, shape (N,).

    Args:
        fitted: A fit with a posterior.
        taps: Taps that did not train it.
        own: Their classes.
        generator: Of the draws.
    """
    model, posterior = fitted.model, fitted.posterior
    if posterior is None:
        raise ValueError(f"{model.name} has no posterior to integrate over.")
    parts = []
    for gain, offset, log_prior in zip(*model.states, strict=True):
        parts.append(log_prior + _in_one_state(model, posterior, taps, own, generator, gain, offset))
    return np.logaddexp.reduce(parts, axis=0)


def _in_one_state(  # noqa: PLR0911 - one for each kind of posterior
    model: Any,
    posterior: Any,
    taps: NDArray[np.floating],
    own: Own,
    generator: np.random.Generator,
    gain: float,
    offset: float,
) -> NDArray[np.float64]:
    if isinstance(model, HistogramModel) and isinstance(posterior, HistogramPosterior):
        return _histogram(posterior, model.edges, taps, own, gain, offset)
    if not isinstance(model, ParametricModel):
        raise TypeError(f"{type(model).__name__} has no predictive distribution.")
    # Taps in the state of gain 1 and offset 0; bins go with them, so probabilities stay those of the same bins.
    taps, edges = (taps - offset) / gain, (model.edges - offset) / gain
    match posterior:
        case CellPosterior() if model.kind == "gaussian":
            return _gaussian(posterior.cells, model, taps, edges, own)
        case CellPosterior():
            return _student(model, posterior.point(), posterior.cells, taps, edges, own)
        case ArPosterior():
            return _averaged([_ar_draw(posterior, generator) for _ in range(DRAWS)], model, taps, edges, own)
        case MvnPosterior():
            return _averaged([_mvn_draw(posterior, generator) for _ in range(DRAWS)], model, taps, edges, own)
        case CurvePosterior():
            return _curves(posterior, model, taps, edges, own)
        case KroneckerPosterior():
            inflation = np.sqrt(1 + 1 / np.maximum(posterior.strength, 1.0))
            drawn_once = ({**posterior.draw(generator), "level": posterior.level} for _ in range(DRAWS))
            forms = (_inflated(_form(model, parameters), inflation) for parameters in drawn_once)
            return _log_mean([form.own(taps, edges, *own) for form in forms])
        case _:
            draws = (FORMS[model.kind](posterior.draw(generator), model.frame) for _ in range(_MANY_DRAWS))
            return _log_mean([form.own(taps, edges, *own) for form in draws])


def _histogram(
    posterior: HistogramPosterior,
    edges: NDArray[np.float64],
    taps: NDArray[np.floating],
    own: Own,
    gain: float,
    offset: float,
) -> NDArray[np.float64]:
    """Dirichlet-multinomial; in a state the concentration of the bins is moved between them as probability is."""
    alpha = posterior.concentration
    if (gain, offset) != (1.0, 0.0):
        total = alpha.sum(axis=-1, keepdims=True)
        alpha = total * np.exp(TableForm(np.log(alpha / total)).in_state(gain, offset, edges).log_prob)
    (N, J, K), B = taps.shape, alpha.shape[-1]
    bins = find_bins(taps, edges)
    cells = (np.arange(N)[:, None, None] * K + np.arange(K)) * B + bins
    cell, times = np.unique(cells, return_counts=True)
    tap, rest = np.divmod(cell, K * B)
    rows = alpha.reshape(*alpha.shape[:2], K * B)[own[0][tap], own[1][tap], rest]
    total = alpha.sum(axis=-1)[own]
    base = (gammaln(total) - gammaln(total + J)).sum(axis=-1)
    with np.errstate(divide="ignore"):
        gained = np.where(rows > 0, gammaln(rows + times) - gammaln(np.maximum(rows, 1e-300)), -np.inf)
    return base + np.bincount(tap, gained, minlength=N)


def _gaussian(
    cells: Cells, model: ParametricModel, taps: NDArray[np.floating], edges: NDArray[np.float64], own: Own
) -> NDArray[np.float64]:
    """Every sample forecast from the training taps and the samples before it in its tap."""
    samples, below, above = bin_gaps(taps, edges)
    centre, unit = model.scaling
    samples, below, above = (samples - centre) / unit, below / unit, above / unit
    level, strength, a, b = (array[own][:, 0].astype(np.float64) for array in cells)
    total = np.zeros(len(taps))
    for j in range(taps.shape[1]):
        scale = np.sqrt(b / a * (1 + 1 / strength))
        gap = samples[:, j] - level
        total += log_student_mass((below[:, j] + gap) / scale, (above[:, j] + gap) / scale, 2 * a).sum(axis=1)
        b = b + 0.5 * strength / (strength + 1) * gap**2
        level, strength, a = level + gap / (strength + 1), strength + 1, a + 0.5
    return total


def _ar_draw(posterior: ArPosterior, generator: np.random.Generator) -> tuple[dict[str, NDArray[np.float64]], Cells]:
    rho = posterior.draw(generator)["rho"]
    cells = posterior.cells(rho)
    return {"rho": rho, **cells.point()}, cells


def _mvn_draw(posterior: MvnPosterior, generator: np.random.Generator) -> tuple[dict[str, NDArray[np.float64]], Cells]:
    slope = posterior.draw(generator)["slope"]
    cells = posterior.cells(slope)
    return {"slope": slope, **cells.point()}, cells


def _averaged(
    draws: list[tuple[dict[str, NDArray[np.float64]], Cells]],
    model: ParametricModel,
    taps: NDArray[np.floating],
    edges: NDArray[np.float64],
    own: Own,
) -> NDArray[np.float64]:
    return _log_mean([_student(model, parameters, cells, taps, edges, own) for parameters, cells in draws])


def _student(
    model: ParametricModel,
    parameters: Any,
    cells: Cells,
    taps: NDArray[np.floating],
    edges: NDArray[np.float64],
    own: Own,
) -> NDArray[np.float64]:
    """Forecasts with level and variance of every cell integrated out."""
    variance = cells.b / cells.a * (1 + 1 / np.maximum(cells.strength, 1.0))
    form = _form(model, {**parameters, "variance": variance})
    return _student_mass(form, 0, 2 * cells.a, taps, edges, own)


def _curves(
    posterior: CurvePosterior, model: ParametricModel, taps: NDArray[np.floating], edges: NDArray[np.float64], own: Own
) -> NDArray[np.float64]:
    """Student's t with the uncertainty of the curve at each place added to the variance."""
    parts = []
    form = _form(model, posterior.point())
    noise = posterior.b / posterior.a
    for q, basis in enumerate(model.basis):
        spread = np.einsum("ld,mjkdx->lmjkx", basis, posterior.root, optimize=True)
        scale = np.sqrt(noise + (spread**2).sum(axis=-1)) * model.scaling.unit
        at = form._replace(scale=np.broadcast_to(scale, form.mean.shape))
        parts.append(form.log_weight[q] + _student_mass(at, q, 2 * posterior.a, taps, edges, own))
    return np.logaddexp.reduce(parts, axis=0)


def _student_mass(
    form: GaussianForm,
    q: int,
    freedom: NDArray[np.float64],
    taps: NDArray[np.floating],
    edges: NDArray[np.float64],
    own: Own,
) -> NDArray[np.float64]:
    samples, below, above = bin_gaps(taps, edges)
    innovation = form.innovations(samples, *own, q)
    scale = form.scale[q][own]
    freedom = np.broadcast_to(freedom, form.scale.shape[1:])[own]
    return log_student_mass((below + innovation) / scale, (above + innovation) / scale, freedom).sum(axis=(1, 2))


def _form(model: ParametricModel, parameters: Any) -> GaussianForm:
    form = FORMS[model.kind](parameters, model.frame)
    if not isinstance(form, GaussianForm):
        raise TypeError(f"{model.kind} has no Gaussian form.")
    return form


def _inflated(form: GaussianForm, factor: NDArray[np.float64]) -> GaussianForm:
    return form._replace(scale=form.scale * factor[..., None, None])


def _log_mean(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.logaddexp.reduce(parts, axis=0) - np.log(len(parts))
