"""Comparison of all ways of computing the posterior on the same episodes.

Routes from a fitted model: the plain NumPy reference, the enumerated one-tap NumPyro model, the compiled filter of the
Monte Carlo, the whole-sequence NumPyro model summed by funsor for the first taps of each episode, and whole trials of
the Monte Carlo in compiled loops and in arrays. Any measurement model goes through all of them.

What they share is checked by two more. For the histogram, `inference.raw` goes from the training taps to episodes and
trials by the equations of the reference alone. For every model, the NumPyro story gives the likelihood of test taps at
the fitted parameters, which is compared with that of the compiled loops.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.replay import ReplayRig
from ...inference import reference
from ...inference.engines.engine import Engine, make_engine
from ...inference.filter import fold
from ...inference.raw import LabelledTaps, Options, RawFilter
from ...inference.reference import Border
from ...inference.trials.records import plan_trials, tap_table
from ...inference.trials.run import THRESHOLDS
from ...models import seeds
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from ...models.measurement.registry import PAPER
from ...models.settings import learned_taps
from ...models.taps import TapSet
from ..stats.no_class_left import impossible_cause
from .settings import ExperimentSettings
from .trial_check import RAW, TrialDifferences, belief_gap, compare_trials

if TYPE_CHECKING:
    from ...inference.engines.enumeration import SequencePosterior

TOLERANCE = 1e-10
STORY_TOLERANCE = 1e-9
"""Relative difference allowed between log-likelihoods of a tap, absolute below 1."""
_STORY_TAPS = 10
NEAR_TIE = 1e-6
STORY = "compiled, numpyro story"
_COMPARED_ABOVE = -600.0  # log posteriors below it are no longer compared with each other


class Script(NamedTuple):
    """One episode that all routes go through.

    Attributes:
        taps: Prepared samples, shape (T, J, K).
        targets: The where class aimed for after each tap, shape (T,).
        deltas: Moves between the taps, shape (T - 1,), or (T,) where a tap follows that leaves no class.
        impossible: Samples of this tap, shape (J, K).
    """

    taps: NDArray[np.float64]
    targets: NDArray[np.intp]
    deltas: NDArray[np.intp]
    impossible: NDArray[np.float64] | None


class RouteDifference(NamedTuple):
    """The largest difference of one quantity between two routes."""

    quantity: str
    routes: str
    largest: float
    allowed: float

    @property
    def passed(self) -> bool:
        """Whether it is as small as allowed; NaN is not."""
        return bool(self.largest <= self.allowed)


class CrossCheck(NamedTuple):
    """Results of the cross-check of one model.

    Attributes:
        rows: Largest differences.
        episodes: Episodes compared.
        taps: Taps of each.
        sequence_taps: How many of them the whole-sequence route held; 0 where it was not run.
        differing_decisions: Decisions that differ between routes, over all taps and thresholds.
        differing_moves: Moves that differ.
        near_ties: Differences where the deciding beliefs lie within `NEAR_TIE`, not counted above.
        notes: Sentences about routes that could not be run as asked.
    """

    rows: tuple[RouteDifference, ...]
    episodes: int
    taps: int
    sequence_taps: int
    differing_decisions: int
    differing_moves: int
    near_ties: int
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every difference is allowed and no decision or move differs."""
        return all(row.passed for row in self.rows) and not self.differing_decisions and not self.differing_moves


class _Trace(NamedTuple):
    """One route through one episode: log beliefs (T, L, H) and log evidence (T,)."""

    log_beliefs: NDArray[np.float64]
    log_evidence: NDArray[np.float64]


