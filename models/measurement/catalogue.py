"""Fits any measurement model by name, see `registry`."""

import numpy as np

from ..errors import InputError, check_numbers
from ..grid import ClassGrid
from ..settings import FitSettings
from ..taps import TapSet
from ..threads import one_blas_thread
from .fits.posterior import NotConvergedError
from .model import Fitted
from .registry import measurement_model, split_name
from .shared_gain import with_shared_gain


def fit_model(name: str, taps: TapSet, grid: ClassGrid, settings: FitSettings, trained_on: str = "") -> Fitted:
    """Fitted measurement model, with its posterior and convergence.

    Args:
        name: Name of the model.
        taps: Training taps.
        grid: The classes.
        settings: How.
        trained_on: Description of the training taps.

    Raises:
        InputError: The model is unknown, the taps are not sufficient, or an argument is out of range.
        NotConvergedError: The fit did not converge, and `unconverged` is not set.
    """
    kind, in_states = split_name(name)
    settings = _checked(settings, taps)
    with one_blas_thread():
        fitted = measurement_model(kind).fit(taps, grid, settings, trained_on)
    if not (fitted.convergence.converged or settings.unconverged):
        raise NotConvergedError(
            f"{name} did not converge: {fitted.convergence.sentence} Use it anyway with --allow-unconverged."
        )
    return with_shared_gain(fitted, taps, grid, settings.gain_sd, settings.offset_sd) if in_states else fitted


def _checked(settings: FitSettings, taps: TapSet) -> FitSettings:
    """Settings with valid edges, and with the number of bins that these define."""
    if settings.edges is None:
        return settings
    edges, K = check_numbers(settings.edges, "edges").astype(np.float64), taps.dataset.sizes["taxel"]
    if edges.shape[:-1] not in {(), (K,)} or edges.ndim == 0 or edges.shape[-1] < 2:
        raise InputError(f"edges must have shape (B + 1,) or ({K}, B + 1), got {edges.shape}.")
    if not (np.isfinite(edges).all() and (np.diff(edges) > 0).all()):
        raise InputError("edges must be finite and increase.")
    return settings.changed(edges=edges, bins=edges.shape[-1] - 1)
