"""Interface of the posterior of a model's parameters."""

from typing import Protocol

import numpy as np

from ..likelihood.shapes import Parameters
from .convergence import Convergence


class Posterior(Protocol):
    """Distribution of a model's parameters given the training taps."""

    def point(self) -> Parameters:
        """Point estimate of each parameter, used for decisions."""
        ...

    def draw(self, generator: np.random.Generator) -> Parameters:
        """A draw of the parameters."""
        ...

    def convergence(self) -> Convergence:
        """Convergence of the fit."""
        ...