def crosscheck_model(
    model: TapModel,
    taps: TapSet,
    *,
    train: TapSet | None = None,
    settings: ExperimentSettings | None = None,
    border: Border = "uniform",
    episodes: int = 10,
    length: int = 40,
    sequence_taps: int = 20,
    seed: int = 0,
    progress: Callable[[], None] | None = None,
) -> CrossCheck:
    """Compares all routes over random episodes with a move after every tap.

    An episode ends before a tap that is impossible under every class still believed in; all routes must find it so.

    Args:
        model: The fitted measurement model.
        taps: Test taps of trained classes.
        train: The training taps; without them the route from raw taps is left out.
        settings: How the model was fitted, for that route; default `ExperimentSettings()`.
        border: Reading of Eq. 9; under `"prior"`, which is no kernel, the NumPyro routes are left out.
        episodes: Number of episodes.
        length: Taps of each.
        sequence_taps: How many of them to hand to the whole-sequence route, at most 20; halved while it underflows.
        seed: Of the episodes.
        progress: Called after each episode.

    Raises:
        InputError: The border is `"prior"` and the model carries a state, or a sequence is too long.
    """
    from ...models.touch import KERNEL_BORDERS  # noqa: PLC0415 - NumPyro takes seconds to import

    model = model.judging(taps)
    generator = seeds.generator(seed, seeds.Purpose.EPISODES)
    names = ("numpy", "numpyro", "filter") if border in KERNEL_BORDERS else ("numpy", "filter")
    engines = [make_engine(name, model, border) for name in names]
    notes = (
        []
        if len(names) == 3
        else [f"The NumPyro routes were left out, because border {border} is not a Markov kernel."]
    )
    comparison = _Comparison(model.grid.M)
    if model.runs_story:
        notes.append(
            f"{model.name} runs its function for every tap, so that there is no other likelihood to compare it with."
        )
    else:
        comparison.add_story(model, taps)
    raw = None if train is None else _raw_filter(model, train, taps, settings or ExperimentSettings(), border, notes)
    if raw is not None:
        comparison.add_fit(model, raw)
    sequence = _SequenceRoute(model, border, min(sequence_taps, length) if "numpyro" in names else 0, notes)
    ended = 0
    for _ in range(episodes):
        script, expected = _script(engines[0], taps, length, generator)
        ended += script.impossible is not None
        for engine in engines[1:]:
            actual, same_end = _follow(engine, engine.model.log_prior, script)
            comparison.add(f"numpy, {engine.name}", expected, actual, script.targets)
            comparison.differing_decisions += not same_end
        if raw is not None:
            actual, same_end = _follow(raw, raw.log_prior, script)
            comparison.add(f"numpy, {RAW}", expected, actual, script.targets)
            comparison.differing_decisions += not same_end
        sequence.add(comparison, expected, script)
        if progress is not None:
            progress()
    table = tap_table(model, taps)
    plan = plan_trials(table.pool, episodes, seed)
    plan = plan._replace(fixation=generator.integers(model.grid.L, size=episodes))
    for name, differences in compare_trials(engines[0], table, taps, plan, border, length, NEAR_TIE, raw).items():
        comparison.add_trials(f"numpy, {name} trials", differences)
    if ended:
        notes.append(
            f"{ended} of {episodes} episodes end early, before a tap that is impossible under every remaining class. "
            f"{impossible_cause(model)}"
        )
    return CrossCheck(
        comparison.rows(),
        episodes,
        length,
        sequence.taps,
        comparison.differing_decisions,
        comparison.differing_moves,
        comparison.near_ties,
        tuple(notes),
    )


class _SequenceRoute:
    """The whole-sequence enumeration, on as many taps as it can hold."""

    def __init__(self, model: TapModel, border: Border, taps: int, notes: list[str]) -> None:
        self.model = model
        self.border: Border = border
        self.taps = taps
        self.notes = notes

    def add(self, comparison: "_Comparison", expected: _Trace, script: Script) -> None:
        """Enumerates the first taps of an episode; halves their number, for good, while they underflow."""
        from ...inference.engines.enumeration import SequenceUnderflowError, enumerate_sequence  # noqa: PLC0415

        while self.taps and len(script.taps):
            T = min(self.taps, len(script.taps))
            try:
                posterior = enumerate_sequence(
                    self.model, script.taps[:T], script.deltas[: T - 1].tolist(), self.border
                )
            except SequenceUnderflowError as error:
                self.taps = T // 2
                rest = f"continued with {self.taps} taps" if self.taps else "left this route out"
                self.notes.append(f"{str(error).rstrip('.')}; {rest}.")
                continue
            shorter = _Trace(expected.log_beliefs[:T], expected.log_evidence[:T])
            comparison.add_sequence(shorter, posterior, script.targets[:T])
            return


