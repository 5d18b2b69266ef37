"""`solidtouch audit`: is the naive-Bayes assumption wrong here, what does it cost, and what to do."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from ..models.errors import InputError
from ..models.settings import FitSettings, PlaySettings
from .shared.interrupt import loading
from .shared.options import Exponent, Fields, Force, Seed, TrainingTaps, WhatCell, WhereCell, spelled_out
from .shared.report import command_line, report_folder, show_report

if TYPE_CHECKING:
    from ..analysis.audit.parts import AuditParts

_FEWEST_PERMUTATIONS = 99
_Passive = Annotated[bool, Option("--passive", help="Judge trials that never move.")]


@spelled_out
def audit(
    files: Annotated[
        list[Path],
        Argument(
            metavar="FILE...",
            help="Taps as for `inspect`: the first file trains, the last measures, those between tune.",
            show_default=False,
        ),
    ],
    out: Annotated[Path | None, Option(help="Folder for the results; default runs/<date-time>-audit.")] = None,
    target_error: Annotated[
        float | None,
        Option(
            "--target-error",
            metavar="P",
            help="Tune a threshold for this P(wrong); needs five tuning files, seven in all.",
        ),
    ] = None,
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    training_taps: TrainingTaps = False,
    fit: Annotated[FitSettings, Fields("bins", "pseudocount", "value_range", power=Exponent)] = FitSettings(),
    play: Annotated[
        PlaySettings,
        Fields("threshold", "theta_x", "fixation", "deadline", "border", passive=_Passive),
    ] = PlaySettings(),
    pre: Annotated[
        int | None,
        Option(
            "--pre",
            metavar="N",
            help="The first N samples of each tap precede contact, 0: none does; default what the files record.",
        ),
    ] = None,
    covariate: Annotated[
        list[str] | None,
        Option("--covariate", metavar="NAME", help="An extra array of the files as a suspected cause; repeatable."),
    ] = None,
    permutations: Annotated[int, Option(min=_FEWEST_PERMUTATIONS, max=10**6, help="Of every test.")] = 999,
    trials: Annotated[int, Option(min=100, help="Of each remedy and policy.")] = 4000,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Audits the naive-Bayes assumption on taps: where it fails, what it costs in decisions, which remedy pays."""
    for name, value in (("--theta", play.threshold), ("--target-error", target_error)):
        if value is not None and not 0 < value < 1:
            raise InputError(f"{name} must lie between 0 and 1, got {value}.")
    with loading():
        from ..analysis.audit.page import chosen_setting, write_audit
        from ..analysis.audit.parts import load_parts
        from ..analysis.audit.run import AuditSettings
        from ..analysis.audit.run import audit as run
        from ..analysis.audit.summary import summarise
        from ..inference.moves.control import check_fixation
        from ..models.measurement.histogram import trim
        from ..models.setting_file import Setting
    from .shared.progress import bars

    folder = report_folder(out, force, "audit")
    parts, grid = load_parts(files, where_cell, what_cell, training_taps)
    grid, dropped = trim(grid, [parts.train])
    check_fixation(play.fixation, grid.L)
    settings = AuditSettings(
        setting=Setting(fit=fit, where_cell=where_cell, what_cell=what_cell, play=play),
        target_error=target_error,
        pre=pre,
        covariates=tuple(covariate or ()),
        permutations=permutations,
        trials=trials,
        seed=seed,
    )
    with bars() as progress:
        found = run(parts, grid, settings, progress)
    summary = summarise(found, settings, _about(files, parts, dropped, found.unused))
    show_report(write_audit(folder, found, summary, chosen_setting(found, summary), force), folder)


def _about(files: list[Path], parts: "AuditParts", dropped: Sequence[str], unused: int) -> dict[str, Any]:
    """The data in words."""
    sources = {str(part.dataset.attrs.get("source", "")) for part in (parts.train, *parts.tune, parts.measure)}
    warnings = []
    if dropped:
        warnings.append(f"Left out for want of a training tap: {', '.join(f'“{name}”' for name in dropped)}.")
    if unused:
        warnings.append(f"{unused} measuring taps of classes without a training tap were left out.")
    return {
        "title": f"Audit of the naive-Bayes assumption: {', '.join(path.name for path in files)}",
        "command": command_line(),
        "files": {
            "Training taps": len(parts.train),
            "tuning taps": sum(map(len, parts.tune)),
            "measuring taps": len(parts.measure),
        },
        "simulated": all(source.startswith("simulated") for source in sources),
        "warnings": warnings,
    }
