"""Simulated session of the paper's experiment (sec. 2.3): every object tapped along the whole range."""

import numpy as np

from ...models.errors import InputError
from ...models.taps import TapSet
from .nuisances import Purpose
from .physics import taxel_positions_mm
from .presets import preset
from .settings import RigSettings
from .tap_stream import TapStream


def simulate(rig: str | RigSettings, sessions: int = 1, seed: int = 0) -> list[TapSet]:
    """Sessions of one data set, numbered from 0; they share the sensor but differ in gains and mounting.

    >>> first, second = simulate("paper", sessions=2, seed=4)
    >>> first.taps.shape, first.what_name[:2], first.where_unit
    ((1600, 50, 12), ['4 mm rod', '6 mm rod'], 'mm')

    Args:
        rig: Settings of the rig, or the name of a preset.
        sessions: Number of sessions.
        seed: Seed of the data set.

    Raises:
        InputError: The preset is unknown, or no session is requested.
    """
    if sessions < 1:
        raise InputError(f"sessions must be at least 1, got {sessions}.")
    settings = preset(rig) if isinstance(rig, str) else rig
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
    nominal = settings.nominal_mm
    M, n = len(settings.rods), len(nominal)
    streams = [TapStream(settings, seed, session, Purpose.COLLECTION, m) for m in range(M)]
    edges = settings.where_edges_mm
    return TapSet.from_arrays(
        np.concatenate([stream.tap(nominal, m) for m, stream in enumerate(streams)]),
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
        units="counts",
        sensor="simulated fingertip (no real sensor)",
        source=f"simulated: {settings.describe()}, seed {seed}, session {session}",
        licence="none needed: simulated data",
    )