class _Comparison:
    """Largest differences so far, by routes and quantity.

    Args:
        M: Objects; beliefs have the shape (T, L, H), see `models.measurement.states`.
    """

    def __init__(self, M: int) -> None:
        self._M = M
        self.taps: dict[str, int] = {}
        self.largest: dict[tuple[str, str], float] = {}
        self.differing_decisions = self.differing_moves = self.near_ties = 0

    def add(self, routes: str, expected: _Trace, actual: _Trace, targets: NDArray[np.intp]) -> None:
        """Compares two recursions over one episode."""
        self.taps[routes] = len(targets)
        self._note_beliefs(routes, np.exp(expected.log_beliefs), np.exp(actual.log_beliefs))
        compared = expected.log_beliefs > _COMPARED_ABOVE
        self._note(routes, "log posterior", expected.log_beliefs[compared], actual.log_beliefs[compared])
        self._note(routes, "log evidence", expected.log_evidence.cumsum(), actual.log_evidence.cumsum())
        for t, target in enumerate(targets.tolist()):
            self._compare_choices(np.exp(expected.log_beliefs[t]), np.exp(actual.log_beliefs[t]), target)

    def add_sequence(self, expected: _Trace, posterior: "SequencePosterior", targets: NDArray[np.intp]) -> None:
        """Compares the recursion with the enumerated sequence."""
        routes = "numpy, numpyro sequence"
        self.taps[routes] = max(self.taps.get(routes, 0), len(targets))
        self._note_beliefs(routes, np.exp(expected.log_beliefs), posterior.filtered)
        self._note(routes, "log evidence", expected.log_evidence.cumsum(), posterior.log_evidence)
        for t, target in enumerate(targets.tolist()):
            self._compare_choices(np.exp(expected.log_beliefs[t]), posterior.filtered[t], target)

    def add_fit(self, model: TapModel, raw: RawFilter) -> None:
        """Compares what was fitted with what the training taps give."""
        if not isinstance(model, HistogramModel):
            raise TypeError(f"A model of type {type(model).__name__} has no counts.")
        routes = f"fit, {RAW}"
        log_prob = np.where(model.trained[..., np.newaxis, np.newaxis], model.log_prob, -np.inf)
        self._note(routes, "bin edges", model.edges, raw.edges)
        self._note(routes, "log histograms", log_prob, raw.log_prob)
        self._note(routes, "prior", np.exp(model.log_prior), np.exp(raw.log_prior))
        self._note(routes, "exponent", np.array(model.exponent), np.array(raw.exponent))

    def add_story(self, model: TapModel, taps: TapSet) -> None:
        """Compares log-likelihoods at power 1 under every trained class, by compiled loops and by the NumPyro story."""
        from ...models.measurement.likelihood.story_likelihood import log_likelihoods  # noqa: PLC0415 - NumPyro takes seconds to import

        seen = taps.taps[np.linspace(0, len(taps) - 1, min(_STORY_TAPS, len(taps))).astype(np.intp)]
        compiled = np.empty((len(seen), *model.form.shape))
        model.prepared.log_likelihood(seen, model.edges, 1.0, compiled)
        possible = ~np.isneginf(model.log_prior)
        story, compiled = log_likelihoods(model, seen)[:, possible], compiled[:, possible]
        size = np.maximum(1.0, np.abs(np.where(np.isfinite(compiled), compiled, 1.0)))
        self._note(STORY, "log likelihood", compiled / size, story / size)

    def add_trials(self, routes: str, differences: TrialDifferences) -> None:
        """Counts what differed between trials."""
        self._note(routes, "decided belief", *differences.belief)
        self.differing_decisions += differences.decisions
        self.near_ties += differences.near_ties

    def rows(self) -> tuple[RouteDifference, ...]:
        """The findings; log quantities may differ by the tolerance times the number of taps."""
        return tuple(
            RouteDifference(quantity, routes, value, self._allowed(routes, quantity))
            for (routes, quantity), value in self.largest.items()
        )

    def _allowed(self, routes: str, quantity: str) -> float:
        if routes == STORY:
            return STORY_TOLERANCE
        return TOLERANCE * (self.taps.get(routes, 1) if quantity.startswith("log ") else 1)

    def _note_beliefs(self, routes: str, expected: NDArray[np.float64], actual: NDArray[np.float64]) -> None:
        self._note(routes, "posterior", expected, actual)
        expected, actual = fold(expected, self._M), fold(actual, self._M)
        self._note(routes, "where marginal", expected.sum(axis=2), actual.sum(axis=2))
        self._note(routes, "what marginal", expected.sum(axis=1), actual.sum(axis=1))

    def _note(self, routes: str, quantity: str, expected: NDArray[np.float64], actual: NDArray[np.float64]) -> None:
        with np.errstate(invalid="ignore"):
            differences = np.where(expected == actual, 0.0, np.abs(expected - actual))  # equal infinities too
        difference = float(differences.max(initial=0.0))
        # A NaN stays a NaN, so that it cannot pass.
        self.largest[routes, quantity] = float(np.maximum(self.largest.get((routes, quantity), 0.0), difference))

    def _compare_choices(self, expected: NDArray[np.float64], actual: NDArray[np.float64], target: int) -> None:
        expected, actual = fold(expected, self._M), fold(actual, self._M)
        what = reference.what_marginal(expected)
        for theta in THRESHOLDS:
            if reference.what_decision(expected, theta) != reference.what_decision(actual, theta):
                near = min(belief_gap(what), abs(what.max() - theta)) < NEAR_TIE
                self.near_ties += near
                self.differing_decisions += not near
        if _move(expected, target) != _move(actual, target):
            near = belief_gap(reference.where_marginal(expected)) < NEAR_TIE
            self.near_ties += near
            self.differing_moves += not near


