"""The posterior of a model's parameters: its interface, its convergence, and one given by Markov chain draws."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..likelihood.shapes import Parameters


class NotConvergedError(InputError):
    """A fit did not converge, and `unconverged` was not set."""


class Convergence(NamedTuple):
    """Convergence of a fit.

    Attributes:
        converged: Whether it may be used; always where the posterior is exact.
        sentence: How it was found, and what shows that it did or did not converge.
        stats: Numbers behind it, by name.
    """

    converged: bool
    sentence: str
    stats: dict[str, NDArray[np.float64]]


EXACT = Convergence(True, "The posterior is exact.", {})
EXACT_CELLS = Convergence(True, "The posterior is exact, given the prior of the variances that all classes share.", {})


def ascent(rounds: int, change: float, still: float) -> Convergence:
    """Convergence of coordinate ascent on a factorised posterior.

    Args:
        rounds: How many it took.
        change: Change by the last round.
        still: The change that counts as none.
    """
    sentence = (
        f"Factorised posterior by coordinate ascent, {rounds} rounds; the last changed it by {change:.2g} "
        f"(at most {still:g})."
    )
    return Convergence(change <= still, sentence, {"rounds": np.array(float(rounds)), "change": np.array(change)})


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
