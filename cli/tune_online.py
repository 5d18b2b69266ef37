"""Learning fixation point and threshold on line: what `solidtouch tune --online` does."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..models.errors import InputError
from .interrupt import loading

if TYPE_CHECKING:
    from ..analysis.tuning import Price
    from ..inference.held_out import Parts
    from ..inference.online_learning import Learner
    from ..models.classes import ClassGrid
    from ..models.model import TapModel
    from ..models.setting import Setting


class Course(NamedTuple):
    """How something is learned.

    Attributes:
        method: Of `online_learning.METHODS`.
        thresholds: To learn from; `None` for the usual ones.
        episodes: How many.
        seed: Of learner and episodes.
        state: Where what is learned is kept, if anywhere.
        rig: As of `perceive`, or `None` for held-out taps.
        what: The object before a real rig, by name or number.
    """

    method: str
    thresholds: tuple[float, ...] | None
    episodes: int
    seed: int
    state: Path | None
    rig: str | None
    what: str | None


def learned(
    course: Course,
    setting: "Setting",
    price: "Price",
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
        grid: The classes.
        fitted: Fits the model of all training taps, for a rig.
        parts: Holds out training taps, where there is none.
        bar: Told how many more episodes have ended.

    Raises:
        InputError: The state is that of another learner, the rig cannot tell its object, or an argument is wrong.
    """
    from ..analysis.tuning import ONLINE_THRESHOLDS, learned_sentence, learned_setting
    from ..inference.online_learning import Learner, learn, save_learner

    known = Learner.new(course.method, range(grid.L), course.thresholds or ONLINE_THRESHOLDS, course.seed)
    if course.state is not None:
        known = _resumed(course.state, known)
    heard = [known]

    def hear(learner: "Learner", _: int) -> None:
        heard[0] = learner
        bar(1)

    options: dict[str, Any] = {"wrong": price.wrong, "theta_x": setting.theta_x, "deadline": setting.deadline}
    try:
        with ExitStack() as stack:
            if course.rig is None:
                cost = _replayed(parts(), known, course, setting, price, options)
            else:
                cost = _live(fitted(), known, course, setting, price, options, stack)
            learn(known, course.episodes, cost, hear)
    finally:
        if course.state is not None and heard[0].episodes > known.episodes:
            save_learner(heard[0], course.state, force=True)
    print(learned_sentence(heard[0], grid))
    return learned_setting(heard[0], setting)


def _resumed(path: Path, new: "Learner") -> "Learner":
    """What a file holds if it is there, and fits."""
    from ..inference.online_learning import load_learner
    from ..models.storage import check_writable

    check_writable(path, force=True)
    if not path.exists():
        return new
    known = load_learner(path)
    if (known.method, known.seed) != (new.method, new.seed):
        raise InputError(
            f"{path} was learned by {known.method} with seed {known.seed}, and {new.method} with seed {new.seed} is "
            "asked for."
        )
    if known.fixation.tolist() != new.fixation.tolist() or known.theta.tolist() != new.theta.tolist():
        raise InputError(f"{path} was learned with other fixation points or thresholds than are asked for.")
    return known


def _replayed(
    parts: "Parts", known: "Learner", course: Course, setting: "Setting", price: "Price", options: dict[str, Any]
) -> Callable[[int, int], float]:
    """Episodes on held-out taps."""
    from ..inference.episode_costs import held_out_costs

    options = options | {"border": setting.border, "seed": course.seed}
    costs = held_out_costs(parts, known, course.episodes, price.cost_error, **options)
    return lambda episode, arm: float(costs[arm, episode - known.episodes])


def _live(
    model: "TapModel",
    known: "Learner",
    course: Course,
    setting: "Setting",
    price: "Price",
    options: dict[str, Any],
    stack: ExitStack,
) -> Callable[[int, int], float]:
    """Episodes on a rig that tells which object is there."""
    with loading():
        from ..inference.engine import make_engine
        from ..inference.episode_costs import episode_cost
        from ..inference.latency import warm_up
        from .rigs import Wish, open_source

    engine = make_engine("filter", model, setting.border)
    warm_up(engine)
    source = stack.enter_context(open_source(str(course.rig), model.grid, Wish(None, course.what, course.seed)))

    def cost(episode: int, arm: int) -> float:
        placed = source.place(episode)
        name = placed.truth().what
        held = -1 if name is None else int(model.grid.what_index([name])[0])
        if held < 0:
            objects = ", ".join(model.grid.what_name)
            raise InputError(f"Learning needs to know which object is there, one of {objects}; --object says it.")
        point, theta = int(known.fixation[arm]), float(known.theta[arm])
        return episode_cost(placed.sensor, engine, held, point, theta, price.cost_error, **options)

    return cost
