"""Other thresholds: with the error that the one in use promises, and with a wanted one."""

from typing import NamedTuple

import numpy as np

from ..experiment.parts import AuditParts
from ..stats.target_error import TargetError, session_curves, target_error
from .remedies import Remedy
from .remedy_scores import Measured
from .verdict import recommended


class Recalibrated(NamedTuple):
    """The threshold at which decisions on tuning taps err as rarely as the threshold in use promises.

    Attributes:
        target: What it promises, 1 - theta.
        reached: Whether any threshold does.
        threshold: The smallest that does, or the one with the fewest errors.
        tuned: P(wrong) on the tuning taps.
        error: P(wrong) on the measuring taps.
        taps: Mean reaction time there.
        before: P(wrong) on the measuring taps at the threshold in use.
        taps_before: Mean reaction time there.
        tuning: P(wrong) of each tuning session at the threshold in use.
    """

    target: float
    reached: bool
    threshold: float
    tuned: float
    error: float
    taps: float
    before: float
    taps_before: float
    tuning: tuple[float, ...]


def recalibrate(base: Remedy, parts: AuditParts, trials: int, seed: int) -> Recalibrated:
    """See `Recalibrated`; `base` is the setting in use, of which so many trials are played."""
    play = base.setting.play
    tuned, measured = (
        session_curves(
            base.model,
            sessions,
            base.grid,
            seed=seed,
            trials=trials,
            play=play,
            fresh=True,
        )[0]
        for sessions in (parts.tune, [parts.measure])
    )
    error, target = tuned.error.mean(axis=0), 1 - play.threshold
    fine = np.flatnonzero(error <= target)
    h = int(fine[0]) if len(fine) else int(error.argmin())
    usual = int(np.searchsorted(tuned.theta, play.threshold))
    return Recalibrated(
        target=target,
        reached=bool(len(fine)),
        threshold=float(tuned.theta[h]),
        tuned=float(error[h]),
        error=float(measured.error[0, h]),
        taps=float(measured.taps[0, h]),
        before=float(measured.error[0, usual]),
        taps_before=float(measured.taps[0, usual]),
        tuning=tuple(tuned.error[:, usual].tolist()),
    )


def tune_threshold(
    remedies: list[Remedy], measured: Measured, parts: AuditParts, wanted: float, seed: int
) -> TargetError:
    """The threshold for the wanted error, with the model that is recommended."""
    name = recommended(measured) or remedies[0].name
    chosen = next(remedy for remedy in remedies if remedy.name == name)
    return target_error(chosen.model, parts.tune, wanted, chosen.grid, seed=seed, play=chosen.setting.play)
