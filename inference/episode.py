"""One perception episode with any sensor and any engine: tap, update, decide or move."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..hardware.replay import Chance, as_uniforms
from ..hardware.sensor import TouchSensor, check_sensor, check_step
from ..models.errors import InputError, check_count
from ..models.io.model_file import ModelSource
from ..models.measurement.model import TapModel
from . import reference
from .engines.engine import Engine
from .filter import Filter, engine_of
from .moves.control import MovePolicy
from .stopping.stopping import DECIDE, GIVE_UP, GO_ON, Moment, StopRule, Watch, what_above

DEADLINE = 100


class Step(NamedTuple):
    """One tap, the belief after it, and the decision or move that follows.

    Attributes:
        number: Number of the tap, counted from 1.
        tap: Its samples, shape (J, K).
        arrived: The move really made before it, 0 before the first.
        log_predicted: Log belief before the tap, summed over the states of the episode, shape (L, M).
        log_belief: The same after it, before the move that follows, shape (L, M).
        log_evidence: Log evidence of the tap given those before.
        decision: Index of the object that is decided for, or `None`.
        move: The move that will follow in where classes, or `None` where the episode ends.
        log_state: Log belief in the states of the episode after the tap, shape (S,); one zero for a model without.
        gave_up: Whether the episode ends here without an answer.
        no_class_left: Whether the tap is impossible under every class still believed in: the episode ends here
            undecided, the belief is that before the tap, and `log_evidence` is -inf.
    """

    number: int
    tap: NDArray[np.float64]
    arrived: int
    log_predicted: NDArray[np.float64]
    log_belief: NDArray[np.float64]
    log_evidence: float
    decision: int | None
    move: int | None
    log_state: NDArray[np.float64] = np.zeros(1)
    gave_up: bool = False
    no_class_left: bool = False

    @property
    def where_marginal(self) -> NDArray[np.float64]:
        """P(x_l | taps so far), shape (L,); Eq. 5."""
        return reference.where_marginal(np.exp(self.log_belief))

    @property
    def what_marginal(self) -> NDArray[np.float64]:
        """P(w_m | taps so far), shape (M,); Eq. 6."""
        return reference.what_marginal(np.exp(self.log_belief))

    @property
    def where(self) -> int:
        """Index of the most probable position at the time of this tap."""
        return int(np.argmax(self.where_marginal))

    @property
    def what(self) -> int:
        """Index of the most probable object."""
        return int(np.argmax(self.what_marginal))


class EpisodeSetup(NamedTuple):
    """What an episode was made with, as far as it is needed to show it.

    Attributes:
        model: The measurement model.
        theta: Threshold on the what belief; 1 of another rule or none.
        fixation: Index of the fixation point, or `None`.
        taxel_mm: Places of the taxels in mm, shape (K, 2) or (K, 3), or `None` where the sensor has no `taxel_mm`.
        units: Unit of the samples; empty where the sensor has no `units`.
    """

    model: TapModel
    theta: float
    fixation: int | None
    taxel_mm: NDArray[np.float64] | None
    units: str = ""


class Episode(NamedTuple):
    """Result of an episode; tap t counts from 0, and `log_beliefs[t]` is the belief after it, before the next move.

    Attributes:
        log_beliefs: Log belief after every tap, shape (T, L, M).
        log_evidence: Log evidence of every tap given those before, shape (T,).
        moves: Commanded moves between the taps in where classes, shape (T - 1,).
        realised: Moves really made, clipped at the ends of the range, shape (T - 1,).
        what: Index of the decided object; `grid.what_name` of the model has the names.
        where: Index of the decided position, at the last tap.
        stopped: Whether the rule decided; otherwise the deadline came, it gave up or no class was left, and the
            decisions are the most probable classes at that time.
        gave_up: Whether it ended without an answer, a null decision.
        no_class_left: Whether it ended with a tap that is impossible under every class still believed in; the last
            belief is that before this tap.
        samples: Samples of every tap, shape (T, J, K).
        setup: Model, threshold and fixation point; `None` of an episode that is collected from steps.
    """

    log_beliefs: NDArray[np.float64]
    log_evidence: NDArray[np.float64]
    moves: NDArray[np.int64]
    realised: NDArray[np.int64]
    what: int
    where: int
    stopped: bool
    gave_up: bool = False
    no_class_left: bool = False
    samples: NDArray[np.float64] = np.zeros((0, 0, 0))
    setup: EpisodeSetup | None = None

    def __repr__(self) -> str:
        end = "decided" if self.stopped else "undecided"
        taps = f"{self.taps} tap{'s' * (self.taps != 1)}"
        return f"<Episode of {taps}: {end}, object {self.what} at position {self.where}>"

    @property
    def taps(self) -> int:
        """Reaction time: number of taps."""
        return len(self.log_beliefs)


def perceive(
    sensor: TouchSensor,
    engine: Engine | ModelSource,
    stop: float | StopRule,
    move: MovePolicy,
    deadline: int = DEADLINE,
    *,
    chance: Chance | None = None,
    watch: Watch | None = None,
) -> Episode:
    """Episode of taps until the stopping rule ends it; runs `steps` to the end.

    >>> import solidtouch as st
    >>> model = st.fit(st.simulate("paper", seed=4))
    >>> rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
    >>> st.perceive(rig, model, stop=0.95, move=st.fixation(7))
    <Episode of 7 taps: decided, object 1 at position 7>

    Args:
        sensor: Where taps come from.
        engine: How beliefs are computed; of a model or its file, with the compiled engine.
        stop: As in `steps`.
        move: Control strategy.
        deadline: Taps after which the most probable classes are taken.
        chance: As in `steps`.
        watch: As in `steps`.

    Raises:
        InputError: As `steps`.
    """
    check_sensor(sensor)
    engine = engine_of(engine)
    made = steps(sensor, engine, stop, move, deadline, chance=chance, watch=watch)
    theta = 1.0 if callable(stop) else float(stop)
    places, point = getattr(sensor, "taxel_mm", None), getattr(move, "fixation_index", None)
    setup = EpisodeSetup(engine.model, theta, point, places, getattr(sensor, "units", ""))
    return collect(made)._replace(setup=setup)


def steps(
    sensor: TouchSensor,
    engine: Engine | ModelSource,
    stop: float | StopRule,
    move: MovePolicy,
    deadline: int = DEADLINE,
    doubt: Callable[[NDArray[np.float64], int], bool] | None = None,
    *,
    chance: Chance | None = None,
    watch: Watch | None = None,
) -> Iterator[Step]:
    """Iterator over the steps of an episode; Fig. 2 of the paper.

    After each tap come the update (Eq. 3, 4), the stop test (Eq. 7) and, if it goes on, the move (Eq. 8, 10) with the
    shift of the belief (Eq. 9). The stop test comes first because the shift may change the what marginal. The belief
    is shifted by the commanded move: the realised one would tell where the sensor stood. Of a model whose taps carry
    a limited evidence, what is carried from tap to tap stays as it is; all that is decided by and shown is the belief
    that `saturation` reads from it.

    The move is made when the next step is asked for, so who stops asking ends the episode where the sensor stands.
    A tap that is impossible under every class still believed in ends it too, see `Step.no_class_left`.

    >>> import solidtouch as st
    >>> model = st.fit(st.simulate("paper", seed=4))
    >>> rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
    >>> [(step.number, step.move) for step in st.steps(rig, model, 0.95, st.fixation(7), deadline=3)]
    [(1, 5), (2, 0), (3, None)]

    Args:
        sensor: Where taps come from.
        engine: How beliefs are computed; of a model or its file, with the compiled engine.
        stop: Threshold theta_W on the what belief, of which 1 never stops, or another stopping rule.
        move: Control strategy.
        deadline: Taps after which the episode ends.
        doubt: Called with each tap and the actual move before it; no decision is made while it returns True.
        chance: Numbers in [0, 1), one for each move that is chosen, or a NumPy generator of them. The same numbers on
            the same taps give the same episode; by default every episode has those of a generator seeded 0.
        watch: Returns the `"gain"` of the next tap, for rules that look ahead, see `expected_gain.gain_watch`; the
            move is then chosen before the stop test.

    Raises:
        InputError: An argument is of the wrong kind or out of range, or the sensor's preprocessing, step or number of
            positions is not the model's. While steps are made: the rule needs a gain that nobody watches, or a
            tap is refused as by `Filter.update`.
    """
    check_count(deadline, "deadline")
    check_sensor(sensor)
    engine = engine_of(engine)
    if not callable(move):
        raise InputError(f"move must be a control strategy such as fixation(7), got {move!r}.")
    engine.model.check_taps(sensor.preprocessing)
    check_step(sensor.step, engine.model.grid)
    chance = as_uniforms(chance)
    rule = stop if callable(stop) else what_above(stop)
    return _made(sensor, Filter(engine), rule, move, deadline, doubt, chance, watch)


def _made(
    sensor: TouchSensor,
    known: Filter,
    rule: StopRule,
    move: MovePolicy,
    deadline: int,
    doubt: Callable[[NDArray[np.float64], int], bool] | None,
    chance: Iterator[float],
    watch: Watch | None,
) -> Iterator[Step]:
    """Iterator over the steps, for checked arguments of `steps`."""
    arrived = 0
    for number in range(1, deadline + 1):
        tap = sensor.tap()
        log_predicted, log_states = known.log_belief, known.log_states
        try:
            log_evidence = known.update(tap)
        except reference.ZeroEvidenceError:
            if doubt is not None:
                doubt(tap, arrived)
            beliefs = log_predicted, log_predicted, -np.inf
            yield Step(number, tap, arrived, *beliefs, None, None, log_states, no_class_left=True)
            return
        log_belief = known.log_belief
        belief = np.exp(log_belief)
        doubted = doubt is not None and doubt(tap, arrived)
        delta = None if watch is None else int(move(belief, np.asarray(next(chance))))
        answer = int(rule(_moment(belief, number, delta, watch)))
        if doubted and answer == DECIDE:
            answer = GO_ON
        if answer != GO_ON or number == deadline:
            delta = None
        elif watch is None:
            delta = int(move(belief, np.asarray(next(chance))))
        yield Step(
            number,
            tap,
            arrived,
            log_predicted,
            log_belief,
            log_evidence,
            int(np.argmax(reference.what_marginal(belief))) if answer == DECIDE else None,
            delta,
            known.log_states,
            answer == GIVE_UP,
        )
        if delta is None:
            return
        arrived = sensor.move(delta)
        known.move(delta)


def _moment(belief: NDArray[np.float64], number: int, delta: int | None, watch: Watch | None) -> Moment:
    """Input of a stopping rule from a belief (L, M)."""
    gain = np.asarray(np.nan) if watch is None else watch(belief[np.newaxis], np.array([delta]))["gain"][0]
    where_belief = np.asarray(reference.where_marginal(belief).max())
    return Moment(reference.what_marginal(belief), where_belief, np.asarray(number), gain)


def collect(made: Iterator[Step]) -> Episode:
    """Episode from its steps, at least one."""
    whole = list(made)
    last = whole[-1]
    return Episode(
        log_beliefs=np.array([step.log_belief for step in whole]),
        log_evidence=np.array([step.log_evidence for step in whole]),
        moves=np.array([step.move for step in whole[:-1]], dtype=np.int64),
        realised=np.array([step.arrived for step in whole[1:]], dtype=np.int64),
        what=last.what,
        where=last.where,
        stopped=last.decision is not None,
        gave_up=last.gave_up,
        no_class_left=last.no_class_left,
        samples=np.array([step.tap for step in whole]),
    )
