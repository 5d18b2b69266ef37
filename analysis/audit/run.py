"""Audit of the naive-Bayes assumption on recorded taps: where it fails, what that costs, which remedy helps."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from ...inference.trials.records import tap_table
from ...inference.trials.resampling import RESAMPLES
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from ...models.progress import Progress
from ...models.setting_file import Setting
from ...models.taps import TapSet, concatenate
from ...models.threads import one_blas_thread, other_threads
from ..experiment.before_contact import check_pre
from ..experiment.parts import AuditParts
from ..page.ahead import draw_ahead, later
from ..page.figure_sizes import for_all_widths
from ..page.stages import StageClock
from ..stats.evidence import evidence
from ..stats.reliability import THETAS
from ..stats.right_exponent import SIMULATIONS as RIGHT_EXPONENTS
from ..stats.right_model import SIMULATIONS
from ..stats.target_error import FEWEST, TargetError
from .checks import REPLICATES, audit_checks, count_replicates
from .dependence.drift import against_drift, contrasts, recorded_time
from .dependence.strata import evenly, strata
from .dependence.taxels import taxel_dependence
from .dependence.times import time_dependence
from .detectable import SIMULATIONS as DESIGN_SIMULATIONS
from .detectable import Detectable, enough
from .guarantees import PromiseTest, exceeded, guarantees
from .leakage.run import Leakage, leakage
from .remedies import RefusedRemedy, Remedy, beside_right, count_remedies, make_remedies, no_change
from .remedy_scores import Measured, count_measurements, measure, policy_of
from .thresholds import Recalibrated, recalibrate, tune_threshold
from .variance.causes import SEQUENCE, split_variance
from .variance.gains import Components, variance_components
from .variance.split import session_p
from .variance.suspects import Suspect, named_suspects
from .verdict import NOT_ENOUGH, calibration, shown_cause, unsupported_causes

if TYPE_CHECKING:
    from . import figures, figures_checks, figures_reliability
else:  # they load matplotlib
    figures, figures_checks, figures_reliability = later(
        __package__, "figures", "figures_checks", "figures_reliability"
    )

SESSION_PERMUTATIONS = 999
"""Of the test of sessions at least: with few its p-value never falls below the level at which sessions are named."""

MOST_TAPS = 60
"""Of one class and session that are tested and judged; more would take minutes and tell little more."""


@dataclass(frozen=True)
class AuditSettings:
    """Everything that changes the numbers of an audit, see `report.audit`; `setting` is how perception is done now.

    Intervals are from so many `resamples` of the measuring taps, checks of predictions from so many `replicates`, and
    beliefs are compared with so many `simulations` of a correct model, tuned exponents with `tuned_simulations`.
    Independence is tested, evidence judged, and predictions checked on `most_taps` of a class and session at most. A
    preview has no variance components, and no figures for narrow windows.
    """

    setting: Setting = field(default_factory=Setting)
    target_error: float | None = None
    pre: int | None = None
    covariates: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    permutations: int = 999
    trials: int = 4000
    seed: int = 0
    resamples: int = RESAMPLES
    replicates: int = REPLICATES
    simulations: int = SIMULATIONS
    tuned_simulations: int = RIGHT_EXPONENTS
    most_taps: int = MOST_TAPS
    preview: bool = False


class Audit(NamedTuple):
    """What came out.

    Attributes:
        parts: Which taps did what.
        grid: The classes.
        leakage: What is told without touch.
        taxels: See `dependence.taxels` and `dependence.drift.against_drift`.
        times: See `dependence.times`.
        by_session: Whether taps were exchanged within sessions only; otherwise sessions had one tap of a class each.
        components: Gains and offsets of taps and sessions; `None` where they were left out.
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
    components: Components | None
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

    @property
    def preview(self) -> bool:
        """Whether variance components and figures for narrow windows were left out."""
        return self.components is None


