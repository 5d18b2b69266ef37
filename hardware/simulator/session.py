"""Simulated sessions of the paper's experiment (sec. 2.3): every object tapped along the whole range."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.cutting.tap_cutter import TapCutter
from ...models.errors import check_count
from ...models.seeds import Purpose, seed_sequence
from ...models.taps import RIG_UNIT, TapSet
from .physics import peak_depth_mm, press_profile, taxel_indentation_mm, taxel_positions_mm
from .settings import RigSettings, settings_of
from .signal_chain import SignalChain, session_nuisances


def simulate(rig: str | RigSettings | Callable[..., Any], sessions: int = 1, seed: int = 0) -> list[TapSet]:
    """Sessions of one data set, numbered from 0; they share the sensor but differ in gains and mounting.

    >>> first, second = simulate("paper", sessions=2, seed=4)
    >>> first.taps.shape, first.what_name[:2], first.where_unit
    ((1600, 50, 12), ['4 mm rod', '6 mm rod'], 'mm')

    Args:
        rig: Settings of the rig, or the name of a preset; or a NumPyro function, see docs/how-to/your-own-model.md,
            from whose prior come 20 taps of each class of the preset `paper`.
        sessions: Number of sessions.
        seed: Seed of the data set.

    Raises:
        InputError: The preset is unknown, or no session is requested.
    """
    check_count(sessions, "sessions")
    if callable(rig):
        from .model_rig import draw_from_prior  # noqa: PLC0415 - loads what a simulated rig does without

        like = simulate_session(settings_of("paper"), seed, 0)
        return [draw_from_prior(rig, like, 20, seed, session) for session in range(sessions)]
    settings = settings_of(rig)
    return [simulate_session(settings, seed, session) for session in range(sessions)]


def simulate_session(settings: RigSettings, seed: int, session: int) -> TapSet:
    """All taps of one session; each object gives one stream from the lower to the upper end of the range.

    Args:
        settings: Settings of the rig.
        seed: Seed of the data set; its sessions share the sensor.
        session: Number of the session; gains and mounting differ between sessions.

    Returns:
        Taps in counts after the high-pass filter, with commanded positions in mm as `where`.
    """
    return cut_session(settings, seed, session, session_counts(settings, seed, session))


def session_counts(settings: RigSettings, seed: int, session: int) -> NDArray[np.uint8]:
    """Counts of the converter in one session, which do not depend on the high-pass filter.

    Args:
        settings: Settings of the rig.
        seed: Seed of the data set.
        session: Number of the session.

    Returns:
        A stream of frames for each object, shape (M, n J, K).
    """
    streams = (
        TapStream(settings, seed, session, Purpose.COLLECTION, m).counts(settings.nominal_mm, m)
        for m in range(len(settings.rods))
    )
    return np.array([counts.astype(np.uint8) for counts in streams])


def cut_session(settings: RigSettings, seed: int, session: int, counts: NDArray[np.uint8]) -> TapSet:
    """As `simulate_session`, from the counts of `session_counts` under settings that may differ in the high-pass."""
    nominal = settings.nominal_mm
    M, n = len(settings.rods), len(nominal)
    taps = [tap.samples for frames in counts for tap in TapCutter(settings.preprocessing).push(frames)]
    edges = settings.where_edges_mm
    return TapSet.from_arrays(
        np.array(taps),
        np.repeat(np.arange(M), n),
        [rod.name for rod in settings.rods],
        preprocessing=settings.preprocessing,
        where=np.tile(nominal, M),
        where_value=(edges[:-1] + edges[1:]) / 2,
        where_edges=edges,
        where_unit="mm",
        what_value=[rod.diameter_mm for rod in settings.rods],
        what_unit="mm",
        session=np.full(M * n, session),
        trial=np.tile(np.arange(n), M),
        taxel_position=taxel_positions_mm(settings.taxels),
        units=RIG_UNIT,
        sensor="simulated fingertip (no real sensor)",
        source=f"simulated: {settings.describe()}, seed {seed}, session {session}",
        licence="none needed: simulated data",
    )


def sensor_seed(source: str) -> int | None:
    """Seed of the simulated sensor from which taps come, by their `source`; `None` if they come from another.

    >>> sensor_seed(simulate("ideal", seed=4)[0].source)
    4
    """
    found = re.fullmatch(r"simulated: .*, seed (\d+), session \d+", source)
    return None if found is None else int(found[1])


class TapStream:
    """A finger that taps at successive positions while lag, noise and high-pass filter continue.

    Taps do not depend on whether they are made together or one by one.

    Args:
        settings: Settings of the rig.
        seed: Seed of the data set.
        session: Session that sets gains and mounting.
        purpose: Data collection or live use; the two have independent noise.
        number: Number of the stream in this session and purpose.
        noise_seed: Seed of the noise and of the robot's inaccuracy; default: `seed`.
    """

    def __init__(
        self,
        settings: RigSettings,
        seed: int,
        session: int,
        purpose: Purpose,
        number: int,
        noise_seed: int | None = None,
    ) -> None:
        check_count(session, "session", 0)
        check_count(number, "run", 0)
        self._settings = settings
        self._nuisances = session_nuisances(settings, seed, session)
        hand, noise = seed_sequence(seed if noise_seed is None else noise_seed, purpose, session, number).spawn(2)
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
        return np.array([tap.samples for tap in self._cutter.push(self.counts(position_mm, what))])

    def counts(self, position_mm: ArrayLike, what: int) -> NDArray[np.float64]:
        """Counts of the converter during taps at these positions in turn, whole numbers up to 255, shape (n J, K)."""
        return self._chain.read(self._indentation(np.asarray(position_mm, dtype=np.float64), what))

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
