"""Latent variables of a session that no training tap belongs to."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import prod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpy.typing import NDArray
from numpyro.handlers import seed, trace
from numpyro.primitives import Messenger

from ..fits.posterior import Convergence, Posterior
from ..likelihood.shapes import Parameters
from .quantiles import at_quantiles
from .runs import Program, key_from


class _Known(Messenger):
    """Handler that gives latent variables their values, and those of the last session what the prior draws.

    Their prior is drawn at given quantiles, by name, where it can be.
    """

    def __init__(self, story: Any, latents: Parameters, axes: dict[str, int], quantiles: Parameters) -> None:
        self._latents, self._axes, self._quantiles = latents, axes, quantiles
        super().__init__(story)

    def process_message(self, msg: dict[str, Any]) -> None:
        name = msg["name"]
        if msg["type"] != "sample" or name not in self._latents:
            return
        values = jnp.asarray(self._latents[name])
        if name in self._axes:
            axis = self._axes[name]
            drawn = at_quantiles(msg["fn"], self._quantiles[name]) if name in self._quantiles else None
            if drawn is None:
                drawn = msg["fn"](rng_key=msg["kwargs"]["rng_key"], sample_shape=())
            values = jnp.concatenate([values, jax.lax.slice_in_dim(drawn, -1, None, axis=axis)], axis=axis)
        msg["value"] = values


class InNewSessions(NamedTuple):
    """Posterior whose draws have one session more than the training taps, drawn for each.

    Attributes:
        inner: That of the training sessions.
        program: The model.
    """

    inner: Posterior
    program: Program

    def point(self) -> Parameters:
        """Latent variables of the training sessions."""
        return self.inner.point()

    def convergence(self) -> Convergence:
        """Convergence of the fit."""
        return self.inner.convergence()

    @property
    def sizes(self) -> tuple[int, int] | None:
        """Numbers of chains and of draws of each, if it has chains."""
        return getattr(self.inner, "sizes", None)

    def at(self, chain: int, draw: int, generator: np.random.Generator) -> Parameters:
        """One draw of a chain, with a new session."""
        inner: Any = self.inner
        return with_new_session(self.program, inner.at(chain, draw, generator), generator)

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Latent variables from the posterior, with a new session."""
        return with_new_session(self.program, self.inner.draw(generator), generator)

    def together(self, generators: Sequence[np.random.Generator]) -> Iterator[Parameters]:
        """Draws, one for each generator, whose new sessions are spread evenly."""
        each = [self.inner.draw(own) for own in generators]
        return in_new_sessions(self.program, each, generators)


def in_new_sessions(
    program: Program, latents: Sequence[Parameters], generators: Sequence[np.random.Generator]
) -> Iterator[dict[str, NDArray[np.float64]]]:
    """Latent variables with one session more each, which together stand for its prior given the others.

    Sessions are at the points of a scrambled Sobol sequence where the prior has quantiles (see `quantiles`), which fill
    it more evenly than independent draws.

    Args:
        program: The model.
        latents: Its latent variables, by name, D times.
        generators: Random generators, D of them; the first one also scrambles the sequence.
    """
    from scipy.stats import qmc

    axes = program.structure.by_session
    shapes = {name: list(np.shape(latents[0][name])) for name in axes}
    for name, axis in axes.items():
        shapes[name][axis] = 1
    ends = np.cumsum([0, *map(prod, shapes.values())])
    points: Any = [None] * len(latents)
    if ends[-1] <= qmc.Sobol.MAXDIM:
        points = qmc.Sobol(int(ends[-1]), rng=generators[0]).random_base2((len(latents) - 1).bit_length())
    for own, point, known in zip(generators, points, latents, strict=False):
        parts = zip(shapes.items(), ends[:-1], ends[1:], strict=True)
        at = {} if point is None else {name: point[start:end].reshape(shape) for (name, shape), start, end in parts}
        yield with_new_session(program, known, own, at)


def with_new_session(
    program: Program, latents: Parameters, generator: np.random.Generator, quantiles: Parameters | None = None
) -> dict[str, NDArray[np.float64]]:
    """Latent variables with one session more, drawn from its prior given the others.

    Args:
        program: The model.
        latents: Its latent variables, by name.
        generator: Random generator of the draw.
        quantiles: At which those of the new session are drawn instead, by name, with one session each.
    """
    known = {name: np.asarray(values, dtype=np.float64) for name, values in latents.items()}
    with jax.enable_x64(True):
        found = _with_new_session(program, known, key_from(generator), quantiles or {})
    return {name: np.asarray(values, dtype=np.float64) for name, values in found.items()}


@partial(jax.jit, static_argnums=0)
def _with_new_session(program: Program, latents: Any, key: jax.Array, quantiles: Any) -> dict[str, jax.Array]:
    axes = program.structure.by_session
    S = latents[next(iter(axes))].shape[next(iter(axes.values()))]
    zeros, (_, _, J, K) = np.zeros(S + 1, dtype=np.intp), program.batch.shape
    batch = replace(program.batch, where=zeros, what=zeros, session=np.arange(S + 1))
    with numpyro.validation_enabled(False):
        story = seed(lambda: program.story(batch, jnp.zeros((S + 1, J, K))), key)
        sites = trace(_Known(story, latents, axes, quantiles)).get_trace()
    return {name: sites[name]["value"] for name in latents}
