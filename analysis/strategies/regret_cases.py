"""Small problems with known minimum cost, and the strategies and rules evaluated in them.

All are preset `model`: taps drawn from histograms of the simulated rig, as symbols, so that the filter with border
`clamp` is exactly right and any strategy's cost can be computed or bounded. A millimetre of error costs 1; each tap and
each millimetre really moved have their cost too.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.simulator.session import simulate_session
from ...hardware.simulator.settings import preset
from ...inference.bayes_risk.problem import RiskProblem, risk_problem
from ...inference.moves.control import MovePolicy, fixation
from ...inference.moves.expected_gain import gain_watch, risk_mover
from ...inference.moves.strategies import make_policy
from ...inference.moves.table import TargetTable, learn_table
from ...inference.stopping.rules import error_loss
from ...inference.stopping.stopping import StopRule, Watch, after, divergences, lookahead, msprt, what_above
from ...inference.trials.symbols import TapSymbols, quantised
from ...models.measurement.histogram import HistogramModel, fit
from .run import BASE, STRATEGIES

SEED = 4
"""Of the sensor and its symbols: cases are the same whatever the seed of the trials."""
WAY_COST = 0.005
"""Of a millimetre, in millimetres of error."""
TAP_COSTS = (0.02, 0.1)
DRAWN = 2000
"""Taps of each class."""
THETAS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
KINDS = THRESHOLD, NUMBER, LOOKAHEAD, TEST = ("best theta", "best number", "lookahead", "MSPRT")
"""Of stopping rules."""
RISK = "risk"


class ProblemSize(NamedTuple):
    """Sizes of a problem.

    Attributes:
        cell: Width of a where class.
        places: Which of those of the range, neighbours.
        rods: Which of the paper's five.
        samples: Of a tap, few so that errors occur.
        symbols: Of a tap.
        taps: At most, of a trial.
        starts: Of the search for symbols.
        exact: Whether all reachable beliefs can be enumerated.
    """

    cell: str
    places: range
    rods: tuple[int, ...]
    samples: int
    symbols: int
    taps: int
    starts: int = 1
    exact: bool = True


SMALL = (ProblemSize("5mm", range(3), (2, 3), 2, 4, 6, 20), ProblemSize("5mm", range(3), (1, 3), 1, 4, 6, 20))
LARGE = ProblemSize("2mm", range(1, 7), (0, 2, 4), 2, 64, 20, exact=False)


class PreparedProblem(NamedTuple):
    """A case with everything that is computed for it once."""

    case: ProblemSize
    model: HistogramModel
    symbols: TapSymbols
    targets: TargetTable


def world(case: ProblemSize) -> PreparedProblem:
    """Histograms of a simulated session in the classes of a case, and taps drawn from them."""
    taps = simulate_session(preset("paper"), SEED, 0)
    grid = taps.grid(case.cell)
    model = fit(taps, grid.select(case.places, case.rods), power="none")
    model = replace(model, preprocessing=model.preprocessing.of_length(case.samples))
    symbols = quantised(model, case.symbols, SEED, DRAWN, case.starts)
    return PreparedProblem(case, model, symbols, learn_table([symbols.table], model.grid, border="clamp", seed=SEED))


def problem_of(world: PreparedProblem, tap_cost: float) -> RiskProblem:
    """With the error in millimetres as the loss."""
    grid = world.model.grid
    return risk_problem(
        world.symbols.channel,
        error_loss(grid),
        tap_cost=tap_cost,
        class_cost=WAY_COST * float(np.diff(grid.where_value).mean()),
        most_taps=world.case.taps,
    )


def policies(world: PreparedProblem) -> list[str]:
    """The strategies that are compared elsewhere, with a fixation point at every place, and `risk_mover`."""
    grid = world.model.grid
    everywhere = [f"{BASE} at {grid.where_label(l)}" for l in range(grid.L)]
    return [name for one in STRATEGIES for name in (everywhere if one == BASE else [one])] + [RISK]


def policy_of(name: str, world: PreparedProblem, problem: RiskProblem) -> tuple[MovePolicy, int]:
    """One of `policies`, with the number of equal parts of its random number in which it does the same."""
    grid, outcomes = world.model.grid, problem.outcomes
    if name == RISK:
        return risk_mover(outcomes, problem.loss, step_cost=problem.class_cost, border="clamp"), 1
    if name.startswith(f"{BASE} at "):
        return fixation([grid.where_label(l) for l in range(grid.L)].index(name.removeprefix(f"{BASE} at "))), 1
    policy = make_policy(name, grid, border="clamp", outcomes=outcomes, table=world.targets)
    return policy, {"random": grid.L, "step": 2}.get(name, 1)


def rules(world: PreparedProblem, problem: RiskProblem) -> Iterator[tuple[str, str, StopRule]]:
    """Stopping rules with their kind; of those of a kind the cheapest counts."""
    for theta in THETAS:
        yield THRESHOLD, f"{theta:g}", what_above(theta)
    for number in range(1, world.case.taps + 1):
        yield NUMBER, str(number), after(number)
    yield LOOKAHEAD, "", lookahead(problem.tap_cost)
    M = len(problem.loss)
    wrong = problem.loss[~np.eye(M, dtype=bool)].mean()
    yield TEST, "", msprt(_divergences(world.model), problem.tap_cost / wrong)


def _divergences(model: HistogramModel) -> NDArray[np.float64]:
    """At the place where they are largest on the whole; of the taps themselves."""
    each = [divergences(model, l) for l in range(model.grid.L)]
    return max(each, key=lambda values: float(values.min()))


def watch_of(problem: RiskProblem) -> Watch:
    """Records the gain for `lookahead`."""
    return gain_watch(
        problem.outcomes, problem.loss, step_cost=problem.class_cost, negligible=min(TAP_COSTS) / 2, border="clamp"
    )
