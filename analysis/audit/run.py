"""Audit of the naive-Bayes assumption on recorded taps: where it fails, what that costs, which remedy helps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.trials.records import tap_table
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from ...models.setting_file import Setting
from ...models.taps import TapSet, concatenate
from ...models.threads import one_blas_thread
from ..experiment.parts import AuditParts
from ..page.stages import Progress, StageClock
from ..stats.evidence import evidence
from ..stats.reliability import THETAS
from ..stats.right_exponent import SIMULATIONS as RIGHT_EXPONENTS
from ..stats.target_error import FEWEST, TargetError, session_curves, target_error
from .checks import audit_checks, count_replicates
from .dependence.drift import Contrasts, against_drift, contrasts, recorded_time
from .dependence.strata import evenly, strata
from .dependence.taxels import taxel_dependence
from .dependence.times import time_dependence
from .detectable import Detectable, enough
from .guarantees import PromiseTest, exceeded, guarantees
from .leakage.run import Leakage, leakage
from .remedies import RefusedRemedy, Remedy, beside_right, count_remedies, make_remedies
from .remedy_scores import Measured, count_measurements, measure
from .variance.causes import SEQUENCE, split_variance
from .variance.gains import Components, variance_components
from .variance.split import session_p
from .variance.suspects import Suspect, named_suspects
from .verdict import NOT_ENOUGH, calibration, recommended

SESSION_PERMUTATIONS = 999
"""Of the test of sessions at least: with few its p-value never falls below the level at which sessions are named."""

MOST_TAPS = 60
"""Of one class and session that are tested and judged; more would take minutes and tell little more."""


@dataclass(frozen=True)
class AuditSettings:
    """Everything that changes the numbers of an audit.

    Attributes:
        setting: How perception is done now, with the paper's histogram.
        target_error: Wanted P(wrong), for which a threshold is tuned; `None` for none.
        pre: Samples at the beginning of each tap that are before contact; `None` for what the taps' record says.
        covariates: Extra arrays of the taps that are suspected of making evidence vary.
        permutations: Of every test.
        trials: Of each remedy and policy.
        seed: Of every random draw.
    """

    setting: Setting = field(default_factory=Setting)
    target_error: float | None = None
    pre: int | None = None
    covariates: tuple[str, ...] = ()
    permutations: int = 999
    trials: int = 4000
    seed: int = 0


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


class Audit(NamedTuple):
    """What came out.

    Attributes:
        parts: Which taps did what.
        grid: The classes.
        leakage: What is told without touch.
        taxels: See `dependence.taxels` and `dependence.drift.against_drift`.
        times: See `dependence.times`.
        by_session: Whether taps were exchanged within sessions only; otherwise sessions had one tap of a class each.
        components: Gains and offsets of taps and sessions.
        split: The variance of evidence by cause; `None` where evidence cannot be judged.
        no_split: Why not, in a sentence.
        session_p: Of the test of sessions.
        checks: Replicates of statistics from the fitted model.
        remedies: The setting as it is first.
        refused: Remedies that the taps do not allow.
        measured: What they buy.
        enough: What other designs could detect, where data are not enough to tell whether beliefs are right.
        reliability: Of the setting as it is.
        guarantees: Likewise.
        exceeded: Which promises are, at the threshold in use.
        recalibrated: Another threshold.
        target: The threshold for a wanted error, with the model of the chosen remedy; `None` where none was wanted.
        samples_per_bin: Training samples in each bin that a histogram uses, the median over histograms.
        unused: Measuring taps of classes that were not trained.
        elapsed_s: Seconds per stage.
    """

    parts: AuditParts
    grid: ClassGrid
    leakage: Leakage
    taxels: xr.Dataset
    times: xr.Dataset
    by_session: bool
    components: Components
    split: xr.Dataset | None
    no_split: str
    session_p: float
    checks: xr.DataTree
    remedies: list[Remedy]
    refused: list[RefusedRemedy]
    measured: Measured
    enough: list[Detectable]
    guarantees: xr.Dataset
    exceeded: dict[str, PromiseTest]
    recalibrated: Recalibrated
    target: TargetError | None
    samples_per_bin: float
    unused: int
    elapsed_s: dict[str, float]


@one_blas_thread()
def audit_taps(parts: AuditParts, grid: ClassGrid, settings: AuditSettings, progress: Progress) -> Audit:
    """Audits.

    Args:
        parts: The taps, see `audit_parts`.
        grid: The classes.
        settings: What to do.
        progress: Called with the name and size of every stage; returns the function that advances it.

    Raises:
        InputError: A setting is wrong, or the taps cannot be audited at all.
    """
    setting, seed = settings.setting, settings.seed
    if settings.target_error is not None and len(parts.tune) < FEWEST:
        raise InputError(
            f"--target-error needs {FEWEST} tuning sessions or more, between the first file and the last, got "
            f"{len(parts.tune)}."
        )
    clock = StageClock(progress)
    suspects = named_suspects(parts.all_taps, settings.covariates)
    taps = _inside(parts.all_taps, grid)
    stratum, by_session = strata(taps, grid)
    some = evenly(stratum, MOST_TAPS)
    with clock.stage("Checking for leakage", 1) as advance:
        known = [parts.train] if parts.halved else [parts.train, *parts.tune]
        leaks = leakage(concatenate(known), parts.measure, grid, seed, settings.pre)
        advance(1)
    with clock.stage("Testing taxels", 2 * len(np.unique(stratum))) as advance:
        local = contrasts(taps.taps, stratum, recorded_time(taps), taps.session, MOST_TAPS) if by_session else None
        taxels = _taxels(taps.taps[some], stratum[some], local, settings, advance)
    with clock.stage("Testing times", len(np.unique(stratum))) as advance:
        times = time_dependence(
            taps.taps[some], stratum[some], permutations=settings.permutations, seed=seed, progress=advance
        )
    with clock.stage("Sampling variance components", 1) as advance:
        where, what = taps.indices(grid)
        components = variance_components(taps.taps, where * grid.M + what, taps.session, seed)
        advance(1)
    with clock.stage("Fitting remedies", count_remedies()) as advance:
        remedies, refused = make_remedies(parts.train, parts.tune, grid, setting, SEQUENCE, seed, advance)
    with clock.stage("Tuning on taps of a correct model", RIGHT_EXPONENTS) as advance:
        remedies = beside_right(remedies, parts.train, parts.tune, SEQUENCE, seed, advance)
    base = remedies[0]
    with clock.stage("Decomposing the variance", 2) as advance:
        split, no_split, p = _split(parts, grid, base, settings, suspects)
        advance(2)
    with clock.stage("Checking predictions", count_replicates(taps)) as advance:
        checks = audit_checks(taps, _histograms(base.model), seed, progress=advance)
    with clock.stage("Measuring remedies", count_measurements(remedies)) as advance:
        measured = measure(remedies, parts.measure, SEQUENCE, settings.trials, seed, advance)
    with clock.stage("Checking error bounds", 1) as advance:
        promised, broken = _promises(base, parts.measure, grid, settings, measured.policy)
        advance(1)
    with clock.stage("Tuning thresholds", 2) as advance:
        recalibrated = _recalibrate(base, parts, settings)
        advance(1)
        target = None
        if settings.target_error is not None:
            target = _tune_threshold(remedies, measured, parts, settings)
        advance(1)
    return Audit(
        parts=parts,
        grid=grid,
        leakage=leaks,
        taxels=taxels,
        times=times,
        by_session=by_session,
        components=components,
        split=split,
        no_split=no_split,
        session_p=p,
        checks=checks,
        remedies=remedies,
        refused=refused,
        measured=measured,
        enough=_enough(base, measured, settings, clock),
        guarantees=promised,
        exceeded=broken,
        recalibrated=recalibrated,
        target=target,
        samples_per_bin=samples_per_bin(base.model),
        unused=len(parts.measure) - len(base.model.usable(parts.measure)),
        elapsed_s=clock.elapsed_s,
    )


def _taxels(
    taps: NDArray[np.floating],
    stratum: NDArray[np.intp],
    local: Contrasts | None,
    settings: AuditSettings,
    advance: Callable[[int], None],
) -> xr.Dataset:
    """Tests of taxels by whole taps and by contrasts."""
    permutations, seed = settings.permutations, settings.seed
    whole = taxel_dependence(taps, stratum, permutations=permutations, seed=seed, progress=advance)
    return against_drift(whole, local, permutations=permutations, seed=seed, progress=advance)


def _enough(base: Remedy, measured: Measured, settings: AuditSettings, clock: StageClock) -> list[Detectable]:
    """What other designs could detect, where data are not enough; the last stage."""
    if calibration(measured.judged) != NOT_ENOUGH:
        return []
    with clock.stage("Estimating detectable miscalibration", 1) as advance:
        found = enough(
            base.model,
            measured.table,
            settings.setting,
            measured.policy,
            settings.trials // 2,
            settings.seed,
        )
        advance(1)
    return found


def samples_per_bin(model: TapModel) -> float:
    """Training samples in each bin that a histogram uses, the median over those of taxels that vary."""
    counts = _histograms(model).counts[model.trained]
    used = (counts > 0).sum(axis=-1)
    varying = used > 1
    ratio = counts.sum(axis=-1) / np.maximum(used, 1)
    return float(np.median(ratio[varying] if varying.any() else ratio))


def _histograms(model: TapModel) -> HistogramModel:
    if not isinstance(model, HistogramModel):
        raise TypeError(f"The model {model.name} has no histograms.")
    return model


def _inside(taps: TapSet, grid: ClassGrid) -> TapSet:
    return taps.select(np.minimum(*taps.indices(grid)) >= 0)


def _split(
    parts: AuditParts, grid: ClassGrid, base: Remedy, settings: AuditSettings, suspects: Sequence[Suspect]
) -> tuple[xr.Dataset | None, str, float]:
    """The variance of evidence by cause and the test of sessions, or why there are none."""
    taps = parts.all_taps
    where, what = taps.indices(grid)
    some = evenly((where * grid.M + what) * (int(taps.session.max()) + 1) + taps.session, MOST_TAPS)
    try:
        found = evidence(parts.train, taps, grid, _histograms(base.model), some)
    except InputError as error:
        return None, str(error), np.nan
    return (
        split_variance(taps, found, settings.seed, suspects=suspects),
        "",
        session_p(taps, found, max(settings.permutations, SESSION_PERMUTATIONS), settings.seed),
    )


def _promises(
    base: Remedy, taps: TapSet, grid: ClassGrid, settings: AuditSettings, policy: str
) -> tuple[xr.Dataset, dict[str, PromiseTest]]:
    """See `guarantees`, and which promises are exceeded by trials of a policy at the threshold in use."""
    usable = base.model.usable(taps)
    setting = settings.setting
    correct = replace(base.model, power="none", saturation=np.inf)  # pyright: ignore[reportArgumentType]
    table = tap_table(correct, usable)
    found = guarantees(
        table,
        tap_table(base.model, usable),
        grid,
        sorted({*THETAS, setting.play.threshold}),
        settings.seed,
        play=setting.play,
        trials=settings.trials,
    )
    return found, exceeded(
        found,
        correct,
        table,
        policy,
        setting.play.threshold,
        play=setting.play,
        trials=settings.trials // 2,
    )


def _recalibrate(base: Remedy, parts: AuditParts, settings: AuditSettings) -> Recalibrated:
    setting = settings.setting
    tuned, measured = (
        session_curves(
            base.model,
            sessions,
            base.grid,
            seed=settings.seed,
            trials=settings.trials,
            play=setting.play,
            fresh=True,
        )[0]
        for sessions in (parts.tune, [parts.measure])
    )
    error, target = tuned.error.mean(axis=0), 1 - setting.play.threshold
    fine = np.flatnonzero(error <= target)
    h = int(fine[0]) if len(fine) else int(error.argmin())
    usual = int(np.searchsorted(tuned.theta, setting.play.threshold))
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


def _tune_threshold(
    remedies: list[Remedy], measured: Measured, parts: AuditParts, settings: AuditSettings
) -> TargetError:
    """The threshold for the wanted error, with the model that is recommended."""
    name = recommended(measured)
    chosen = next(remedy for remedy in remedies if remedy.name == (name or remedies[0].name))
    setting = chosen.setting
    return target_error(
        chosen.model,
        parts.tune,
        settings.target_error or 0.0,
        chosen.grid,
        seed=settings.seed,
        play=setting.play,
    )
