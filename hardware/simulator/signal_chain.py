"""Signal chain from taxel indentation to counts of an 8-bit capacitive converter; stateful across calls.

What varies from session to session is drawn here, too: session `r` of seed `s` does not depend on the number of
sessions or taps (see `models.seeds`). Presets scale the same random numbers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.first_order import FirstOrder
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


FULL_SCALE = 255


class FirstOrderNoise:
    """Gaussian noise `y[t] = decay y[t-1] + step e[t]`: white, AR(1) or random walk, drawn in pieces.

    Args:
        generator: Random generator for this noise only, so that the numbers do not depend on the pieces.
        width: Number of independent columns.
        decay: 0 for white noise, 1 for a random walk.
        step: Standard deviation of a step.
        start: Standard deviation before the first sample.
    """

    def __init__(self, generator: np.random.Generator, width: int, decay: float, step: float, start: float) -> None:
        self._generator = generator
        self._width = width
        self._decay = decay
        self._step = step
        self._state = decay * start * generator.standard_normal(width)

    def draw(self, n: int) -> NDArray[np.float64]:
        """Next `n` samples, shape (n, width)."""
        if self._step == 0:
            return np.zeros((n, self._width))
        steps = self._step * self._generator.standard_normal((n, self._width))
        if self._decay == 0:
            return steps
        return FirstOrder(1.0, 0.0, self._decay)(steps, self._state)


class SensorNoise:
    """Sum of white, autocorrelated, common and drifting noise of all taxels, in counts.

    Args:
        settings: Settings of the rig.
        seeds: Seeds of this noise.
    """

    def __init__(self, settings: RigSettings, seeds: np.random.SeedSequence) -> None:
        generators = [np.random.default_rng(child) for child in seeds.spawn(4)]
        rho, step = settings.noise_correlation, np.sqrt(1 - settings.noise_correlation**2)
        taxel, common = settings.taxel_noise_counts, settings.common_noise_counts
        self._K = K = len(settings.taxels)
        self._parts = (
            FirstOrderNoise(generators[0], K, 0.0, settings.white_counts, 0.0),
            FirstOrderNoise(generators[1], K, rho, step * taxel, taxel),
            FirstOrderNoise(generators[2], 1, rho, step * common, common),
            FirstOrderNoise(generators[3], K, 1.0, settings.walk_counts, 0.0),
        )

    def draw(self, n: int) -> NDArray[np.float64]:
        """Next `n` samples, shape (n, K)."""
        return sum((part.draw(n) for part in self._parts), start=np.zeros((n, self._K)))


class SignalChain:
    """Foam lag, compressive gain, noise, converter and sample-and-hold of all taxels.

    Args:
        settings: Settings of the rig.
        nuisances: Gains and idle readings of the session.
        seeds: Seeds of the noise of this stream.
    """

    def __init__(self, settings: RigSettings, nuisances: Nuisances, seeds: np.random.SeedSequence) -> None:
        K = len(settings.taxels)
        self._settings = settings
        self._nuisances = nuisances
        self._noise = SensorNoise(settings, seeds)
        self._decay = float(np.exp(-1 / (settings.lag_s * settings.rate_hz))) if settings.lag_s else 0.0
        self._lag = np.zeros(K)
        self._held = np.zeros(K)
        self._frames = 0

    def read(self, indentation_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Counts of the next frames, integers in [0, 255] that rise under load, shape (n, K).

        Args:
            indentation_mm: Indentation of each taxel, shape (n, K).
        """
        if len(indentation_mm) == 0:
            return np.empty_like(indentation_mm)
        lagged = FirstOrder(1 - self._decay, 0.0, self._decay)(indentation_mm, self._lag)
        return self._hold(converted(self._settings, self._nuisances, lagged, self._noise.draw(len(lagged))))

    def _hold(self, counts: NDArray[np.float64]) -> NDArray[np.float64]:
        n, hold = len(counts), self._settings.hold_samples
        source = np.arange(n) - (self._frames + np.arange(n)) % hold
        held = np.concatenate([self._held[np.newaxis], counts])[np.maximum(source + 1, 0)]
        self._frames += n
        self._held = held[-1]
        return held


def converted(
    settings: RigSettings, nuisances: Nuisances, lagged_mm: NDArray[np.float64], noise: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Counts after compressive gain, noise and converter: integers in [0, 255] that rise under load.

    Args:
        settings: Settings of the rig.
        nuisances: Gains and idle readings of the session.
        lagged_mm: Indentation of each taxel after the foam's lag, shape (..., K).
        noise: Counts to add before the converter; same shape.
    """
    signal = nuisances.gain_counts_per_mm * lagged_mm / (1 + lagged_mm / settings.compression_mm)
    return FULL_SCALE - np.clip(np.rint(nuisances.rail_counts - signal + noise), 0, FULL_SCALE)
