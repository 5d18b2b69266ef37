"""What differs between sensors and between sessions, drawn reproducibly.

Session `r` of seed `s` is the same however many sessions or taps are made (see `models.seeds`), and presets differ by
their sizes only, not by other random numbers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.seeds import Purpose, generator
from .settings import RigSettings


class Nuisances(NamedTuple):
    """One session's sensor and mounting.

    Attributes:
        gain_counts_per_mm: Of each taxel at light load, shape (K,).
        rail_counts: Reading of each taxel without load, before the limits of the converter, shape (K,).
        mounting_x_mm: Displacement of each rod along the finger, shape (M,).
        mounting_y_mm: Displacement of each rod towards the finger, shape (M,).
    """

    gain_counts_per_mm: NDArray[np.float64]
    rail_counts: NDArray[np.float64]
    mounting_x_mm: NDArray[np.float64]
    mounting_y_mm: NDArray[np.float64]


def session_nuisances(settings: RigSettings, seed: int, session: int) -> Nuisances:
    """The sensor of data set `seed` and what session `session` makes of it.

    Sensitivity and idle reading belong to the sensor and stay; gains drift and rods are mounted anew.
    """
    K = len(settings.taxels)
    sensor = generator(seed, Purpose.SENSOR).standard_normal((2, K))
    drift = generator(seed, Purpose.SESSION, session).standard_normal(1 + K)
    mounting = np.array(
        [generator(seed, Purpose.MOUNTING, session, m).standard_normal(2) for m in range(len(settings.rods))]
    )
    log_gain = (
        settings.sensitivity_log_sd * sensor[0]
        + settings.session_gain_log_sd * drift[0]
        + settings.session_taxel_gain_log_sd * drift[1:]
    )
    return Nuisances(
        gain_counts_per_mm=settings.gain_counts_per_mm * np.exp(log_gain),
        rail_counts=settings.rail_counts + settings.rail_sd_counts * sensor[1],
        mounting_x_mm=settings.mounting_x_mm * mounting[:, 0],
        mounting_y_mm=settings.mounting_y_mm * mounting[:, 1],
    )
