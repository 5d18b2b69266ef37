"""The root of the likelihood learned from training taps: how much one tap should count.

The samples of a tap are not as independent as a model says, and its taps share a session, so a belief at power 1 is
too sure. Each training session is left out in turn and the model fitted to the others. The power is the exponent under
which the belief in the true class of the left-out taps, after a fixed number of them, is highest: mean log posterior
probability, a proper score, so that it pays neither to be too sure nor too timid. It is learned after as many taps as
matter, because the more taps share a session's mistakes the less each of them should count.
"""

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..models.catalogue import FitSettings, Fitted, fit_model
from ..models.classes import ClassGrid
from ..models.errors import InputError
from ..models.model import TapModel
from ..models.power import learned_taps
from ..models.taps import TapSet

LEAST, MOST = 1e-4, 1.0
"""Range of exponents."""
_POINTS = 33  # of the grid
_DRAWS = 10  # sequences of each class and session that has more taps than one sequence
_AT_ONCE = 1 << 21  # numbers


class LearnedPower(NamedTuple):
    """What was learned.

    Attributes:
        power: The exponent.
        sessions: Those left out in turn.
        taps: After how many taps it was judged.
        exponents: Those of the curve, in increasing order, shape (P,).
        score: Mean log belief in the true class under each, in nats, shape (P,).
    """

    power: float
    sessions: tuple[int, ...]
    taps: int
    exponents: NDArray[np.float64]
    score: NDArray[np.float64]

    @property
    def sentence(self) -> str:
        """How it was learned."""
        listed = ", ".join(map(str, self.sessions))
        end = {LEAST: ", the least tried,", MOST: ", the most tried,"}.get(self.power, "")
        return (
            f"Power {self.power:.4g}{end} learned on sessions {listed}, left out in turn: the highest mean log belief "
            f"in the true class, {self.score.max():.3g}, after {self.taps} tap{'s' * (self.taps > 1)} of a class, or "
            "all that it has."
        )


def fit_tempered(
    name: str, taps: TapSet, grid: ClassGrid, settings: FitSettings, trained_on: str = ""
) -> tuple[Fitted, LearnedPower | None]:
    """Fits a model of the catalogue, its power first learned where the settings ask for that.

    Args:
        name: Of the model.
        taps: Training taps.
        grid: The classes.
        settings: How; a power that is learned becomes the model's, and `trained_on` says how.
        trained_on: Which taps these are, in words.

    Raises:
        InputError: As `fit_model` and `learn_power`.
    """
    n = learned_taps(settings.power)
    if n is None:
        return fit_model(name, taps, grid, settings, trained_on), None
    learned = learn_power(name, taps, grid, settings, n, settings.seed)
    told = " ".join(part for part in (trained_on, learned.sentence) if part)
    return fit_model(name, taps, grid, settings._replace(power=learned.power), told), learned


def learn_power(name: str, taps: TapSet, grid: ClassGrid, settings: FitSettings, n: int, seed: int) -> LearnedPower:
    """The exponent with the highest mean log belief in the true class of left-out taps.

    The sequences are of one class and session, without replacement; a class with fewer taps in a session gives them
    all. Where several exponents are equally good, the smallest is taken.

    Args:
        name: Of the model.
        taps: Training taps of two sessions or more.
        grid: The classes.
        settings: How to fit; the power is ignored.
        n: Taps of a sequence.
        seed: Of the sequences.

    Raises:
        InputError: There are less than two sessions, none has a class that the others have too, left-out taps are
            impossible under their own class, or as `fit_model`.
    """
    sessions = np.unique(taps.session).tolist()
    if len(sessions) < 2:
        raise InputError(
            f"A learned power needs two training sessions or more, to leave each out in turn, and there is session "
            f"{sessions[0]} only."
        )
    if n < 1:
        raise InputError(f"A power is learned after one tap or more, got {n}.")
    used, sequences = [], []
    for session in sessions:
        model = fit_model(name, taps.select(taps.session != session), grid, settings._replace(power="none")).model
        left_out = _usable(model, taps.select(taps.session == session))
        if left_out is not None:
            used.append(session)
            sequences.append(_sequences(model, left_out, n, np.random.default_rng([seed, n, session & 0xFFFFFFFF])))
    if not used:
        raise InputError("A learned power needs classes with taps in two training sessions or more, and there is none.")
    return _best(sequences, tuple(used), n)


