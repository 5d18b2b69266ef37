"""Likelihood forms from the parameters of generative models, shared by several models.

Parameters are in units of `Scaling`, forms in those of the samples.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scaling import Scaling, least_deviation
from .forms import GaussianForm

type Parameters = Mapping[str, NDArray[np.float64]]

NO_TAXEL = np.zeros((1, 1, 0, 0))


class Measure(NamedTuple):
    """Scaling, bin edges and other constants of a form.

    Attributes:
        scaling: Origin and unit of each taxel.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        basis: Basis functions at Q places in each where class, shape (Q, L, D); (0, 0, 0) where there are none.
    """

    scaling: Scaling
    edges: NDArray[np.float64]
    basis: NDArray[np.float64]


def standardised(
    level: NDArray[np.float64], scale: NDArray[np.float64], frame: Measure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bin edges in standard deviations from the level (L, M, 1, K), both (L, M, K, B); end bins are open."""
    centre, unit = frame.scaling
    K = len(unit)
    edges = (np.broadcast_to(frame.edges, (K, frame.edges.shape[-1])) - centre[:, None]) / unit[:, None]
    lower, upper = edges[:, :-1].copy(), edges[:, 1:].copy()
    lower[:, 0], upper[:, -1] = -np.inf, np.inf
    least = least_deviation(frame.edges, K)[:, None] / unit[:, None]
    level, scale = level[:, :, 0, :, None], np.maximum(scale[:, :, 0, :, None], least)
    return (lower - level) / scale, (upper - level) / scale


def chain_form(
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    time: NDArray[np.float64],
    taxel: NDArray[np.float64],
    frame: Measure,
) -> GaussianForm:
    """Form from scaled means (Q, L, M, J, K), innovation variances (L, M, J, K), V and W."""
    centre, unit = frame.scaling
    Q = len(mean)
    scale = np.broadcast_to(np.maximum(np.sqrt(variance) * unit, least_deviation(frame.edges, len(unit))), mean.shape)
    if taxel.shape[-1]:
        taxel = taxel * (unit[:, None] / unit)
    return GaussianForm(mean * unit + centre, scale, time, taxel, np.full(Q, -np.log(Q)))
