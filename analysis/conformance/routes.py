"""Answers of the engines of this software to a case."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference import reference
from ...inference.engines.engine import Engine, make_engine
from ...inference.information import About, TapOutcomes, information_of_moves, moves_to_all, tap_outcomes
from ...inference.moves.information import informative
from ...inference.reference_models import log_normal_interval
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement import gaussian
from ...models.measurement.histogram import HistogramModel, fit
from ...models.measurement.likelihood.bins import TableForm
from ...models.measurement.likelihood.shapes import Measure
from ...models.measurement.model import TapModel
from ...models.measurement.scaling import Scaling
from ...models.measurement.table import TableModel
from ...models.preprocessing import Preprocessing
from ...models.taps import TapSet
from .answers import ZERO_EVIDENCE, Answer
from .case import Case


class Route(NamedTuple):
    """One way to answer.

    Attributes:
        engine: Which carries the belief.
        log_likelihood: Of taps (T, J, K), shape (T, L, M).
    """

    engine: Engine
    log_likelihood: Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, eq=False, repr=False)
class NormalTables(TableModel):
    """Probabilities of bins under normal distributions, whose logarithms may lie below those of any double.

    Attributes:
        given: The logarithms.
    """

    given: TableForm

    @cached_property
    def plain_form(self) -> TableForm:
        """The logarithms."""
        return self.given


def answers(route: str, case: Case) -> Iterator[Answer]:
    """What a route answers.

    Args:
        route: One of `engines.ROUTES`.
        case: The case.

    Raises:
        InputError: The route cannot do the border or the tables.
    """
    model = case_model(case)
    engine, log_likelihood = _route(route, model, case)
    if case.training is not None and isinstance(model, HistogramModel):
        yield Answer(0, {"edges": model.edges, "counts": model.counts.astype(np.float64)})
    rows = log_likelihood(case.taps)
    outcomes = None if case.pool is None else tap_outcomes(log_likelihood(case.pool), model.trained)
    with np.errstate(divide="ignore"):
        log_belief = np.log(case.prior)
    for t, (tap, move) in enumerate(zip(case.taps, case.moves.tolist(), strict=True)):
        if t:
            log_belief = engine.shift(log_belief, move)
        try:
            log_belief, log_evidence = engine.update(log_belief, tap)
        except reference.ZeroEvidenceError:
            yield Answer(t + 1, error=ZERO_EVIDENCE)
            return
        if case.expects(t + 1):
            yield Answer(t + 1, {"log_likelihood": rows[t]} | _choices(case, log_belief, log_evidence, outcomes))


def case_model(case: Case) -> TapModel:
    """The model of a case."""
    grid = ClassGrid(np.array(case.places), "mm", None, tuple((name,) for name in case.objects))
    record = Preprocessing(samples=case.taps.shape[1])
    if case.training is not None:
        taps = TapSet.from_arrays(
            case.training.taps,
            case.training.what,
            case.objects,
            preprocessing=record,
            where=np.array(case.places)[case.training.where],
            where_value=case.places,
        )
        return fit(taps, grid, bins=case.bins, pseudocount=case.pseudocount, power=case.power)
    edges = np.asarray(case.edges)
    if case.mean is not None and case.sd is not None:
        form = _normal_form(case.mean, case.sd, edges)
        return NormalTables(grid, edges, case.power, record, np.exp(form.log_prob), form)
    if case.counts is not None:
        return HistogramModel(grid, edges, case.power, record, case.counts, case.pseudocount)
    return TableModel(grid, edges, case.power, record, np.asarray(case.probabilities))


def _route(name: str, model: TapModel, case: Case) -> Route:
    if name == "numpy":
        return Route(make_engine("numpy", model, case.border), _equations(model, case))
    if name == "montecarlo":
        return Route(make_engine("filter", model, case.border), model.log_likelihood)
    sums = np.ones(1) if case.probabilities is None else case.probabilities[model.trained].sum(axis=-1)
    if not np.allclose(sums, 1.0, rtol=0, atol=1e-12):
        raise InputError("Tables that do not sum to one are not probabilities, so the NumPyro models cannot take them.")
    return Route(make_engine("numpyro", model, case.border), _enumerated(model))


def _equations(model: TapModel, case: Case) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Eq. 1 and 2 of the reference."""
    log_prob = _log_tables(model, case)
    return lambda taps: np.array(
        [reference.tap_log_likelihood(reference.tap_bins(tap, model.edges), log_prob, case.power) for tap in taps]
    )


def _log_tables(model: TapModel, case: Case) -> NDArray[np.float64]:
    """Log P_k(b) as the reference has it, shape (L, M, K, B)."""
    if case.mean is not None and case.sd is not None:
        inner = (
            np.broadcast_to(model.edges, (model.K, case.bins + 1))[:, 1:-1] - case.mean[..., np.newaxis]
        ) / case.sd[..., np.newaxis]
        end = np.full((*case.mean.shape, 1), np.inf)
        return log_normal_interval(np.concatenate([-end, inner], axis=-1), np.concatenate([inner, end], axis=-1))
    if isinstance(model, HistogramModel):
        probabilities = reference.histogram_probabilities(model.counts, case.pseudocount)
    else:
        probabilities = np.asarray(case.probabilities)
    with np.errstate(divide="ignore"):
        return np.log(probabilities)


def _normal_form(mean: NDArray[np.float64], sd: NDArray[np.float64], edges: NDArray[np.float64]) -> TableForm:
    """Likelihood of the model `gaussian` with these parameters; it bounds `sd` by that of a uniform draw from a bin."""
    K = mean.shape[-1]
    frame = Measure(Scaling(np.zeros(K), np.ones(K)), edges, np.zeros((0, 0, 0)))
    return gaussian.form({"level": mean[:, :, np.newaxis], "variance": sd[:, :, np.newaxis] ** 2}, frame)


def _enumerated(model: TapModel) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """The NumPyro model of one tap."""
    import jax  # noqa: PLC0415 - it takes long to import

    from ...inference.engines.enumeration import log_likelihoods  # noqa: PLC0415

    def of(taps: NDArray[np.float64]) -> NDArray[np.float64]:
        with jax.enable_x64(True):
            found = log_likelihoods(model, taps)
        return np.where(model.trained, model.exponent * found, -np.inf)

    return of


def _choices(
    case: Case, log_belief: NDArray[np.float64], log_evidence: float, outcomes: TapOutcomes | None
) -> dict[str, object]:
    belief = np.exp(log_belief)
    decisions = [reference.what_decision(belief, theta) for theta in case.thresholds]
    place = reference.where_decision(belief, case.theta_x)
    return {
        "log_evidence": log_evidence,
        "posterior": belief,
        "log_posterior": log_belief,
        "where": reference.where_marginal(belief),
        "what": reference.what_marginal(belief),
        "decisions": np.array([-1 if m is None else m for m in decisions]),
        "move": 0 if place is None else reference.fixation_move(place, case.fixation),
    } | ({} if outcomes is None else _informed(case, belief, outcomes))


def _informed(case: Case, belief: NDArray[np.float64], outcomes: TapOutcomes) -> dict[str, object]:
    """Move and information of a strategy."""
    about: About = case.strategy.removeprefix("info-")  # pyright: ignore[reportAssignmentType] - one of these words
    found = information_of_moves(outcomes, belief, moves_to_all(belief), case.border, about)
    move = informative(outcomes, about, case.border)(belief, np.zeros(()))
    return {"information": found, "move": int(move)}
