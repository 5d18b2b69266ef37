"""Latent variables of a session that no training tap belongs to."""

from dataclasses import replace
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
from .form import Program, key_from


class _Known(Messenger):
    """Handler that gives latent variables their values, and those of the last session what the prior draws."""

    def __init__(self, story: Any, latents: Parameters, axes: dict[str, int]) -> None:
        self._latents, self._axes = latents, axes
        super().__init__(story)

    def process_message(self, msg: dict[str, Any]) -> None:
        name = msg["name"]
        if msg["type"] != "sample" or name not in self._latents:
            return
        values = jnp.asarray(self._latents[name])
        if name in self._axes:
            axis = self._axes[name]
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


def with_new_session(
    program: Program, latents: Parameters, generator: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Latent variables with one session more, drawn from its prior given the others.

    Args:
        program: The model.
        latents: Its latent variables, by name.
        generator: Random generator of the draw.
    """
    axes = program.structure.by_session
    S = np.shape(latents[next(iter(axes))])[next(iter(axes.values()))]
    zeros, (_, _, J, K) = np.zeros(S + 1, dtype=np.intp), program.batch.shape
    batch = replace(program.batch, where=zeros, what=zeros, session=np.arange(S + 1))
    with jax.enable_x64(True), numpyro.validation_enabled(False):
        story = seed(lambda: program.story(batch, jnp.zeros((S + 1, J, K))), key_from(generator))
        sites = trace(_Known(story, latents, axes)).get_trace()
    return {name: np.asarray(sites[name]["value"], dtype=np.float64) for name in latents}
