"""Learning fixation point and threshold on line: what `solidtouch tune --online` does."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.untrained import untrained

if TYPE_CHECKING:
    from ..analysis.tuning.run import Price
    from ..inference.tuning.held_out import Parts
    from ..inference.tuning.online import Learner
    from ..models.grid import ClassGrid
    from ..models.measurement.model import TapModel
    from ..models.setting_file import Setting
    from ..models.taps import TapSet


class LearningPlan(NamedTuple):
    """How something is learned.

    Attributes:
        method: Of `tuning.online.METHODS`.
        thresholds: To learn from; `None` for the usual ones.
        episodes: How many.
        seed: Of learner and episodes.
        state: Where what is learned is kept, if anywhere.
        rig: As of `perceive`, or `None` for held-out taps.
        what: The object before a real rig, by name or number.
        home: Whether to home a real stage first.
        training_taps: Whether a replay also plays taps that train the model.
    """

    method: str
    thresholds: tuple[float, ...] | None
    episodes: int
    seed: int
    state: Path | None
    rig: str | None
    what: str | None
    home: bool = False
    training_taps: bool = False


def learned(
    course: LearningPlan,
    setting: "Setting",
    price: "Price",
    taps: "TapSet",
    grid: "ClassGrid",
    fitted: Callable[[], "TapModel"],
    parts: Callable[[], "Parts"],
    bar: Callable[[int], None],
) -> "Setting":
    """The setting that a learner recommends; what it has learned is kept also when it is interrupted.

    Args:
        course: How to learn.
        setting: All else.
        price: What an episode costs.
        taps: All training taps.
        grid: The classes.
        fitted: Fits the model of all training taps, for a rig.
        parts: Holds out training taps, where there is none.
        bar: Told how many more episodes have ended.

    Raises:
        InputError: The state is that of another learner, the rig cannot tell its object, or an argument is wrong.
    """
    from ..analysis.tuning.run import ONLINE_THRESHOLDS, learned_sentence, learned_setting
    from ..inference.tuning.online import Learner, learn, save_learner

    setup = _setup(course, setting, price, taps)
    known = Learner.new(course.method, range(grid.L), course.thresholds or ONLINE_THRESHOLDS, course.seed, setup)
    if course.state is not None:
        known = _resumed(course.state, known)
    heard = [known]

    def hear(learner: "Learner", _: int) -> None:
        heard[0] = learner
        if course.rig is not None and course.state is not None:
            save_learner(learner, course.state, force=True)
        bar(1)

    options: dict[str, Any] = {"wrong": price.wrong, "play": setting.play}
    try:
        with ExitStack() as stack:
            if course.rig is None:
                cost = _replayed(parts(), known, course, price, options)
            else:
                cost = _live(fitted(), known, course, setting, price, options, stack)
            learn(known, course.episodes, cost, hear)
    finally:
        if course.state is not None and heard[0].episodes > known.episodes:
            save_learner(heard[0], course.state, force=True)
            print(f"{course.state} holds {heard[0].episodes} episodes; with the same options --online N adds N more.")
    print(learned_sentence(heard[0], grid))
    return learned_setting(heard[0], setting)


def _resumed(path: Path, new: "Learner") -> "Learner":
    """What a file holds if it is there, and fits."""
    from ..inference.tuning.online import load_learner
    from ..models.storage import check_writable

    check_writable(path, force=True)
    if not path.exists():
        return new
    known = load_learner(path)
    try:
        known.check_like(new)
    except InputError as error:
        raise InputError(f"{path} was learned otherwise: {error}.") from error
    return known


def _setup(course: LearningPlan, setting: "Setting", price: "Price", taps: "TapSet") -> dict[str, str]:
    """What costs depend on beside fixation point and threshold; the object may change from call to call."""
    from ..models.digest import tap_digests

    free = ("threshold", "fixation", "passive", "note")
    chosen = {name.replace("_", " "): str(value) for name, value in setting.values().items() if name not in free}
    digest = np.bitwise_xor.reduce(tap_digests(taps.taps))
    return {
        "rig": course.rig or "held-out taps",
        "cost of an error": f"{price.cost_error:g} taps",
        "kind of error": "P(wrong)" if price.wrong else "that of the objects",
        **chosen,
        "training data": f"{len(taps)} taps with digest {digest:016x}",
    }


def _replayed(
    parts: "Parts", known: "Learner", course: LearningPlan, price: "Price", options: dict[str, Any]
) -> Callable[[int, int], float]:
    """Episodes on held-out taps."""
    from ..inference.tuning.costs import held_out_costs

    costs = held_out_costs(parts, known, course.episodes, price.cost_error, seed=course.seed, **options)
    return lambda episode, arm: float(costs[arm, episode - known.episodes])


def _live(
    model: "TapModel",
    known: "Learner",
    course: LearningPlan,
    setting: "Setting",
    price: "Price",
    options: dict[str, Any],
    stack: ExitStack,
) -> Callable[[int, int], float]:
    """Episodes on a rig that tells which object is there."""
    with loading():
        from ..inference.engines.engine import make_engine
        from ..inference.engines.latency import warm_up
        from ..inference.tuning.costs import episode_cost
        from .shared.rigs import Wish, open_source

    engine = make_engine("filter", model, setting.play.border)
    warm_up(engine)
    wish = Wish(None, course.what, course.seed)
    fresh = partial(untrained, model, keep=course.training_taps)
    source = stack.enter_context(open_source(str(course.rig), model.grid, wish, course.home, fresh=fresh))

    def cost(episode: int, arm: int) -> float:
        placed = source.place(episode)
        name = placed.truth().what
        held = -1 if name is None else int(model.grid.what_index([name])[0])
        if held < 0:
            objects = ", ".join(model.grid.what_name)
            raise InputError(f"Learning needs to know which object is there, one of {objects}; --object says it.")
        point, theta = int(known.fixation[arm]), float(known.theta[arm])
        paid = episode_cost(placed.sensor, engine, held, point, theta, price.cost_error, **options)
        label = model.grid.where_label(point)
        print(f"Episode {episode + 1}: {name}, fixation point {label}, threshold {theta:g}, cost {paid:.1f} taps")
        return paid

    return cost