def _script(engine: Engine, taps: TapSet, length: int, generator: np.random.Generator) -> tuple[Script, _Trace]:
    """An episode on recorded taps that aims for a new random class after every tap, and what the engine made of it."""
    grid = engine.model.grid
    where, what = taps.indices(grid)
    start = int(generator.integers(len(taps)))
    rig = ReplayRig(taps, grid, int(where[start]), int(what[start]), generator)
    targets = generator.integers(grid.L, size=length)
    log_belief, recorded, deltas, log_beliefs, log_evidence = engine.model.log_prior, [], [], [], []
    impossible = None
    for t in range(length):
        tap = rig.tap()
        try:
            log_belief, evidence = engine.update(log_belief, tap)
        except reference.ZeroEvidenceError:
            impossible = tap
            break
        recorded.append(tap)
        log_beliefs.append(log_belief)
        log_evidence.append(evidence)
        if t < length - 1:
            deltas.append(_move(np.exp(log_belief), int(targets[t])))
            rig.move(deltas[-1])
            log_belief = engine.shift(log_belief, deltas[-1])
    T = len(recorded)
    samples = np.array(recorded).reshape(T, *taps.taps.shape[1:])
    script = Script(samples, targets[:T], np.array(deltas, dtype=np.intp), impossible)
    return script, _trace(engine.model.log_prior, log_beliefs, log_evidence)


def _raw_filter(
    model: TapModel, train: TapSet, taps: TapSet, settings: ExperimentSettings, border: Border, notes: list[str]
) -> RawFilter | None:
    """The paper's filter from the training taps and the options that the user gave; None for other models."""
    if model.name != PAPER:
        return None
    if np.isnan(train.taps).any() or np.isnan(taps.taps).any():
        notes.append("The route from raw taps was left out, because samples are missing.")
        return None
    power = settings.fit.power
    if learned_taps(power) is not None:
        power = model.exponent
        notes.append(f"The route from raw taps takes the learned exponent {power:.4g} from the model.")
    options = Options(
        bins=settings.fit.bins,
        value_range=settings.fit.value_range,
        pseudocount=settings.fit.pseudocount,
        power=power,  # pyright: ignore[reportArgumentType]
        border=border,
        saturation=settings.fit.limit,
    )
    return RawFilter.learn(LabelledTaps(train.taps, *train.indices(model.grid)), model.grid.shape, options)


def _follow(engine: Engine | RawFilter, log_prior: NDArray[np.float64], script: Script) -> tuple[_Trace, bool]:
    """What another engine makes of an episode, and whether it ends there for it too."""
    log_belief, log_beliefs, log_evidence = log_prior, [], []
    for t, tap in enumerate(script.taps):
        if t:
            log_belief = engine.shift(log_belief, int(script.deltas[t - 1]))
        log_belief, evidence = engine.update(log_belief, tap)
        log_beliefs.append(log_belief)
        log_evidence.append(evidence)
    if script.impossible is None:
        return _trace(log_prior, log_beliefs, log_evidence), True
    if log_beliefs:
        log_belief = engine.shift(log_belief, int(script.deltas[-1]))
    try:
        engine.update(log_belief, script.impossible)
    except reference.ZeroEvidenceError:
        return _trace(log_prior, log_beliefs, log_evidence), True
    return _trace(log_prior, log_beliefs, log_evidence), False


def _trace(log_prior: NDArray[np.float64], log_beliefs: list[NDArray[np.float64]], log_evidence: list[float]) -> _Trace:
    return _Trace(np.array(log_beliefs).reshape(-1, *log_prior.shape), np.array(log_evidence))


def _move(belief: NDArray[np.float64], target: int) -> int:
    return reference.fixation_move(int(reference.where_marginal(belief).argmax()), target)
