"""Correction of Student's t intervals of means over few clusters for the skewness of these (Hall 1992)."""

import numpy as np
from numpy.typing import NDArray

type Floats = NDArray[np.float64]


def skewness_of_mean(without: Floats, sizes: NDArray[np.intp], alike: float) -> Floats:
    """Skewness of the mean over all taps, from what it is without each cluster.

    The means of clusters count alike in it: weighted by their taps, a large cluster would move the mean and the
    skewness the same way, and intervals of unskewed clusters would cover too little.

    Args:
        without: Mean without each cluster, shape (..., C).
        sizes: Taps of each cluster, shape (C,).
        alike: Equivalent number of clusters of one size.

    Returns:
        Of shape (...); 0 if all clusters have the same mean.
    """
    means = (without.mean(axis=-1, keepdims=True) - without) * (sizes.sum() / sizes - 1)  # but for a number for all
    apart = means - means.mean(axis=-1, keepdims=True)
    second, third = ((apart**power).mean(axis=-1) for power in (2, 3))
    return np.divide(third, second**1.5, out=np.zeros_like(third), where=second > 0) / np.sqrt(alike)


def skewed_quantile(quantile: Floats, skewness: Floats) -> Floats:
    """Quantile of the t statistic of a mean of some skewness, where that of a mean without any has `quantile`.

    It inverts the cubic transformation that removes the skewness (P. Hall, On the removal of skewness by
    transformation, J. R. Stat. Soc. B 54 (1992) 221), written without a division by the skewness, which may be 0.
    """
    moved = quantile - skewness / 6
    root = np.cbrt(1 + skewness * moved)
    return 3 * moved / (root**2 + root + 1)
