"""Posteriors of cells shared by several models; a cell is a class, time and taxel with a level and a variance.

Given what the cells share, each is a normal regression with conjugate prior, so its posterior is normal-inverse-gamma
in closed form (Gelman et al., "Bayesian Data Analysis", 3rd ed., sec. 3.3 and 14.2). The prior of the variances, which
they share, is found from all of them by maximal evidence.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammaln

from .posterior import EXACT_CELLS, Convergence
from .priors import CellPrior, Taps

CELL = ("where", "what", "sample", "taxel")
"""Dims of one number per cell."""
WEAK_CELLS = CellPrior(0.0, 0.01, 2.0, 2.0)
"""Prior of a story that is given none: levels within ten standard deviations of the mean of a taxel."""
_LEAST = 1e-4  # of the variances that a prior expects, in units of `Scaling`


class Cells(NamedTuple):
    """Normal-inverse-gamma posterior of every cell; arrays of shape (L, M, J, K), J = 1 without times.

    Attributes:
        level: Expected level.
        strength: How many samples that is worth.
        a: Shape of the inverse gamma distribution of the variance.
        b: Its rate.
    """

    level: NDArray[np.float64]
    strength: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected level and variance."""
        return {"level": self.level, "variance": self.b / np.maximum(self.a - 1, 0.5 * self.a)}

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """A level and variance of each cell from the posterior."""
        variance = self.b / generator.standard_gamma(self.a)
        spread = np.sqrt(variance / np.maximum(self.strength, 1.0))  # only cells without a tap have less
        level = self.level + spread * generator.standard_normal(variance.shape)
        return {"level": level, "variance": variance}


def cell_posterior(
    count: NDArray[np.float64], mean: NDArray[np.float64], square: NDArray[np.float64], prior: CellPrior
) -> Cells:
    """The posterior of cells.

    Args:
        count: Samples of each cell, broadcast over the others.
        mean: Their mean.
        square: Sum of squared deviations from it.
        prior: The prior.
    """
    strength = prior.strength + count
    share = prior.strength / np.maximum(strength, 1e-300)
    b = prior.b + 0.5 * (square + share * count * (mean - prior.level) ** 2)
    # A flat level takes one degree of freedom from the variance.
    freedom = count if prior.strength > 0 else np.maximum(count - 1, 0.0)
    return Cells(
        level=share * prior.level + (1 - share) * mean,
        strength=np.broadcast_to(strength, b.shape),
        a=np.broadcast_to(prior.a + 0.5 * freedom, b.shape),
        b=b,
    )


def estimated_prior(freedom: NDArray[np.float64], square: NDArray[np.float64]) -> CellPrior:
    """Empirical-Bayes inverse gamma prior of the variances of each taxel; flat for the levels.

    Args:
        freedom: Degrees of freedom of each cell, broadcast over (L, M, J, K); cells without any are ignored.
        square: Sums of squared deviations, shape (L, M, J, K).
    """
    K = square.shape[-1]
    freedom = np.broadcast_to(freedom, square.shape)
    a, b = np.empty(K), np.empty(K)
    for k in range(K):
        used = freedom[..., k] > 0
        if not used.any():  # no sample of this taxel is there
            a[k], b[k] = WEAK_CELLS.a, WEAK_CELLS.b
            continue
        a[k], b[k] = _most_probable(freedom[..., k][used] / 2, square[..., k][used] / 2)
    return CellPrior(0.0, 0.0, a, b)


def _most_probable(freedom: NDArray[np.float64], half: NDArray[np.float64]) -> tuple[float, float]:
    """Shape and rate of the most probable prior, from half the degrees of freedom and half the squares of cells."""
    from scipy.optimize import minimize  # a tenth of the imports, for nothing else

    typical = np.log(max(float(np.median(half / freedom)), _LEAST))
    bounds = [(np.log(0.25), np.log(1e3)), (np.log(_LEAST), typical + 7.0)]
    values, counts = np.unique(freedom, return_counts=True)  # few, and functions of them are slow
    share = counts / len(freedom)

    def loss(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Mean negative log evidence and its slopes."""
        a = np.exp(x[0])
        b = a * np.exp(x[1])
        rate = b + half
        logs = np.log(rate)
        evidence = a * np.log(b) - gammaln(a) + share @ gammaln(a + values) - ((a + freedom) * logs).mean()
        over_a = a * (np.log(b) - digamma(a) + share @ digamma(a + values) - logs.mean())
        over_b = a - b * float(((a + freedom) / rate).mean())
        return -float(evidence), -np.array([over_a + over_b, over_b])

    found = minimize(loss, np.array([0.0, typical]), jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(np.exp(found[0])), float(np.exp(found[0] + found[1]))


class CellPosterior(NamedTuple):
    """Posterior of `gaussian` and `profile`.

    Attributes:
        cells: Posterior of the cells.
        prior: Theirs.
    """

    cells: Cells
    prior: CellPrior

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected parameters."""
        return self.cells.point()

    def convergence(self) -> Convergence:
        """Convergence: always exact."""
        return EXACT_CELLS

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior."""
        return self.cells.draw(generator)


def prior_of_cells(_: Taps, posterior: Any) -> dict[str, CellPrior]:
    """Prior argument of the cell models: the prior that the closed-form fit estimated."""
    return {"prior": posterior.prior}
