"""From the parameters of the stories to the forms that give probabilities of bins.

Parameters are in units of `Scaling`, forms in those of the samples.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scaling import Scaling, least_deviation
from .forms import Form, GaussianForm, TableForm
from .masses import log_normal_mass, log_student_mass

type Parameters = Mapping[str, NDArray[np.float64]]

NO_TAXEL = np.zeros((1, 1, 0, 0))


class Measure(NamedTuple):
    """What a form needs beside parameters.

    Attributes:
        scaling: Origin and unit of each taxel.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        basis: Basis functions at Q places in each where class, shape (Q, L, D); (0, 0, 0) where there are none.
    """

    scaling: Scaling
    edges: NDArray[np.float64]
    basis: NDArray[np.float64]


def gaussian_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.gaussian` on the bins."""
    lower, upper = _standardised(parameters["level"], np.sqrt(parameters["variance"]), frame)
    return TableForm(log_normal_mass(lower, upper))


def student_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.student` on the bins."""
    lower, upper = _standardised(parameters["level"], parameters["scale"], frame)
    return TableForm(log_student_mass(lower, upper, parameters["freedom"][:, None]))


def profile_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.profile`."""
    J = parameters["level"].shape[2]
    return _gaussian(parameters["level"][None], parameters["variance"], np.eye(J)[None], NO_TAXEL, frame)


def profile_ar_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.profile_ar`: V is 1 on the diagonal and -rho below it."""
    level, rho = parameters["level"], parameters["rho"]
    J, K = level.shape[2:]
    time = np.tile(np.eye(J), (K, 1, 1))
    time[:, np.arange(1, J), np.arange(J - 1)] = -rho[:, None]
    mean = np.empty_like(level)
    mean[..., 0, :] = level[..., 0, :]
    for j in range(1, J):
        mean[..., j, :] = level[..., j, :] + rho * mean[..., j - 1, :]
    return _gaussian(mean[None], parameters["variance"], time, NO_TAXEL, frame)


def profile_mvn_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.profile_mvn`: W is 1 minus the slopes."""
    level, slope = parameters["level"], parameters["slope"]
    J, K = level.shape[2:]
    factor = np.eye(K) - slope
    mean = np.linalg.solve(factor[:, :, None], level[..., None])[..., 0]
    return _gaussian(mean[None], parameters["variance"], np.eye(J)[None], factor, frame)


def matrix_normal_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.matrix_normal`: V and W from the Cholesky factors of both covariances."""
    time, time_variance = _unit_triangular(parameters["time_covariance"])
    taxel, taxel_variance = _unit_triangular(parameters["taxel_covariance"])
    variance = time_variance[:, None] * taxel_variance[:, :, None, :]
    return _gaussian(parameters["level"][None], variance, time[None], taxel, frame)


def smooth_form(parameters: Parameters, frame: Measure) -> Form:
    """`stories.smooth` at each of Q places in a class, all as likely."""
    J = parameters["weight"].shape[1]
    mean = np.einsum("qld,mjkd->qlmjk", frame.basis, parameters["weight"], optimize=True)
    return _gaussian(mean, parameters["variance"], np.eye(J)[None], NO_TAXEL, frame)


def _standardised(
    level: NDArray[np.float64], scale: NDArray[np.float64], frame: Measure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edges of the bins in standard deviations from the level (L, M, 1, K), both (L, M, K, B); end bins are open."""
    centre, unit = frame.scaling
    K = len(unit)
    edges = (np.broadcast_to(frame.edges, (K, frame.edges.shape[-1])) - centre[:, None]) / unit[:, None]
    lower, upper = edges[:, :-1].copy(), edges[:, 1:].copy()
    lower[:, 0], upper[:, -1] = -np.inf, np.inf
    least = least_deviation(frame.edges, K)[:, None] / unit[:, None]
    level, scale = level[:, :, 0, :, None], np.maximum(scale[:, :, 0, :, None], least)
    return (lower - level) / scale, (upper - level) / scale


def _gaussian(
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    time: NDArray[np.float64],
    taxel: NDArray[np.float64],
    frame: Measure,
) -> GaussianForm:
    """A form from scaled means (Q, L, M, J, K) and innovation variances (L, M, J, K), V and W."""
    centre, unit = frame.scaling
    Q = len(mean)
    scale = np.broadcast_to(np.maximum(np.sqrt(variance) * unit, least_deviation(frame.edges, len(unit))), mean.shape)
    if taxel.shape[-1]:
        taxel = taxel * (unit[:, None] / unit)
    return GaussianForm(mean * unit + centre, scale, time, taxel, np.full(Q, -np.log(Q)))


def _unit_triangular(covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit lower triangular matrices that whiten covariances (..., D, D), and the variances then left (..., D)."""
    root = np.linalg.cholesky(covariance)
    diagonal = np.diagonal(root, axis1=-2, axis2=-1)
    return np.tril(np.linalg.inv(root) * diagonal[..., :, None]), diagonal**2
