"""Online learning of the fixation point and threshold from the costs of episodes.

A pair of fixation point and threshold is an arm of a bandit: an episode is played with one of them, its cost is told,
and the next arm is chosen by what all costs so far say. This is how Lepora, Martinez-Hernandez, Pezzulo and Prescott,
"Active Bayesian perception and reinforcement learning" (IROS 2013), find both; their reward is the negative cost here,
in other units. The learner, `thompson`, has Thompson's idea of playing what a draw from the posterior calls best.

It knows each arm by its own costs alone, taken as normal with unknown mean and variance. The prior has the mean and
variance of all costs so far and weighs as much as one episode for the mean and four for the variance, so it needs no
scale to be given.

A learner is a value: what it has been told as three numbers for each arm. Random numbers belong to its seed and the
number of the episode, so a learner that was saved goes on as if nothing had happened.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...models.errors import InputError, check_format
from ...models.io.mistakes import convert
from ...models.seeds import Purpose, generator
from ...models.storage import complete_file, read_object

type Floats = NDArray[np.float64]
type Method = Literal["thompson"]
METHODS: tuple[str, ...] = get_args(Method.__value__)
FORMAT = 1
_FEWEST = 2  # episodes before anything is known of the spread of costs
_PRIOR = 1.0  # episodes that the prior of an arm's mean weighs
_PRIOR_SPREAD = 4.0  # and that of its variance


@dataclass(frozen=True, eq=False)
class Learner:
    """State of a learner.

    Attributes:
        method: One of `METHODS`.
        seed: Random seed.
        fixation: Fixation point of each arm, shape (A,).
        theta: Its threshold, shape (A,).
        count: Episodes played with it, shape (A,).
        mean: Their mean cost, 0 without one, shape (A,).
        squares: Sum of the squared deviations from it, shape (A,).
        setup: What its costs are of, as words by name; costs of another setup mean something else.
    """

    method: Method
    seed: int
    fixation: NDArray[np.int64]
    theta: Floats
    count: NDArray[np.int64]
    mean: Floats
    squares: Floats
    setup: Mapping[str, str] = field(default_factory=dict)

    @property
    def episodes(self) -> int:
        """Number of episodes so far."""
        return int(self.count.sum())

    @classmethod
    def new(
        cls,
        method: str,
        fixations: Sequence[int],
        thresholds: Sequence[float],
        seed: int = 0,
        setup: Mapping[str, str] | None = None,
    ) -> Self:
        """New learner, with an arm for each pair.

        Raises:
            InputError: The method is unknown, pairs are missing or repeated, or a threshold is not between 0 and 1.
        """
        if method not in METHODS:
            raise InputError(f"--learner must be one of {', '.join(METHODS)}, got {method!r}.")
        for name, values in (("fixation point", fixations), ("threshold", thresholds)):
            if not len(values) or len(set(values)) < len(values):
                raise InputError(f"Learning needs at least one {name} and no duplicates, got {list(values)}.")
        if not all(0 < theta < 1 for theta in thresholds):
            raise InputError(f"Candidate thresholds must be between 0 and 1, got {list(thresholds)}.")
        fixation, theta = (np.array(column) for column in zip(*product(fixations, thresholds), strict=True))
        nothing = np.zeros(len(theta))
        return cls(
            method,  # pyright: ignore[reportArgumentType] - checked above
            seed,
            fixation.astype(np.int64),
            theta.astype(np.float64),
            np.zeros(len(theta), np.int64),
            nothing,
            nothing,
            setup=dict(setup or {}),
        )

    def check_like(self, other: Self) -> None:
        """Checks that another learner has the same method, arms and setup.

        Raises:
            InputError: Something differs; the message says what.
        """
        mine, others = ({"learner": one.method, "seed": str(one.seed), **one.setup} for one in (self, other))
        for name in dict.fromkeys((*mine, *others)):
            if mine.get(name) != others.get(name):
                raise InputError(f"the {name} was {mine.get(name)}, not {others.get(name)}")
        if self.fixation.tolist() != other.fixation.tolist() or self.theta.tolist() != other.theta.tolist():
            raise InputError("the candidate fixation points or thresholds were different")


def choose(learner: Learner) -> int:
    """Arm of the next episode."""
    rng = generator(learner.seed, Purpose.ARM, learner.episodes)
    if learner.episodes < _FEWEST:
        return int(rng.integers(len(learner.theta)))
    mean, scale, freedom = _posterior(learner)
    return int((mean + scale * rng.standard_t(freedom)).argmin())


def told(learner: Learner, arm: int, cost: float) -> Learner:
    """Learner after an episode.

    Args:
        learner: Before it.
        arm: That it was played with.
        cost: What it cost.

    Raises:
        InputError: The cost is no number.
    """
    if not math.isfinite(cost):
        raise InputError(f"The cost of an episode must be a number, got {cost}.")
    count, mean, squares = learner.count.copy(), learner.mean.copy(), learner.squares.copy()
    away = cost - mean[arm]
    count[arm] += 1
    mean[arm] += away / count[arm]
    squares[arm] += away * (cost - mean[arm])
    return replace(learner, count=count, mean=mean, squares=squares)


def learn(
    learner: Learner,
    episodes: int,
    cost: Callable[[int, int], float],
    heard: Callable[[Learner, int, float], None] | None = None,
) -> Learner:
    """Learner after more episodes.

    Args:
        learner: Before them.
        episodes: How many.
        cost: Plays an episode, of this number counted from 0 over the learner's life, with this arm, and says its cost.
        heard: Given the learner after each episode, the arm it had chosen and its cost.
    """
    for _ in range(episodes):
        arm = choose(learner)
        paid = cost(learner.episodes, arm)
        learner = told(learner, arm, paid)
        if heard is not None:
            heard(learner, arm, paid)
    return learner


def beliefs(learner: Learner) -> tuple[Floats, Floats]:
    """Posterior mean and standard deviation of the mean cost of each arm, each of shape (A,).

    Raises:
        InputError: It has been told of less than two episodes.
    """
    if learner.episodes < _FEWEST:
        raise InputError(f"At least {_FEWEST} episodes are needed to estimate a cost, got {learner.episodes}.")
    mean, scale, freedom = _posterior(learner)
    return mean, scale * np.sqrt(freedom / (freedom - 2.0))


def interval(learner: Learner, arm: int, level: float) -> tuple[float, float]:
    """Ends of a credible interval of an arm's mean cost.

    Args:
        learner: What is known.
        arm: Which.
        level: Such as 0.95.

    Raises:
        InputError: As `beliefs`.
    """
    mean, _ = beliefs(learner)
    _, scale, freedom = _posterior(learner)
    half = float(stdtrit(freedom[arm], (1 + level) / 2) * scale[arm])
    return float(mean[arm]) - half, float(mean[arm]) + half


def recommended(learner: Learner) -> int:
    """Recommended arm: the lowest mean plus standard deviation of the cost.

    An arm that was lucky in few episodes is none, and with the deviation it does not look like one.

    Raises:
        InputError: As `beliefs`.
    """
    mean, deviation = beliefs(learner)
    return int((mean + deviation).argmin())


def save_learner(learner: Learner, path: str | Path, force: bool = False) -> None:
    """Writes a learner as JSON, atomically.

    Raises:
        InputError: The file cannot be written, or exists and `force` is not set.
    """
    values = {
        "format": FORMAT,
        "method": learner.method,
        "seed": learner.seed,
        **{name: getattr(learner, name).tolist() for name in _COLUMNS},
        "setup": dict(learner.setup),
    }
    with complete_file(path, force) as temporary:
        temporary.write_text(json.dumps(values, allow_nan=False) + "\n", encoding="utf-8")


def load_learner(path: str | Path) -> Learner:
    """Learner from a file, exactly as saved.

    Raises:
        InputError: The file is missing or holds no learner.
    """
    values = read_object(path, "learner")
    check_format(values.get("format"), f"{path}: a learner", FORMAT)
    if values.get("format") != FORMAT:
        raise InputError(f"{path}: not a learner file: key 'format' is not {FORMAT}.")
    try:
        file = convert({name: value for name, value in values.items() if name != "format"}, _LearnedFile)
    except InputError as error:
        raise InputError(f"{path}: damaged learner file: {error}") from error
    learner = Learner(
        method=file.method,
        seed=file.seed,
        **{name: np.array(getattr(file, name), dtype=kind) for name, kind in _COLUMNS.items()},
        setup=file.setup,
    )
    shapes = {getattr(learner, name).shape for name in _COLUMNS}
    finite = all(np.isfinite(column).all() for column in (learner.theta, learner.mean, learner.squares))
    if len(shapes) != 1 or not finite or not len(learner.theta):
        raise InputError(f"{path}: damaged learner file: a list has the wrong length, or a number is not finite.")
    return learner


type _Count = Annotated[int, msgspec.Meta(ge=0, lt=1 << 53)]


class _LearnedFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a learner file, besides its format."""

    method: Method
    seed: _Count
    fixation: list[_Count]
    theta: list[float]
    count: list[_Count]
    mean: list[float]
    squares: list[Annotated[float, msgspec.Meta(ge=0)]]
    setup: dict[str, str]
    smoothness: None = None  # in files of versions that had a learner with one


_COLUMNS: dict[str, Any] = {
    "fixation": np.int64,
    "theta": np.float64,
    "count": np.int64,
    "mean": np.float64,
    "squares": np.float64,
}


def _posterior(learner: Learner) -> tuple[Floats, Floats, Floats]:
    """Mean, scale and degrees of freedom of Student's t for each arm's mean cost."""
    n, total = learner.count, learner.episodes
    centre = float(n @ learner.mean) / total
    spread = float(learner.squares.sum() + n @ (learner.mean - centre) ** 2) / total
    weight = _PRIOR + n
    mean = (_PRIOR * centre + n * learner.mean) / weight
    total_squares = _PRIOR_SPREAD * spread + learner.squares + _PRIOR * n / weight * (learner.mean - centre) ** 2
    freedom = _PRIOR_SPREAD + n.astype(np.float64)
    return mean, np.sqrt(total_squares / (freedom * weight)), freedom
