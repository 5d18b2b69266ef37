"""Posteriors of the latent variables of a generative model, as its fits give them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from ..fits.posterior import Convergence, SamplePosterior
from ..likelihood.shapes import Parameters
from .runs import key_from


class GuidePosterior(NamedTuple):
    """Posterior given by a guide of NumPyro.

    Attributes:
        centre: Latent variables at the mean of the unconstrained ones, by name.
        sampled: From a key of JAX to a draw.
        told: How it was found.
    """

    centre: Parameters
    sampled: Callable[[Any], dict[str, Any]]
    told: Convergence

    def point(self) -> Parameters:
        """Latent variables at the mean of the unconstrained ones."""
        return self.centre

    def convergence(self) -> Convergence:
        """Convergence of the fit."""
        return self.told

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Latent variables from the posterior."""
        with jax.enable_x64(True):
            found = self.sampled(key_from(generator))
        return {name: np.asarray(found[name], dtype=np.float64) for name in self.centre}


class ChainPosterior(NamedTuple):
    """Posterior given by Markov chains.

    Attributes:
        centre: As in `GuidePosterior`.
        chains: All draws.
    """

    centre: Parameters
    chains: SamplePosterior

    def point(self) -> Parameters:
        """Latent variables at the mean of the unconstrained ones."""
        return self.centre

    def convergence(self) -> Convergence:
        """R-hat, effective sample size and divergences."""
        return self.chains.convergence()

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of chains and of draws of each."""
        return self.chains.sizes

    def at(self, chain: int, draw: int, generator: np.random.Generator) -> Parameters:
        """One draw of a chain."""
        return self.chains.at(chain, draw, generator)

    def draw(self, generator: np.random.Generator) -> Parameters:
        """One of the draws."""
        return self.chains.draw(generator)
