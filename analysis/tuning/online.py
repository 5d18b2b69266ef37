"""Fixation point and threshold learned from episodes: the function `solidtouch.tune_online` and its report."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from ...hardware.named_rigs import ChosenRig, Wish, check_training_taps, choose_rig, sensor_of
from ...hardware.sensor import TouchSensor
from ...inference.engines.engine import Engine, make_engine
from ...inference.engines.latency import warm_up
from ...inference.trials.run import checked_thresholds
from ...inference.tuning.costs import episode_cost, held_out_costs
from ...inference.tuning.online import (
    Learner,
    beliefs,
    interval,
    learn,
    load_learner,
    recommended,
    save_learner,
)
from ...models.errors import InputError, check_counts
from ...models.io.load import TapSource
from ...models.measurement.registry import PAPER, AnyModel, model_name
from ...models.progress import Progress, no_progress
from ...models.setting_file import Setting
from ...models.settings import Division, FitSettings, PlaySettings
from ...models.storage import check_writable
from ...models.taps import TapSet
from ...models.training import untrained_taps
from ..page.page import Brief, Page
from ..stats.metrics import CONFIDENCE
from .run import Price, check_objects, check_price
from .training import TrainingData, TunedReport, training_data

ONLINE_THRESHOLDS = (0.5, 0.7, 0.8, 0.9, 0.95, 0.975, 0.99, 0.995)
_FEWEST = 2  # episodes before a cost is known
_FEW = 10  # episodes with a pair, below which its cost is hardly known

type Rig = Callable[[int], tuple[TouchSensor, str | None]]
"""Places a sensor before an object for an episode, counted from 0; gives the sensor and the name of the object."""


class OnlineEpisode(NamedTuple):
    """An episode that was learned from.

    Attributes:
        number: Counted from 1 over the life of the learner.
        what: Name of the object; empty for held-out taps.
        fixation: Fixation point, as index.
        where_label: The same as a position.
        theta: Belief threshold.
        cost: Its cost in taps.
    """

    number: int
    what: str
    fixation: int
    where_label: str
    theta: float
    cost: float

    def __repr__(self) -> str:
        what = f"{self.what}, " * bool(self.what)
        pair = f"fixation point {self.where_label}, threshold {self.theta:g}"
        return f"Episode {self.number}: {what}{pair}, cost {self.cost:.1f} taps"


@dataclass(frozen=True, eq=False, repr=False)
class OnlineTuningReport(TunedReport):
    """The fixation point and the threshold that a learner recommends.

    Attributes:
        training: The taps and models of them.
        found: The learner.
        given: The setting without fixation point and threshold.
    """

    found: Learner
    given: Setting

    def _page(self) -> Page:
        return Page("Online tuning", [Brief(self.sentence)], [])

    @property
    def sentence(self) -> str:
        """The recommendation, with an interval."""
        learner, grid = self.found, self.training.grid
        arm, (mean, _) = recommended(learner), beliefs(learner)
        low, high = interval(learner, arm, CONFIDENCE)
        return (
            f"After {learner.episodes} episodes: fixation point {grid.where_label(int(learner.fixation[arm]))} (class "
            f"{learner.fixation[arm]}) and threshold {learner.theta[arm]:g}, at an estimated cost of {mean[arm]:.1f} "
            f"taps per episode ({CONFIDENCE:.0%} interval {max(1.0, low):.1f} to {high:.1f}). This pair was played in "
            f"{learner.count[arm]} episodes, and {np.count_nonzero(learner.count)} of {len(learner.count)} pairs were "
            f"tried.{_hardly_played(int(learner.count[arm]))}"
        )

    @property
    def setting(self) -> Setting:
        """The setting with both, to perceive with."""
        learner, arm = self.found, recommended(self.found)
        return self.given.changed(
            fixation=int(learner.fixation[arm]),
            threshold=float(learner.theta[arm]),
            passive=False,
            note=f"Fixation point and threshold learned online by {learner.method} in {learner.episodes} episodes.",
        )

    @property
    def results(self) -> xr.Dataset:
        """Episodes with each pair, their mean cost, and posterior mean and standard deviation of the expected cost.

        Costs are in taps; the dims are fixation and theta.
        """
        learner = self.found
        points, theta = np.unique(learner.fixation), np.unique(learner.theta)
        order = np.lexsort((learner.theta, learner.fixation))
        mean, deviation = beliefs(learner)
        columns = {
            "episodes": learner.count,
            "cost": np.where(learner.count > 0, learner.mean, np.nan),
            "expected_cost": mean,
            "expected_cost_sd": deviation,
        }
        shape = len(points), len(theta)
        variables = {name: (("fixation", "theta"), column[order].reshape(shape)) for name, column in columns.items()}
        where = self.training.grid.where_value[points]
        return xr.Dataset(variables, {"fixation": points, "theta": theta, "where": ("fixation", where)})


def tune_online(
    *data: TapSource,
    episodes: int = 1000,
    learner: str = "thompson",
    rig: str | Rig | None = None,
    what: str | None = None,
    home: bool = False,
    training_taps: bool = False,
    state: str | Path | None = None,
    cost_error: float = 50.0,
    wrong: bool = False,
    thresholds: Sequence[float] | None = None,
    model: AnyModel = PAPER,
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    play: PlaySettings = PlaySettings(),
    seed: int = 0,
    progress: Progress = no_progress,
    hear: Callable[[OnlineEpisode], object] = lambda episode: None,  # noqa: ARG005
    note: Callable[[str], object] = lambda sentence: None,  # noqa: ARG005
) -> OnlineTuningReport:
    """Learns the fixation point and the belief threshold from episodes whose object is known afterwards.

    Each episode plays the pair that is best in a draw from the posterior of the costs. With `state` the learner is
    saved, also after an interruption, and the same call adds as many episodes.

    >>> import solidtouch as st
    >>> train, test = st.simulate("ideal", sessions=2, seed=1)
    >>> report = st.tune_online(train, test, episodes=50, thresholds=[0.5, 0.9])
    >>> int(report.results["episodes"].sum())
    50

    A function may place any sensor before an object:

    >>> def rig(episode):
    ...     what = episode % 5
    ...     sensor = st.SimulatedRig("ideal", seed=1, session=2, position_mm=0.5, what=what, run=episode)
    ...     return sensor, st.PRESETS["ideal"].rods[what].name
    >>> st.tune_online(train, test, episodes=20, thresholds=[0.5, 0.9], rig=rig).setting.play.threshold in (0.5, 0.9)
    True

    Args:
        data: Taps or their files, of which the training taps are used, as in `tune`.
        episodes: How many.
        learner: `"thompson"`: Thompson sampling, each pair by its own costs.
        rig: Where episodes are played: a function that takes the number of the episode and returns a sensor and the
            name of the object before it, or `"simulated"`, `"simulated:PRESET"`, `"replay:FILE"` or a rig.toml; `None`
            for held-out training taps.
        what: The object before a rig that is named, by name or number.
        home: Whether to home the stage of a rig.toml first.
        training_taps: Whether `"replay:FILE"` also plays taps that trained the model.
        state: File of the learner, to write and to resume.
        cost_error: Cost of an error of 1, in taps.
        wrong: Whether errors are P(wrong) even where objects have sizes to be wrong by.
        thresholds: Belief thresholds to choose from; `None` for eight.
        model: The measurement model, see docs/reference/models.md.
        division: How taps are grouped into classes, and how one tap set is divided.
        fit: How the model is fitted; its seed is `seed`.
        play: How episodes are played.
        seed: Random seed.
        progress: Called with the name and size of every stage; returns the function that advances it.
        hear: Called with each episode when it has ended.
        note: Called with sentences: which taps train, which are not replayed, and where the learner is saved.

    Raises:
        InputError: The taps, the rig or a setting cannot be used, or the state is that of another learner.
        RigError: A device failed.
    """
    named = rig if isinstance(rig, str) else None
    check_training_taps(training_taps, named)
    for option, given in (("--object", what is not None), ("--home", home)):
        if given and named is None:
            raise InputError(f"{option} requires --rig.")
    check_counts(_FEWEST, online=episodes)
    price = Price(cost_error, wrong)
    name, cells = model_name(model), (division.where_cell, division.what_cell)
    setting = Setting(model=name, fit=fit, where_cell=cells[0], what_cell=cells[1], play=play)
    theta = ONLINE_THRESHOLDS if thresholds is None else checked_thresholds(thresholds)
    training = training_data(data, division, name, fit.changed(seed=seed), progress)
    check_objects(training.grid)
    check_price(price, training.sessions)
    note(training.described)
    new = Learner.new(learner, range(training.grid.L), theta, seed, _setup(rig, setting, price, training.taps))
    known = new if state is None else _resumed(Path(state), new)
    if isinstance(rig, str):
        finger, _ = sensor_of(rig, training.taps.source, None)
        fresh = partial(_untrained, training, training_taps, note)
        opened = _opened(choose_rig(rig, training.grid, Wish(None, what, seed, finger), fresh), home)
    else:
        opened = nullcontext(rig)
    bar = progress("Learning", episodes)
    last, objects = known, [""]

    def heard(now: Learner, arm: int, paid: float) -> None:
        nonlocal last
        last = now
        if rig is not None and state is not None:
            save_learner(now, state, force=True)
        bar(1)
        point = int(now.fixation[arm])
        label = training.grid.where_label(point)
        hear(OnlineEpisode(now.episodes, objects[-1], point, label, float(now.theta[arm]), paid))

    try:
        if rig is None:
            costs = held_out_costs(training.parts, known, episodes, cost_error, wrong=wrong, play=play, seed=seed)
            learn(known, episodes, lambda episode, arm: float(costs[arm, episode - known.episodes]), heard)
        else:
            engine = make_engine("filter", training.model, play.border)
            warm_up(engine)
            with opened as place:
                assert place is not None  # noqa: S101 - for the type checker
                learn(known, episodes, _live(place, engine, known, price, play, objects), heard)
    finally:
        if state is not None and last.episodes > known.episodes:
            save_learner(last, state, force=True)
            note(f"{state}: {last.episodes} episodes saved; the same options with --online N add N more.")
    return OnlineTuningReport(training, last, setting)


def _hardly_played(count: int) -> str:
    """A warning if the recommended pair was played in few episodes."""
    if count >= _FEW:
        return ""
    played = {0: "never played", 1: "played only once"}.get(count, f"played only {count} times")
    return f" Warning: this pair was {played}, so its cost is uncertain; learn from more episodes before relying on it."


@contextmanager
def _opened(chosen: ChosenRig, home: bool) -> Iterator[Rig]:
    """A rig as a function, brought to rest when the block ends."""
    with chosen(home, None) as source:

        def place(episode: int) -> tuple[TouchSensor, str | None]:
            placed = source.place(episode)
            return placed.sensor, placed.truth().what

        yield place


def _live(
    place: Rig, engine: Engine, known: Learner, price: Price, play: PlaySettings, objects: list[str]
) -> Callable[[int, int], float]:
    """The cost of episodes on a rig; the names of their objects are added to a list."""
    grid = engine.model.grid

    def cost(episode: int, arm: int) -> float:
        sensor, name = place(episode)
        held = -1 if name is None else int(grid.what_index([name])[0])
        if name is None or held < 0:
            names = ", ".join(grid.what_name)
            raise InputError(f"The true object is unknown; name it with --object, one of {names}.")
        objects.append(name)
        pair = int(known.fixation[arm]), float(known.theta[arm])
        return episode_cost(sensor, engine, held, *pair, price.cost_error, wrong=price.wrong, play=play)

    return cost


def _untrained(training: TrainingData, keep: bool, note: Callable[[str], object], taps: TapSet) -> TapSet:
    """The taps that a replay plays; says which trained the model."""
    model = training.model
    model.check_tapset(taps)
    rest, sentence = untrained_taps(taps, model.training, keep)
    if sentence:
        note(sentence)
    return rest


def _resumed(path: Path, new: Learner) -> Learner:
    """Learner of a file that exists and matches, else the new one.

    Raises:
        InputError: It cannot be written, or is that of another learner.
    """
    check_writable(path, force=True)
    if not path.exists():
        return new
    known = load_learner(path)
    try:
        known.check_like(new)
    except InputError as error:
        raise InputError(f"{path} was learned with other options: {error}.") from error
    return known


def _setup(rig: str | Rig | None, setting: Setting, price: Price, taps: TapSet) -> dict[str, str]:
    """Everything else that costs depend on; the object may change from call to call."""
    free = ("threshold", "fixation", "passive", "note")
    chosen = {name.replace("_", " "): str(value) for name, value in setting.values().items() if name not in free}
    digest = np.bitwise_xor.reduce(taps.digests)
    return {
        "rig": rig if isinstance(rig, str) else getattr(rig, "__name__", "held-out taps" if rig is None else "own"),
        "cost of an error": f"{price.cost_error:g} taps",
        "kind of error": "P(wrong)" if price.wrong else "that of the objects",
        **chosen,
        "training data": f"{len(taps)} taps with digest {digest:016x}",
    }
