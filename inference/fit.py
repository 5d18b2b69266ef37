"""Fits a measurement model to training taps, and learns its power if requested."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ..models.errors import InputError
from ..models.grid import ClassGrid
from ..models.io.load import TapSource, all_taps_of
from ..models.measurement.generic.source import undone_on_error
from ..models.measurement.histogram import trim
from ..models.measurement.model import TapModel
from ..models.measurement.registry import KINDS, PAPER, AnyModel, model_name, split_name, takes_steps
from ..models.progress import Progress, no_progress
from ..models.settings import FitSettings, Missing
from .tuning.tempering import fit_tempered


@undone_on_error()
def fit(
    taps: TapSource | Sequence[TapSource],
    model: AnyModel = "histogram",
    *,
    grid: ClassGrid | None = None,
    missing: Missing = "refuse",
    progress: Progress = no_progress,
    **settings: Any,
) -> TapModel:
    """Measurement model fitted to training taps.

    It keeps its posterior, from which `to_arviz` draws; files keep it where it has a closed form.

    >>> import solidtouch as st
    >>> st.fit(st.simulate("paper", seed=4), bins=50, power="JK")
    <histogram model: 16 x 5 classes, 50 samples of 12 taxels, 50 bins, power JK>

    Args:
        taps: Training taps or their file, in one set or several whose sessions differ in number.
        model: Its name, see docs/reference/models.md, or a NumPyro function, see docs/how-to/your-own-model.md.
        grid: The classes; those of the taps' own tables where none are given. Objects without a tap and empty ends of
            the range are taken out and named in `left_out`, so classes are counted as in the `grid` of the model.
        missing: What to do with samples of files that are NaN: `"refuse"` the file, or `"drop"` them, so that they do
            not count; tap sets remember it. The model then drops them from its likelihood, too.
        progress: Called with the name of every long stage of a fit and its number of steps; returns the function that
            advances it.
        settings: Fields of `FitSettings`, such as `bins=100`, `pseudocount=0.01` or `power="J"`; a power may also be
            `"learned"`, which leaves out each training session in turn.

    Warns:
        UserWarning: The prior of a function is far from the taps.

    Raises:
        InputError: A model or setting is unknown, out of range or not for this model, or the taps cannot
            carry the model.
        NotConvergedError: The fit did not converge, and `unconverged` was not set.
    """
    if unknown := sorted(set(settings) - set(FitSettings.__struct_fields__)):
        raise InputError(f"Unknown fit setting {unknown[0]!r}; choose from {', '.join(FitSettings.__struct_fields__)}.")
    given = FitSettings(**settings)
    name = model_name(model)
    check_used(name, given)
    taps = all_taps_of(taps, missing)
    if grid is not None and not isinstance(grid, ClassGrid):
        raise InputError(f"grid must be a ClassGrid, got {type(grid).__name__}.")
    if grid is not None and "" not in (units := {grid.where_unit, taps.where_unit}) and len(units) > 1:
        raise InputError(f"The grid has positions in {grid.where_unit!r}, the taps in {taps.where_unit!r}.")
    grid, dropped = trim(taps.grid() if grid is None else grid, [taps])
    fitted, _ = fit_tempered(name, taps, grid, given, "taps given to fit", progress)
    if fitted.convergence.warning:
        warnings.warn(fitted.convergence.warning, stacklevel=2)
    scored: Any = fitted.model.with_scores(taps)
    return replace(scored, left_out=(*dropped, *scored.left_out), posterior=fitted.posterior)


def check_used(model: str, settings: FitSettings) -> None:
    """Checks that a model uses all settings that are given.

    Raises:
        InputError: There is one, or there is no such model.
    """
    kind, in_states = split_name(model)
    if not in_states and (settings.gain_sd is not None or settings.offset_sd is not None):
        options = "gain_sd and offset_sd (--gain-sd, --offset-sd)"
        raise InputError(f"{options} require a session model, got {model}.")
    if kind == PAPER and settings.method != "closed":
        raise InputError(
            f"The fit of the histogram model is exact; method {settings.method!r} (--fit {settings.method}) requires "
            "another model."
        )
    if kind in KINDS and settings.method not in ("closed", "nuts"):
        raise InputError(
            f"Method {settings.method!r} (--fit {settings.method}) is for functions; {kind} has a fast fit of its own, "
            "and nuts."
        )
    if settings.device != "cpu" and not takes_steps(kind, settings):
        raise InputError(
            f"device {settings.device} (--device {settings.device}) is for functions and nuts (--fit nuts); {kind} has "
            "a fast fit of its own."
        )
    if settings.steps is not None and not takes_steps(kind, settings):
        raise InputError(f"steps (--steps) is for functions and nuts (--fit nuts), got {kind}.")