class _Sequences(NamedTuple):
    """Sums over the taps of sequences.

    Attributes:
        log_likelihood: At power 1, shape (Q, L, S M).
        where: True class, shape (Q,).
        what: Likewise.
        weight: How many taps each stands for, shape (Q,).
        log_prior: Shape (L, S M).
        M: Number of objects.
    """

    log_likelihood: NDArray[np.float64]
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    weight: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    M: int

    def piece(self, which: slice) -> Self:
        """Some of them."""
        return self._replace(
            log_likelihood=self.log_likelihood[which],
            where=self.where[which],
            what=self.what[which],
            weight=self.weight[which],
        )


def _usable(model: TapModel, taps: TapSet) -> TapSet | None:
    """The taps of trained classes, if there are any."""
    where, what = taps.indices(model.grid)
    inside = (where >= 0) & (what >= 0)
    inside[inside] = model.trained[where[inside], what[inside]]
    return taps.select(inside) if inside.any() else None


def _sequences(model: TapModel, taps: TapSet, n: int, generator: np.random.Generator) -> _Sequences:
    log_likelihood = model.log_likelihood(taps.taps)
    where, what = taps.indices(model.grid)
    own = where * model.grid.M + what
    sums, first, weight = [], [], []
    for c in np.unique(own):
        members = np.flatnonzero(own == c)
        if n == 1:
            chosen = list(members[:, np.newaxis])
        elif n < len(members):
            chosen = [generator.choice(members, size=n, replace=False) for _ in range(_DRAWS)]
        else:
            chosen = [members]
        sums += [log_likelihood[sequence].sum(axis=0) for sequence in chosen]
        first += [members[0]] * len(chosen)
        weight += [len(members) / len(chosen)] * len(chosen)
    return _Sequences(np.array(sums), where[first], what[first], np.array(weight), model.log_prior, model.grid.M)


def _best(sequences: list[_Sequences], sessions: tuple[int, ...], n: int) -> LearnedPower:
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - SciPy takes long to import

    impossible = sum(int(np.isneginf(_true(part, part.log_likelihood)).all(axis=1).sum()) for part in sequences)
    if impossible:
        raise InputError(
            f"The power cannot be learned: {impossible} sequences of left-out taps are impossible under their own "
            "class; a --pseudocount above 0 makes every tap possible."
        )
    exponents = np.geomspace(LEAST, MOST, _POINTS)
    score = np.array([_score(sequences, exponent) for exponent in exponents])
    top = int(score.argmax())
    around = np.log(exponents[[max(top - 1, 0), min(top + 1, _POINTS - 1)]])
    found: Any = minimize_scalar(lambda x: -_score(sequences, np.exp(x)), bounds=tuple(around), method="bounded")
    power, value = float(np.exp(found.x)), -float(found.fun)
    if value <= score[top]:
        power, value = float(exponents[top]), float(score[top])
    place = int(np.searchsorted(exponents, power))
    if place == len(exponents) or exponents[place] != power:
        exponents, score = np.insert(exponents, place, power), np.insert(score, place, value)
    return LearnedPower(power, sessions, n, exponents, score)


def _true(part: _Sequences, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (Q, L, S M) at the true class in each state, shape (Q, S)."""
    each = np.arange(len(values))
    return values.reshape(len(values), len(part.log_prior), -1, part.M)[each, part.where, :, part.what]


def _score(sequences: list[_Sequences], exponent: float) -> float:
    """Mean log belief in the true class; all sessions together, each tap with the same weight."""
    total = weight = 0.0
    for part in sequences:
        step = max(1, _AT_ONCE // part.log_prior.size)
        for first in range(0, len(part.where), step):
            piece = part.piece(slice(first, first + step))
            log_joint = piece.log_prior + exponent * piece.log_likelihood
            log_belief = _log_sum(_true(piece, log_joint)) - _log_sum(log_joint.reshape(len(log_joint), -1))
            total += float(piece.weight @ log_belief)
        weight += float(part.weight.sum())
    return total / weight


def _log_sum(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logs of sums over the last axis, of which something is above log 0."""
    top = values.max(axis=-1)
    return top + np.log(np.exp(values - top[:, np.newaxis]).sum(axis=-1))
