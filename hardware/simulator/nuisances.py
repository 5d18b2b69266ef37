"""Variation between sensors and between sessions, drawn reproducibly.

Session `r` of seed `s` does not depend on the number of sessions or taps (see `models.seeds`). Presets scale the same
random numbers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.seeds import Purpose, generator
from .settings import RigSettings


class Nuisances(NamedTuple):
    """Sensor and mounting of one session.

    Attributes:
        gain_counts_per_mm: Gain of each taxel at light load, shape (K,).
        rail_counts: Reading of each taxel without load, before the limits of the converter, shape (K,).
        mounting_x_mm: Displacement of each object along the finger, shape (M,).
        mounting_y_mm: Displacement of each object towards the finger, shape (M,).
    """

    gain_counts_per_mm: NDArray[np.float64]
    rail_counts: NDArray[np.float64]
    mounting_x_mm: NDArray[np.float64]
    mounting_y_mm: NDArray[np.float64]


def session_nuisances(settings: RigSettings, seed: int, session: int) -> Nuisances:
    """Sensor of data set `seed`, as modified in session `session`.

    Sensitivity and idle reading belong to the sensor and are constant; gains and mounting vary between sessions.
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
