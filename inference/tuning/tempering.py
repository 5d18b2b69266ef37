"""Power of the likelihood and cap on an episode's evidence, learned from taps.

The samples of a tap are not as independent as a model says, and its taps share a session, so a belief at power 1 is
too sure. Each training session is left out in turn and the model fitted to the others. The power is the exponent under
which the belief in the true class of the left-out taps, after a fixed number of them, is highest: mean log posterior
probability, a proper score, so that it pays neither to be too sure nor too timid. It is learned after as many taps as
matter, because the more taps share a session's mistakes the less each of them should count.

No exponent is right after all numbers of taps. `learn_saturation` finds, with the exponent of a single tap, how many
taps' evidence an episode carries at most (see `saturation`), so that beliefs are right after few taps and after many.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import Fitted, TapModel
from ...models.measurement.registry import fit_model
from ...models.progress import Progress, no_progress
from ...models.settings import FitSettings, learned_taps
from ...models.taps import TapSet
from ..filter import share
from ..trials.judged_sequences import JudgedSession, Sequences, mean_log_belief, refuse_impossible

LEAST, MOST = 1e-4, 1.0
"""Range of exponents."""
CONTACTS = (1, 2, 5, 10, 20, 50)
"""Numbers of taps over which a saturation is learned."""
_POINTS = 33  # of the grid
_LIMITS = 33  # saturations tried
_STEP, _FINEST = 0.1, 1e-3  # first and last step of the search for the best pair, in logs


class LearnedPower(NamedTuple):
    """A learned power.

    Attributes:
        power: The exponent.
        sessions: Those it was judged on.
        taps: After how many taps it was judged.
        exponents: Those of the curve, in increasing order, shape (P,).
        score: Mean log belief in the true class under each, in nats, shape (P,).
        in_turn: Whether the sessions were left out in turn; otherwise one model was judged on all.
    """

    power: float
    sessions: tuple[int, ...]
    taps: int
    exponents: NDArray[np.float64]
    score: NDArray[np.float64]
    in_turn: bool = True

    @property
    def sentence(self) -> str:
        """How it was learned, as a sentence."""
        how = ", left out in turn" if self.in_turn else ""
        end = {LEAST: ", the lowest tried,", MOST: ", the highest tried,"}.get(self.power, "")
        return (
            f"Power {self.power:.4g}{end} learned on {_listed(self.sessions)}{how}: it has the highest mean log belief "
            f"in the true class, {_signed(self.score.max())}, after {self.taps} tap{'s' * (self.taps > 1)} of a class "
            "(all taps of a class that has fewer)."
        )


class LearnedSaturation(NamedTuple):
    """A learned power with a saturation.

    Attributes:
        power: The exponent of a tap.
        saturation: How many taps' evidence an episode carries at most; infinity where the longest sequences deserve
            no less for each tap than single taps do.
        sessions: Those it was judged on.
        contacts: After how many taps, C numbers.
        score: Mean log belief in the true class after each number of them, in nats, shape (C,).
        constant_power: The best exponent without a limit, over the same numbers of taps.
        constant_score: Its mean log belief, shape (C,).
    """

    power: float
    saturation: float
    sessions: tuple[int, ...]
    contacts: tuple[int, ...]
    score: NDArray[np.float64]
    constant_power: float
    constant_score: NDArray[np.float64]

    @property
    def sentence(self) -> str:
        """How it was learned, as a sentence."""
        limit = "no cap" if np.isinf(self.saturation) else f"a cap of {self.saturation:.3g} taps"
        numbers = ", ".join(map(str, self.contacts))
        return (
            f"Power {self.power:.4g} and {limit} learned on {_listed(self.sessions)}: they have the highest mean log "
            f"belief in the true class, {_signed(self.score.mean())}, over sequences of {numbers} taps of a class; the "
            f"best power without a cap, {self.constant_power:.4g}, has {_signed(self.constant_score.mean())}."
        )


class JudgedSets(NamedTuple):
    """Held-out taps with their likelihoods.

    Attributes:
        sessions: The number of each session.
        judged: Its taps.
    """

    sessions: tuple[int, ...]
    judged: list[JudgedSession]


def fit_tempered(
    name: str,
    taps: TapSet,
    grid: ClassGrid,
    settings: FitSettings,
    trained_on: str = "",
    progress: Progress = no_progress,
) -> tuple[Fitted, LearnedPower | None]:
    """Fitted model, with its power learned first if the settings request this.

    Args:
        name: Name of the model.
        taps: Training taps.
        grid: The classes.
        settings: How; a power that is learned becomes the model's, and `trained_on` says how.
        trained_on: Description of the training taps.
        progress: As for `fit_model`.

    Raises:
        InputError: As `fit_model` and `learn_power`.
    """
    n = learned_taps(settings.power)
    if n is None:
        return fit_model(name, taps, grid, settings, trained_on, progress), None
    learned = learn_power(name, taps, grid, settings, n, settings.seed, progress)
    told = " ".join(part for part in (trained_on, learned.sentence) if part)
    return fit_model(name, taps, grid, settings.changed(power=learned.power), told, progress), learned


def learn_power(
    name: str,
    taps: TapSet,
    grid: ClassGrid,
    settings: FitSettings,
    n: int,
    seed: int,
    progress: Progress = no_progress,
) -> LearnedPower:
    """Exponent with the highest mean log belief in the true class of held-out taps.

    The sequences are of one class and session, without replacement; a class with fewer taps in a session gives them
    all. Where several exponents are equally good, the smallest is taken. Under a saturation, beliefs are judged as
    they are read.

    Args:
        name: Name of the model.
        taps: Training taps of two sessions or more.
        grid: The classes.
        settings: How to fit; the power is ignored.
        n: Taps of a sequence.
        seed: Random seed of the sequences.
        progress: As for `fit_model`.

    Raises:
        InputError: There are less than two sessions, none has a class that the others have too, left-out taps are
            impossible under their own class, or as `fit_model`.
    """
    sessions = np.unique(taps.session).tolist()
    if len(sessions) < 2:
        raise InputError(
            f"A learned power needs at least two training sessions, as each is left out in turn; got session "
            f"{sessions[0]} only."
        )
    _check_length(n)
    used, sequences = [], []
    for session in sessions:
        others, at_one = taps.select(taps.session != session), settings.changed(power="none")
        model = fit_model(name, others, grid, at_one, progress=progress).model
        left_out = _usable(model, taps.select(taps.session == session))
        if left_out is not None:
            used.append(session)
            sequences.append(Sequences.draw(JudgedSession.by(model, left_out), n, seed, session))
    if not used:
        raise InputError("A learned power needs at least one class with taps in two training sessions.")
    return _best(sequences, tuple(used), n)


def best_power(model: TapModel, held_out: Sequence[TapSet] | JudgedSets, n: int, seed: int) -> LearnedPower:
    """Exponent with the highest mean log belief in the true class of taps that did not train the model.

    As `learn_power`, for a model that is fitted already: whatever its own power is, the exponent is that of its
    likelihood at power 1.

    Args:
        model: The fitted model.
        held_out: Taps of one session or more, or what `judged_sets` gives for them; sequences are of one session each.
        n: Taps of a sequence; a class with fewer in a session gives them all.
        seed: Random seed of the sequences.

    Raises:
        InputError: There is no tap of a trained class, taps are impossible under their own class or were prepared
            otherwise, or there are no taps in a sequence.
    """
    _check_length(n)
    sessions, judged = held_out if isinstance(held_out, JudgedSets) else judged_sets(model, held_out)
    parts = zip(sessions, judged, strict=True)
    sequences = [Sequences.draw(one, n, seed, session) for session, one in parts]
    return _best(sequences, sessions, n)._replace(in_turn=False)


def learn_saturation(
    model: TapModel, held_out: Sequence[TapSet] | JudgedSets, contacts: Sequence[int] = CONTACTS, seed: int = 0
) -> LearnedSaturation:
    """Exponent and saturation with the highest mean log belief in the true class of held-out taps.

    The mean is taken over the taps, then over the numbers of contacts, each with the same weight. Sequences are of one
    class and session, without replacement as long as the class has enough taps in the session; longer ones are drawn
    with replacement, as trials and replayed rigs draw them. Saturations lie between 1 and the longest sequence: below
    1 a smaller exponent means the same.

    Args:
        model: The fitted model; the exponent is that of its likelihood at power 1, whatever its own power is.
        held_out: Taps that did not train it, of one session or more, or what `judged_sets` gives for them.
        contacts: Numbers of taps of a sequence.
        seed: Random seed of the sequences.

    Raises:
        InputError: As `best_power`, or there is no number of contacts.
    """
    contacts = tuple(dict.fromkeys(int(n) for n in contacts))
    if not contacts:
        raise InputError("contacts must have at least one number of taps.")
    for n in contacts:
        _check_length(n)
    sessions, judged = held_out if isinstance(held_out, JudgedSets) else judged_sets(model, held_out)
    sequences: list[list[Sequences]] = []
    for n in contacts:
        parts = zip(sessions, judged, strict=True)
        sequences.append([Sequences.draw(one, n, seed, session, again=True) for session, one in parts])
    refuse_impossible([part for parts in sequences for part in parts])

    @cache
    def score(i: int, exponent: float, power: float) -> float:
        return mean_log_belief(sequences[i], exponent, power)

    def scores(exponent: float, saturation: float) -> NDArray[np.float64]:
        return np.array([score(i, exponent, share(n, saturation)) for i, n in enumerate(contacts)])

    power, saturation, constant_power = _best_pair(score, scores, contacts)
    return LearnedSaturation(
        power,
        saturation,
        sessions,
        contacts,
        scores(power, saturation),
        constant_power,
        scores(constant_power, np.inf),
    )


def _best_pair(
    score: Callable[[int, float, float], float],
    scores: Callable[[float, float], NDArray[np.float64]],
    contacts: Sequence[int],
) -> tuple[float, float, float]:
    """Best exponent with its saturation, and best exponent without one.

    What counts is nearly the product of exponent and share alone, exactly so where the prior is flat. So the curve of
    each number of contacts is drawn once and read for all pairs, and the search around the best pair is exact.
    """
    most = float(max(contacts))
    products = np.geomspace(LEAST / most, MOST, _POINTS)
    curves = [[score(i, float(product), 1.0) for product in products] for i in range(len(contacts))]
    exponents, limits = np.geomspace(LEAST, MOST, 2 * _POINTS), np.geomspace(1.0, most, _LIMITS)

    def read(limit: float) -> NDArray[np.float64]:
        """Mean of the curves at every exponent."""
        shares = [share(n, limit) for n in contacts]
        each = [np.interp(np.log(exponents * s), np.log(products), c) for s, c in zip(shares, curves, strict=True)]
        return np.mean(each, axis=0)

    surface = np.array([read(limit) for limit in limits])
    row, column = np.unravel_index(surface.argmax(), surface.shape)
    ends = np.log([[LEAST, 1.0], [MOST, most]])

    def climb(limited: bool, *start: float) -> tuple[float, float]:
        """Best exponent with its saturation, or without."""

        def mean(point: NDArray[np.float64]) -> float:
            exponent, limit = np.exp(point.clip(*ends)).tolist()
            return float(scores(exponent, limit if limited else np.inf).mean())

        exponent, limit = np.exp(_climb(mean, np.log(start), 1 + limited).clip(*ends)).tolist()
        return exponent, limit if limited else np.inf

    constant, _ = climb(False, float(exponents[surface[-1].argmax()]), most)
    power, saturation = climb(True, float(exponents[column]), float(limits[row]))
    if saturation >= most or scores(power, saturation).mean() <= scores(constant, np.inf).mean():
        return constant, np.inf, constant
    return power, saturation, constant


def _climb(
    height: Callable[[NDArray[np.float64]], float], point: NDArray[np.float64], axes: int
) -> NDArray[np.float64]:
    """Local maximum by steps along the first axes, halved down to `_FINEST`."""
    step, top = _STEP, height(point)
    while step > _FINEST:
        around = [point + sign * step * np.eye(len(point))[axis] for axis in range(axes) for sign in (-1, 1)]
        heights = [height(one) for one in around]
        best = int(np.argmax(heights))
        if heights[best] > top:
            point, top = around[best], heights[best]
        else:
            step /= 2
    return point


def _usable(model: TapModel, taps: TapSet) -> TapSet | None:
    """Taps of trained classes, if any."""
    known = model.known(taps)
    if known.all():
        return taps
    return taps.select(known) if known.any() else None


def judged_sets(model: TapModel, held_out: Sequence[TapSet]) -> JudgedSets:
    """What `best_power` and `learn_saturation` need of held-out taps; raises as they do."""
    sessions, judged = [], []
    for taps in held_out:
        model.check_taps(taps.preprocessing)
        usable = _usable(model, taps)
        if usable is None:
            continue
        apart = np.unique(usable.session).tolist()
        for session in apart:
            sessions.append(session)
            own = usable if len(apart) == 1 else usable.select(usable.session == session)
            judged.append(JudgedSession.by(model, own))
    if not judged:
        raise InputError("No held-out tap belongs to a trained class, so nothing can be learned.")
    return JudgedSets(tuple(sessions), judged)


def _best(sequences: list[Sequences], sessions: tuple[int, ...], n: int) -> LearnedPower:
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - SciPy takes long to import

    refuse_impossible(sequences)
    exponents = np.geomspace(LEAST, MOST, _POINTS)
    score = np.array([mean_log_belief(sequences, exponent) for exponent in exponents])
    top = int(score.argmax())
    around = np.log(exponents[[max(top - 1, 0), min(top + 1, _POINTS - 1)]])
    found: Any = minimize_scalar(
        lambda x: -mean_log_belief(sequences, np.exp(x)), bounds=tuple(around), method="bounded"
    )
    power, value = float(np.exp(found.x)), -float(found.fun)
    if value <= score[top]:
        power, value = float(exponents[top]), float(score[top])
    place = int(np.searchsorted(exponents, power))
    if place == len(exponents) or exponents[place] != power:
        exponents, score = np.insert(exponents, place, power), np.insert(score, place, value)
    return LearnedPower(power, sessions, n, exponents, score)


def _check_length(n: int) -> None:
    if n < 1:
        raise InputError(f"taps must be at least 1, got {n}.")


def _signed(value: float) -> str:
    """Three digits, with a real minus sign."""
    text = f"{value:.3g}"
    return f"−{text[1:]}" if value < 0 else text


def _listed(sessions: Sequence[int]) -> str:
    return f"session{'s' * (len(sessions) > 1)} {', '.join(map(str, sessions))}"