@one_blas_thread()
def audit_taps(parts: AuditParts, grid: ClassGrid, settings: AuditSettings, progress: Progress) -> Audit:
    """Audits taps as `report.audit` divides them.

    Raises:
        InputError: A setting is wrong, or the taps cannot be audited at all.
    """
    setting, seed = settings.setting, settings.seed
    if settings.target_error is not None and len(parts.tune) < FEWEST:
        raise InputError(
            f"--target-error needs {FEWEST} tuning sessions or more, between the first file and the last, got "
            f"{len(parts.tune)}."
        )
    if settings.pre is not None:
        check_pre(settings.pre, parts.train.preprocessing.samples)
    clock = StageClock(progress)
    suspects = named_suspects(parts.all_taps, settings.covariates)
    taps = parts.all_taps.select(np.minimum(*parts.all_taps.indices(grid)) >= 0)
    stratum, by_session = strata(taps, grid)
    some = evenly(stratum, settings.most_taps)
    options: dict[str, Any] = {"permutations": settings.permutations, "seed": seed}
    where, what = taps.indices(grid)
    components = None
    with other_threads(2) as threads:  # so that no core waits while Python keeps another one busy
        known = [parts.train] if parts.halved else [parts.train, *parts.tune]
        leaks = clock.beside(
            threads,
            "Checking for leakage",
            lambda _: leakage(concatenate(known), parts.measure, grid, seed, settings.pre),
        )
        if not settings.preview:
            components = clock.beside(
                threads,
                "Estimating variance components",
                lambda _: variance_components(taps.doubles, where * grid.M + what, taps.session),
            )
        tested, of_class = taps.select(some), stratum[some]

        def across_taxels(advance: Callable[[int], None]) -> xr.Dataset:
            local = (
                contrasts(taps.samples, stratum, recorded_time(taps), taps.session, settings.most_taps)
                if by_session
                else None
            )
            whole = taxel_dependence(tested.taps, of_class, progress=advance, **options)
            return against_drift(whole, local, progress=advance, **options)

        classes = len(np.unique(stratum))
        taxels = clock.beside(threads, "Testing taxels", across_taxels, 2 * classes)
        times = clock.beside(
            threads,
            "Testing times",
            lambda advance: time_dependence(tested.taps, of_class, progress=advance, **options),
            classes,
        )
        draw_ahead(_when_ended(leaks, lambda found: [partial(figures.leakage, found)]))
        draw_ahead(_when_ended(taxels, lambda found: [partial(figures.taxel_map, found)]))
        draw_ahead(_when_ended(times, lambda found: [partial(figures.times, found, parts.train.preprocessing.rate_hz)]))
        with clock.stage("Fitting the setting in use"):
            base = no_change(setting, parts.train, grid)
        parted = clock.beside(
            threads, "Decomposing the variance", lambda _: _split(parts, grid, base, settings, suspects)
        )
        checks = clock.beside(
            threads,
            "Checking predictions",
            lambda advance: audit_checks(tested, _histograms(base.model), seed, settings.replicates, advance),
            count_replicates(tested, settings.replicates),
        )
        promises = clock.beside(
            threads, "Checking error bounds", lambda _: _promises(base, parts.measure, grid, settings, policy_of(base))
        )
        draw_ahead(_when_ended(parted, lambda found: _figures_of_causes(found, leaks.result(), settings)))
        draw_ahead(_when_ended(checks, lambda found: [partial(figures_checks.figure_checks, found)]))
        draw_ahead(_when_ended(promises, lambda found: [partial(figures_reliability.guarantee_factors, found[0])]))
        with clock.stage("Fitting remedies", count_remedies(settings.models)) as advance:
            remedies, refused = make_remedies(base, parts.train, parts.tune, SEQUENCE, seed, advance, settings.models)
        with clock.stage("Tuning on taps of a correct model", settings.tuned_simulations) as advance:
            own = parts.train, parts.tune, SEQUENCE, seed, advance, settings.tuned_simulations
            remedies = beside_right(remedies, *own)
        with clock.stage("Measuring remedies", count_measurements(remedies, settings.simulations)) as advance:
            measured = measure(
                remedies,
                parts.measure,
                SEQUENCE,
                settings.trials,
                seed,
                advance,
                resamples=settings.resamples,
                simulations=settings.simulations,
                scored=lambda *known: draw_ahead(
                    for_all_widths(partial(figures.remedies, *known), not settings.preview)
                ),
            )
    (split, no_split, p), (promised, broken) = parted.result(), promises.result()
    with clock.stage("Tuning thresholds", 2) as advance:
        recalibrated = recalibrate(base, parts, settings.trials, seed)
        advance(1)
        wanted = settings.target_error
        target = None if wanted is None else tune_threshold(remedies, measured, parts, wanted, seed)
    return Audit(
        parts=parts,
        grid=grid,
        leakage=leaks.result(),
        taxels=taxels.result(),
        times=times.result(),
        by_session=by_session,
        components=None if components is None else components.result(),
        split=split,
        no_split=no_split,
        session_p=p,
        checks=checks.result(),
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


def _when_ended[T](stage: Future[T], draws: Callable[[T], Iterable[Callable[[], Any]]]) -> Iterator[Callable[[], Any]]:
    """Figures of what a stage finds."""
    yield from draws(stage.result())


def _figures_of_causes(
    found: tuple[xr.Dataset | None, str, float], leaks: Leakage, settings: AuditSettings
) -> Iterable[Callable[[], Any]]:
    split, _, p = found
    if split is None:
        return ()
    drawn = partial(figures.seen_causes, split, shown_cause(leaks, split, p), unsupported_causes(split, p))
    return for_all_widths(drawn, not settings.preview)


def _enough(base: Remedy, measured: Measured, settings: AuditSettings, clock: StageClock) -> list[Detectable]:
    """What other designs could detect, where data are not enough; the last stage."""
    if calibration(measured.judged) != NOT_ENOUGH:
        return []
    with clock.stage("Estimating detectable miscalibration"):
        trials, seed = settings.trials // 2, settings.seed
        return enough(
            base.model,
            measured.table,
            settings.setting,
            measured.policy,
            trials,
            seed,
            min(settings.simulations, DESIGN_SIMULATIONS),
        )


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


def _split(
    parts: AuditParts, grid: ClassGrid, base: Remedy, settings: AuditSettings, suspects: Sequence[Suspect]
) -> tuple[xr.Dataset | None, str, float]:
    """The variance of evidence by cause and the test of sessions, or why there are none."""
    taps = parts.all_taps
    where, what = taps.indices(grid)
    some = evenly((where * grid.M + what) * (int(taps.session.max()) + 1) + taps.session, settings.most_taps)
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
        resamples=settings.resamples,
    )
    return found, exceeded(
        found,
        correct,
        table,
        policy,
        setting.play.threshold,
        play=setting.play,
        trials=settings.trials // 2,
        simulations=settings.simulations,
    )
