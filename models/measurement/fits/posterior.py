"""What is known of a model's parameters after training."""

from typing import Protocol

import numpy as np

from ..likelihood.shapes import Parameters
from .convergence import Convergence


class Posterior(Protocol):
    """The distribution of a model's parameters given the training taps."""

    def point(self) -> Parameters:
        """One value of each parameter, with which the model decides."""
        ...

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Parameters from the posterior."""
        ...

    def convergence(self) -> Convergence:
        """How it was found."""
        ...
