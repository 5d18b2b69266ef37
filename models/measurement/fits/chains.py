"""Posterior given by Markov chain draws, with convergence diagnostics."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..likelihood.shapes import Parameters
from .convergence import Convergence

type Sites = dict[str, NDArray[np.float64]]

R_HAT, ESS = 1.05, 100.0
"""Limits of convergence: largest R-hat and smallest effective sample size of any parameter."""


class SamplePosterior(NamedTuple):
    """Posterior given by draws of all parameters.

    Attributes:
        samples: By name, shapes (chain, draw, ...).
        stats: `r_hat` and `ess`, the worst of all parameters, and `divergences`, how many.
    """

    samples: Sites
    stats: dict[str, float]

    def point(self) -> Parameters:
        """Posterior means."""
        return {name: values.mean(axis=(0, 1)) for name, values in self.samples.items()}

    def convergence(self) -> Convergence:
        """R-hat, effective sample size and divergences."""
        stats = self.stats
        fine = stats["r_hat"] <= R_HAT and stats["ess"] >= ESS and stats["divergences"] == 0
        sentence = (
            f"NUTS; worst R-hat {stats['r_hat']:.3f} (at most {R_HAT:g}), least effective sample size "
            f"{stats['ess']:.0f} (at least {ESS:g}), {stats['divergences']:.0f} divergences (none)."
        )
        return Convergence(fine, sentence, {name: np.array(value) for name, value in stats.items()})

    def draw(self, generator: np.random.Generator) -> Parameters:
        """One of the draws."""
        chains, draws = next(iter(self.samples.values())).shape[:2]
        chain, draw = generator.integers(chains), generator.integers(draws)
        return {name: values[chain, draw] for name, values in self.samples.items()}
