"""Uninterrupted stream of simulated taps, for the data collection and the live rig."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.preprocessing import TapCutter
from ...models.seeds import Purpose, seed_sequence
from .nuisances import session_nuisances
from .physics import peak_depth_mm, press_profile, taxel_indentation_mm
from .settings import RigSettings
from .signal_chain import SignalChain


class TapStream:
    """A finger that taps at successive positions while lag, noise and high-pass filter continue.

    Taps do not depend on whether they are made together or one by one.

    Args:
        settings: Settings of the rig.
        seed: Seed of the data set.
        session: Session that sets gains and mounting.
        purpose: Data collection or live use; the two have independent noise.
        number: Number of the stream in this session and purpose.
    """

    def __init__(self, settings: RigSettings, seed: int, session: int, purpose: Purpose, number: int) -> None:
        self._settings = settings
        self._nuisances = session_nuisances(settings, seed, session)
        hand, noise = seed_sequence(seed, purpose, session, number).spawn(2)
        self._hand = np.random.default_rng(hand)
        self._chain = SignalChain(settings, self._nuisances, noise)
        self._cutter = TapCutter(settings.preprocessing)

    def tap(self, position_mm: ArrayLike, what: int) -> NDArray[np.float64]:
        """Preprocessed taps at these positions in turn.

        Args:
            position_mm: Commanded positions, shape (n,).
            what: Index of the object.

        Returns:
            Counts after the high-pass filter, shape (n, J, K).
        """
        counts = self._chain.read(self._indentation(np.asarray(position_mm, dtype=np.float64), what))
        return np.array([tap.samples for tap in self._cutter.push(counts)])

    def _indentation(self, position_mm: NDArray[np.float64], what: int) -> NDArray[np.float64]:
        """Indentation of the taxels during these taps in mm, with the robot's inaccuracy; shape (n J, K)."""
        settings = self._settings
        wobble = self._hand.standard_normal((len(position_mm), 3))
        position = position_mm + self._nuisances.mounting_x_mm[what] + settings.tap_position_mm * wobble[:, 0]
        depth = np.maximum(peak_depth_mm(settings, position) + self._nuisances.mounting_y_mm[what], 0.0)
        depth *= np.exp(settings.tap_depth_log_sd * wobble[:, 1])
        profile = press_profile(settings, settings.tap_time_samples * wobble[:, 2])
        diameter = settings.rods[what].diameter_mm
        seen = taxel_indentation_mm(settings, position, diameter, depth[:, np.newaxis] * profile)
        return seen.reshape(-1, len(settings.taxels))
