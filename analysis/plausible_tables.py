"""Tables that could have made the counts of fitted histograms, in their ruggedness and in what they have not shown yet.

With few samples a fitted histogram is more rugged than its truth: bins without a sample have next to no probability,
and new samples that fall there count against the true class. So tables are drawn from a Dirichlet distribution with the
counts and a prior, whose mean is a mixture of the own counts smoothed by a normal kernel along the bins, and of the
counts of all classes of the taxel. Width, weight and strength of the prior are those with the highest likelihood of
each sample given the others of its histogram (Stone 1974, J. Roy. Stat. Soc. B 36).
"""

from itertools import product
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

type Floats = NDArray[np.float64]

_WIDTHS = (0.5, 1.0, 2.0, 4.0, 8.0, np.inf)  # of the kernel, in bins
_WEIGHTS = (0.01, 0.03, 0.1, 0.3, 1.0)  # of all classes
_STRENGTHS = tuple(np.geomspace(0.1, 1e4, 16).tolist())  # of the prior, in samples; the best is refined


class PlausibleTables(NamedTuple):
    """A Dirichlet distribution of tables.

    Attributes:
        concentration: Of each bin, shape (..., K, B).
        width: Of the kernel, in bins.
        weight: Of all classes in the mean of the prior, from 0 to 1.
        strength: Of the prior, in samples.
    """

    concentration: Floats
    width: float
    weight: float
    strength: float

    @classmethod
    def of(cls, histograms: NDArray[np.integer]) -> Self:
        """Those of histograms, shape (N, K, B), each with a sample at least."""
        from scipy.optimize import minimize_scalar  # noqa: PLC0415 - SciPy takes long to import

        counts = histograms.astype(np.float64)
        B, n = counts.shape[-1], counts.sum(axis=-1, keepdims=True)
        pooled = counts.sum(axis=0, keepdims=True)
        everyone = pooled.sum(axis=-1, keepdims=True)
        cells = counts > 0  # each sample is judged by the others of its histogram
        times = counts[cells]
        rest = np.broadcast_to(n - 1, counts.shape)[cells]
        base = np.broadcast_to(pooled / (everyone - 1 + B), counts.shape)[cells]
        kernels = [_kernel(B, width) for width in _WIDTHS]
        smooth = [(counts @ kernel - np.diag(kernel))[cells] for kernel in kernels]
        near = [np.where(rest > 0, one / np.maximum(rest, 1), base) for one in smooth]

        def score(width: int, weight: float, strength: float) -> float:
            mean = (1 - weight) * near[width] + weight * base
            return float(times @ np.log(((times - 1) + strength * mean) / (rest + strength)))

        choices = product(range(len(_WIDTHS)), _WEIGHTS, _STRENGTHS)
        width, weight, strength = max(choices, key=lambda choice: score(*choice))
        ends = np.log(strength) + np.array([-1, 1]) * np.log(_STRENGTHS[1] / _STRENGTHS[0])
        found: Any = minimize_scalar(lambda x: -score(width, weight, np.exp(x)), bounds=ends, method="bounded")
        strength = float(np.exp(found.x))
        mean = (1 - weight) * (counts @ kernels[width]) / n + weight * (pooled + 1) / (everyone + B)
        return cls(counts + strength * mean, _WIDTHS[width], weight, strength)

    def draw(self, generator: np.random.Generator) -> Floats:
        """Probabilities of the bins, shape (N, K, B)."""
        alpha = self.concentration
        # A gamma variate of a small shape lies below the range of plain numbers.
        log_gamma = np.log(generator.standard_gamma(alpha + 1)) - generator.standard_exponential(alpha.shape) / alpha
        p = np.exp(log_gamma - log_gamma.max(axis=-1, keepdims=True))
        return p / p.sum(axis=-1, keepdims=True)


def _kernel(B: int, width: float) -> Floats:
    """How a sample of one bin (first axis) is spread over all."""
    apart = np.subtract.outer(np.arange(B), np.arange(B))
    weights = np.exp(-0.5 * (apart / width) ** 2)
    return weights / weights.sum(axis=1, keepdims=True)
