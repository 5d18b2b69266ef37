"""Checks that training taps are sufficient for a model."""

import numpy as np

from ...errors import InputError
from .priors import Taps

FEWEST_PLACES = 3


def check_cells(name: str, taps: Taps) -> None:
    """Checks the taps of a model without times: samples of a class must vary.

    Raises:
        InputError: There is one sample per tap, and on average less than two taps per class.
    """
    if taps.samples.shape[1] == 1:
        _check_repeats(f"{name} with one sample per tap", taps)


def check_times(name: str, taps: Taps) -> None:
    """Checks the taps of a model with a profile in time.

    Raises:
        InputError: There is one sample per tap, or on average less than two taps per class.
    """
    if taps.samples.shape[1] == 1:
        raise InputError(f"{name} needs more than one sample per tap; use gaussian or profile-mvn for one.")
    _check_repeats(name, taps)


def check_taxels(name: str, taps: Taps) -> None:
    """Checks the taps of a model with correlated taxels.

    Raises:
        InputError: There is one taxel, or on average less than two taps per class.
    """
    if taps.samples.shape[2] == 1:
        raise InputError(f"{name} needs more than one taxel.")
    _check_repeats(name, taps)


def check_places(name: str, taps: Taps) -> None:
    """Checks the taps of a model of curves over position.

    Raises:
        InputError: There are less than three positions, or on average less than two taps per class.
    """
    places = len(np.unique(taps.place))
    if places < FEWEST_PLACES:
        raise InputError(f"{name} needs at least {FEWEST_PLACES} positions, got {places}.")
    _check_repeats(name, taps)


def _check_repeats(name: str, taps: Taps) -> None:
    _, M = taps.shape
    classes = len(np.unique(taps.where * M + taps.what))
    if len(taps.where) < 2 * classes:
        raise InputError(f"{name} needs at least two taps per class, got {len(taps.where)} taps for {classes} classes.")
