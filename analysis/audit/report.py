"""Audit of the naive-Bayes assumption on recorded taps: the function `solidtouch.audit` and its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import xarray as xr

from ...inference.moves.control import check_fixation
from ...inference.trials.resampling import RESAMPLES
from ...models.errors import InputError, check_counts
from ...models.io.load import TapSource, names_of
from ...models.measurement.histogram import trim
from ...models.measurement.model import TapModel
from ...models.measurement.registry import AnyModel, model_names
from ...models.progress import Progress, no_progress
from ...models.setting_file import Setting
from ...models.settings import Division, FitSettings, PlaySettings
from ..experiment.parts import AuditParts, load_parts
from ..page.page import Page, Row
from ..page.report import StudyReport
from ..stats.right_exponent import SIMULATIONS as RIGHT_EXPONENTS
from ..stats.right_model import SIMULATIONS
from .checks import REPLICATES
from .remedies import BASELINE, Remedy
from .run import MOST_TAPS, Audit, AuditSettings, audit_taps
from .summary import summarise
from .tables import (
    after_taps_table,
    calibration_table,
    causes_table,
    checks_table,
    independence_table,
    leakage_table,
    remedies_table,
)

FEWEST_PERMUTATIONS, FEWEST_TRIALS = 99, 100
FEWEST_RESAMPLES, FEWEST_TAPS = 2, 8
FEWEST_SIMULATIONS = 39
"""With fewer a factor beyond all of them is not significant at 5% on either side."""


@dataclass(frozen=True, eq=False, repr=False)
class AuditReport(StudyReport):
    """Where the naive-Bayes assumption fails, what that costs in decisions, and which remedy pays.

    Attributes:
        found: All results.
        summary: What the page says, as `audit.json` holds it.
    """

    SUMMARY: ClassVar[str] = "audit.json"

    found: Audit
    summary: Row

    def _page(self) -> Page:
        from .page import audit_page  # noqa: PLC0415 - loads matplotlib

        return audit_page(self.found, self.summary)

    @property
    def verdict(self) -> list[str]:
        """The verdict, in sentences."""
        return self.summary["verdict"]["sentences"]

    @property
    def calibration(self) -> xr.Dataset:
        """Miscalibration of decisions about all objects and each, and that of a correct model, with p-values, dim what.

        The attribute `verdict` says how beliefs compare with outcomes.
        """
        return calibration_table(self.summary)

    @property
    def causes(self) -> xr.Dataset | None:
        """Shares in the variance of evidence, dim cause; `None` where evidence cannot be judged."""
        return causes_table(self.summary)

    @property
    def independence(self) -> xr.Dataset:
        """Tests of the independence of taxels and of samples in time, dim test."""
        return independence_table(self.summary)

    @property
    def checks(self) -> xr.Dataset:
        """Statistics of taps beside those of replicates from the fitted model, dim statistic."""
        return checks_table(self.summary)

    @property
    def leakage(self) -> xr.Dataset:
        """Accuracy of classes inferred without touch, dims quantity and source, and the verdict on each quantity."""
        return leakage_table(self.summary)

    @property
    def after_taps(self) -> xr.Dataset:
        """Scores of beliefs after some taps, dims taps and what."""
        return after_taps_table(self.summary)

    @property
    def remedies(self) -> xr.Dataset:
        """What each remedy gains, and its errors at the reaction time of the present setting, dim remedy.

        The present setting comes first; `<name>_difference` is the change from it.
        """
        return remedies_table(self.summary)

    @property
    def model(self) -> TapModel:
        """The model of the recommended remedy, or the present one where no remedy pays."""
        return self._remedy.model

    @property
    def setting(self) -> Setting:
        """The setting to perceive with, with the threshold for the wanted error where that can be reached."""
        target, remedy = self.found.target, self._remedy
        note = f"{self.summary['title']}: {remedy.title}. {remedy.how}".strip()
        if target is not None and target.reachable:
            note = f"{note} {target.sentence}".strip()
            return remedy.setting.changed(threshold=target.chosen.theta, note=note)
        return remedy.setting.changed(note=note)

    @property
    def _remedy(self) -> Remedy:
        name = self.summary["remedy"]["chosen"] or BASELINE
        return next(remedy for remedy in self.found.remedies if remedy.name == name)

    def _write_more(self, folder: Path) -> None:
        self.setting.save(folder / "setting.json")
        self.model.save(folder / "model.nc")


def audit(
    *data: TapSource,
    target_error: float | None = None,
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    play: PlaySettings = PlaySettings(),
    pre: int | None = None,
    covariates: Sequence[str] = (),
    models: AnyModel | Sequence[AnyModel] = (),
    permutations: int = 999,
    trials: int = 4000,
    resamples: int = RESAMPLES,
    replicates: int = REPLICATES,
    simulations: int = SIMULATIONS,
    tuned_simulations: int = RIGHT_EXPONENTS,
    most_taps: int = MOST_TAPS,
    preview: bool = False,
    seed: int = 0,
    progress: Progress = no_progress,
    command: str = "",
) -> AuditReport:
    """Audits the naive-Bayes assumption of the paper's histogram on taps.

    Args:
        data: Tap sets or their files: the first trains, the last measures, those between tune. Of two the second is
            halved to tune and to measure; one is divided by its sessions.
        target_error: P(wrong) for which a threshold is tuned; that takes five sets to tune with.
        division: Width of the cells, and whether taps that train may also tune and measure.
        fit: The histogram in use.
        play: How perception is done now.
        pre: Samples at the beginning of each tap that precede contact; `None` for what the taps record.
        covariates: Extra arrays of the taps that are suspected as causes.
        models: Further models to measure as remedies: names, see docs/reference/models.md, or NumPyro functions, see
            docs/how-to/your-own-model.md.
        permutations: Permutations of every test.
        trials: Trials of each remedy and policy.
        resamples: Of the measuring taps, for intervals.
        replicates: Of the taps, from histograms fitted to them, at most, for checks of predictions.
        simulations: Data sets of a correct model, with which miscalibration and error bounds are compared.
        tuned_simulations: Likewise for tuned exponents; 0 skips that.
        most_taps: Of one class and session on which independence is tested, evidence judged and predictions checked;
            at least 8.
        preview: Leaves out variance components of gain and offset, and figures for narrow windows.
        seed: Random seed.
        progress: Called with the name and size of every stage; returns the function that advances it.
        command: The command line, for the page.

    Raises:
        InputError: The taps or a setting cannot be used.
    """
    check_counts(0, permutations=permutations, trials=trials, pre=pre, seed=seed)
    for name, value in (("--theta", play.threshold), ("--target-error", target_error)):
        if value is not None and not 0 < value < 1:
            raise InputError(f"{name} must lie between 0 and 1, got {value}.")
    for name, number, least in (
        ("--permutations", permutations, FEWEST_PERMUTATIONS),
        ("--trials", trials, FEWEST_TRIALS),
        ("resamples", resamples, FEWEST_RESAMPLES),
        ("replicates", replicates, FEWEST_RESAMPLES),
        ("simulations", simulations, FEWEST_SIMULATIONS),
        ("most_taps", most_taps, FEWEST_TAPS),
        ("tuned_simulations", tuned_simulations or RIGHT_EXPONENTS, RIGHT_EXPONENTS),
    ):
        if number < least:
            raise InputError(f"{name} must be {least} or more, got {number}.")
    if division.missing == "drop":
        raise InputError("An audit compares samples of all taps, so it refuses missing ones; missing cannot be 'drop'.")
    names = model_names(models)
    parts, grid = load_parts(data, division, whole=True)
    grid, dropped = trim(grid, [parts.train])
    if grid.shape == (1, 1):
        raise InputError("With one object at one position there is nothing to decide.")
    check_fixation(play.fixation, grid.L)
    fit = fit.changed(seed=seed)
    settings = AuditSettings(
        setting=Setting(fit=fit, where_cell=division.where_cell, what_cell=division.what_cell, play=play),
        target_error=target_error,
        pre=pre,
        covariates=tuple(covariates),
        models=tuple(names),
        permutations=permutations,
        trials=trials,
        seed=seed,
        resamples=resamples,
        replicates=replicates,
        simulations=simulations,
        tuned_simulations=tuned_simulations,
        most_taps=most_taps,
        preview=preview,
    )
    found = audit_taps(parts, grid, settings, progress)
    about = _about(data, parts, dropped, found.unused, command)
    return AuditReport(found, summarise(found, settings, about))


def _about(data: Sequence[TapSource], parts: AuditParts, dropped: Sequence[str], unused: int, command: str) -> Row:
    """The data in words."""
    warnings = []
    if dropped:
        warnings.append(f"Left out, because they have no training tap: {', '.join(f'“{name}”' for name in dropped)}.")
    if unused:
        warnings.append(f"{unused} measuring taps were left out because their classes have no training tap.")
    return {
        "title": f"Audit of the naive-Bayes assumption: {', '.join(Path(name).name for name in names_of(data))}",
        "files": {
            "Training taps": len(parts.train),
            "tuning taps": sum(map(len, parts.tune)),
            "measuring taps": len(parts.measure),
        },
        "simulated": all(part.simulated for part in (parts.train, *parts.tune, parts.measure)),
        "warnings": warnings,
        "command": command,
    }
