"""What studies ask of models of users, such as those of docs/how-to/your-own-model.md.

A left-out session shares the latent variables of its session. These are integrated over by importance sampling around
Laplace's approximation, as a mean over draws from their prior hardly ever meets the few values that fit.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray
from numpyro.handlers import seed, substitute, trace
from numpyro.infer.util import log_density
from scipy.special import logsumexp
from scipy.stats import multivariate_t
from solidtouch.models.measurement.generic.sessions import with_new_session
from solidtouch.models.measurement.generic.story import GenericModel
from solidtouch.models.measurement.likelihood.forecasts import log_mean
from solidtouch.models.measurement.likelihood.shapes import Parameters
from solidtouch.models.measurement.model import Fitted
from solidtouch.models.measurement.registry import register
from solidtouch.models.taps import TapSet

from benchmarks.own_stories import stories

NAMES = tuple(stories())
_DRAWS = 100  # of the parameters
_STATES = 20  # values of the latent variables of a session
_FREEDOM = 5.0  # of Student's t that they come from
_NEWTON = 10  # steps to the mode


def registered() -> tuple[str, ...]:
    """Names of the models, which `fit_model` then knows."""
    return tuple(register(story, name) for name, story in stories().items())


def drawn_session(
    model: GenericModel,
    parameters: Parameters,
    where: NDArray[np.intp],
    what: NDArray[np.intp],
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Samples (N, J, K) of a new session.

    Raises:
        ValueError: The parameters have a new session already, which all that are drawn would be.
    """
    if model.program.structure.by_session:
        if _last(model, parameters)[1] >= model.program.sessions:
            raise ValueError(f"These parameters of {model.name} have a new session already.")
        parameters = with_new_session(model.program, parameters, generator)
    (form,) = model.by_story(parameters)
    return form.sample(where, what, model.edges, model.preprocessing.samples, generator)


def own_quantities(model: GenericModel, parameters: Parameters) -> dict[str, NDArray[np.float64]]:
    """Latent variables but those of sessions, in the unit of the samples where they have one."""
    centre, unit = model.scaling
    skipped = model.program.structure.by_session
    kept = {name: np.asarray(values) for name, values in parameters.items() if name not in skipped}
    # One drift stands for all taxels; levels have the centre of the samples, and a share has no unit.
    units, centres = {"share": 1.0, "drift": unit.mean()}, {"loc": centre, "low": centre}
    return {name: values * units.get(name, unit) + centres.get(name, 0.0) for name, values in kept.items()}


def session_log_probability(fitted: Fitted, taps: TapSet, generator: np.random.Generator) -> float:
    """Log probability of the bins of all taps of a new session, integrated over its latent variables.

    Parameters are integrated over for each tap, as in models without sessions.
    """
    model, posterior = fitted.model, fitted.posterior
    if not isinstance(model, GenericModel) or posterior is None:
        raise TypeError(f"{model.name} has no latent variables of sessions.")
    own = taps.indices(model.grid)
    draws = [posterior.draw(generator) for _ in range(_DRAWS)]
    mode, covariance, in_session = _laplace(model, taps, generator)
    log_prior = _session_prior(model, draws)
    proposal: Any = multivariate_t(mode, covariance, _FREEDOM, seed=generator)  # pyright: ignore[reportArgumentType]
    parts = []
    for vector in proposal.rvs(_STATES).reshape(_STATES, -1):
        with jax.enable_x64(True):
            forms = [model.by_story(in_session(draw, vector))[0] for draw in draws]
        log_likelihood = log_mean([form.own(taps.taps, model.edges, *own) for form in forms]).sum()
        parts.append(log_likelihood + log_prior(forms[0].given[0].latents) - proposal.logpdf(vector))
    return float(logsumexp(parts) - np.log(_STATES))


def _last(model: GenericModel, latents: Parameters) -> tuple[dict[str, Any], int]:
    """Latent variables of the last session, and its number."""
    axes = model.program.structure.by_session
    numbers = {np.shape(latents[name])[axis] - 1 for name, axis in axes.items()}
    return {name: jnp.take(jnp.asarray(latents[name]), -1, axis=axis) for name, axis in axes.items()}, max(numbers)


def _laplace(
    model: GenericModel, taps: TapSet, generator: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], Callable[[Parameters, Any], Parameters]]:
    """Mode and covariance of the latent variables of a session, and how such a vector is put in the place of others."""
    program, axes = model.program, model.program.structure.by_session
    point = with_new_session(program, model.parameters, generator)
    with jax.enable_x64(True):
        samples = jnp.asarray((taps.taps - model.scaling.centre) / model.scaling.unit)
        first, number = _last(model, point)
        story = partial(program.story, program.of(*taps.indices(model.grid), np.full(len(samples), number)), samples)
        vector, named = ravel_pytree(first)

        def in_session(latents: Parameters, vector: Any) -> Any:
            changed: dict[str, Any] = dict(latents)
            for name, values in named(vector).items():
                changed[name] = jnp.asarray(latents[name]).at[(*[slice(None)] * axes[name], -1)].set(values)
            return changed

        def negative(vector: Any) -> Any:
            return -log_density(story, (), {}, in_session(point, vector))[0]

        slope, curvature = jax.jit(jax.grad(negative)), jax.jit(jax.hessian(negative))
        for _ in range(_NEWTON):
            vector = vector - jnp.linalg.solve(curvature(vector), slope(vector))
        return np.asarray(vector), np.linalg.inv(np.asarray(curvature(vector))), in_session


def _session_prior(model: GenericModel, draws: Sequence[Parameters]) -> Callable[[Parameters], float]:
    """Log density of latent variables of the last session, integrated over draws of the others."""
    program, axes = model.program, model.program.structure.by_session
    _, number = _last(model, draws[0])
    none, (_, _, J, K) = np.zeros(1, dtype=np.intp), program.batch.shape

    def one(others: dict[str, Any], own: dict[str, Any]) -> Any:
        story = seed(partial(program.story, program.of(none, none, none + number), jnp.zeros((1, J, K))), 0)
        sites = trace(substitute(story, data=others | own)).get_trace()
        densities = {name: sites[name]["fn"].log_prob(sites[name]["value"]) for name in axes}
        return sum(jnp.take(density, -1, axis=axes[name]).sum() for name, density in densities.items())

    each = jax.jit(jax.vmap(one, (0, None)))
    others = {name: np.stack([draw[name] for draw in draws]) for name in draws[0] if name not in axes}

    def log_prior(latents: Parameters) -> float:
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            return float(log_mean(np.asarray(each(others, {name: latents[name] for name in axes}))[:, None])[0])

    return log_prior
