"""One uninterrupted stream of simulated taps; the data collection and the live rig are both made of it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.preprocessing import TapCutter
from ...models.seeds import Purpose, seed_sequence
from .nuisances import session_nuisances
from .physics import peak_depth_mm, press_profile, taxel_indentation_mm
from .settings import RigSettings
from .signal_chain import SignalChain


class TapStream:
    """A finger that taps at one place after another while lag, noise and high-pass filter run on.

    Taps made together and taps made one by one are the same.

    Args:
        settings: The rig.
        seed: The data set.
        session: The session, from which gains and mounting follow.
        purpose: Data collection or live use, so that the two draw different noise.
        number: Which stream of this session and purpose.
    """

    def __init__(self, settings: RigSettings, seed: int, session: int, purpose: Purpose, number: int) -> None:
        self._settings = settings
        self._nuisances = session_nuisances(settings, seed, session)
        hand, noise = seed_sequence(seed, purpose, session, number).spawn(2)
        self._hand = np.random.default_rng(hand)
        self._chain = SignalChain(settings, self._nuisances, noise)
        self._cutter = TapCutter(settings.preprocessing)

    def tap(self, position_mm: ArrayLike, what: int) -> NDArray[np.float64]:
        """Prepared taps at these positions in turn.

        Args:
            position_mm: Commanded positions, shape (n,).
            what: Index of the rod.

        Returns:
            Counts after the high-pass, shape (n, J, K).
        """
        counts = self._chain.read(self._indentation(np.asarray(position_mm, dtype=np.float64), what))
        return np.array([tap.samples for tap in self._cutter.push(counts)])

    def _indentation(self, position_mm: NDArray[np.float64], what: int) -> NDArray[np.float64]:
        """What the taxels see during these taps, with the robot's own imprecision; shape (n J, K)."""
        settings = self._settings
        wobble = self._hand.standard_normal((len(position_mm), 3))
        position = position_mm + self._nuisances.mounting_x_mm[what] + settings.tap_position_mm * wobble[:, 0]
        depth = np.maximum(peak_depth_mm(settings, position) + self._nuisances.mounting_y_mm[what], 0.0)
        depth *= np.exp(settings.tap_depth_log_sd * wobble[:, 1])
        profile = press_profile(settings, settings.tap_time_samples * wobble[:, 2])
        diameter = settings.rods[what].diameter_mm
        seen = taxel_indentation_mm(settings, position, diameter, depth[:, np.newaxis] * profile)
        return seen.reshape(-1, len(settings.taxels))
