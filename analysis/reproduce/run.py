"""The paper end to end: data sets through the experiment."""

from collections.abc import Sequence

import xarray as xr

from ...hardware.simulator.session import simulate_session
from ...hardware.simulator.settings import preset
from ...inference.engines.engine import make_engine
from ...inference.moves.control import check_fixation
from ...inference.trials.resampling import RESAMPLES
from ...models.measurement.histogram import trim
from ...models.seeds import data_set_seed
from ...models.splits import Fold, Split
from ..experiment.crosscheck import crosscheck_model
from ..experiment.policies import combined
from ..experiment.settings import check_settings
from ..experiment.study import Study, planned, study
from ..page.stages import Progress, StageClock, no_progress
from ..stats import metrics
from ..stats.acting import can_act
from .examples import belief_cases, trajectories
from .results import Request, Results


def simulated_split(name: str, data_sets: int, seed: int, progress: Progress = no_progress) -> Split:
    """Simulated data sets of two sessions each: the first trains, the second tests.

    Data set d is what `solidtouch simulate --seed SEED --data-set d` writes.

    Raises:
        InputError: There is no such preset.
    """
    settings = preset(name)
    advance = progress("Simulating taps", data_sets)
    folds = []
    for d in range(data_sets):
        own = data_set_seed(seed, d)
        train, test = (simulate_session(settings, own, session) for session in (0, 1))
        folds.append(Fold(train, test, f"data set {d}"))
        advance(1)
    return Split(
        tuple(folds), "sessions", "In each simulated data set, session 0 is for training and session 1 for testing."
    )


def run_experiment(request: Request, progress: Progress) -> Results:
    """Runs the experiment on every data set.

    Args:
        request: What to reproduce.
        progress: Told the name and size of every stage; gives the function that counts what is done.

    Raises:
        InputError: The data or settings cannot be used.
    """
    clock = StageClock(progress)
    settings, folds = request.settings, request.split.folds
    grid, left_out = trim(request.grid, [fold.train for fold in folds])
    check_settings(settings, grid)
    fixation = check_fixation(settings.play.fixation, grid.L)
    resamples = RESAMPLES if len(folds) == 1 else 0
    with clock.stage("Playing trials", planned(grid, settings, resamples) * len(folds)) as advance:
        # Data sets must not share random numbers, or their spread would miss the sampling of trials.
        studies = [
            study(fold, grid, settings.changed(seed=data_set_seed(settings.seed, d)), advance, resamples)
            for d, fold in enumerate(folds)
        ]
    first = studies[0]
    with clock.stage("Cross-checking engines", request.episodes) as advance:
        check = crosscheck_model(
            first.model,
            first.test,
            train=folds[0].train,
            settings=settings,
            border=settings.play.border,
            episodes=request.episodes,
            sequence_taps=request.sequence_taps,
            seed=settings.seed,
            progress=lambda: advance(1),
        )
    with clock.stage("Following single episodes", 1) as advance:
        engine = make_engine("filter", first.model, settings.play.border)
        cases = belief_cases(first, engine, settings)
        paths = trajectories(first, engine, settings, fixation) if can_act(grid) else None
        advance(1)
    names = [part.name for part in studies]

    def joined(parts: list[xr.Dataset]) -> xr.Dataset:
        return metrics.join(parts, names)

    return Results(
        grid=grid,
        left_out=_left_out(left_out, studies),
        studies=studies,
        stored=combined([part.played.stored for part in studies], joined),
        fresh=combined([part.played.fresh for part in studies], joined),
        fixation=fixation,
        cases=cases,
        paths=paths,
        check=check,
        elapsed_s=clock.elapsed_s,
    )


def _left_out(trimmed: tuple[str, ...], studies: Sequence[Study]) -> tuple[str, ...]:
    if len(studies) == 1:
        return (*trimmed, *studies[0].model.left_out)
    return (*trimmed, *(f"{name} ({part.name})" for part in studies for name in part.model.left_out))
