"""Regret of strategies: cost above the exact rule on small problems, above a lower bound on a larger one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import batched, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.bayes_risk.bounds import alpha_cost_bound, known_place_bound, qmdp
from ...inference.bayes_risk.exact_cost import Cost, expected_cost, expected_costs
from ...inference.bayes_risk.problem import RiskProblem
from ...inference.bayes_risk.risk import exact_rule
from ...inference.stopping.recorded import stops
from ...inference.stopping.stopping import StopRule
from ...inference.trials.lockstep import Record, play
from ...inference.trials.records import plan_trials
from ...models.errors import InputError
from ...models.progress import Progress
from ...models.threads import one_blas_thread
from ..tasks.crew import THREADS, Crew
from .regret_cases import (
    LARGE,
    SMALL,
    TAP_COSTS,
    PreparedProblem,
    ProblemSize,
    policies,
    policy_of,
    problem_of,
    rules,
    watch_of,
    world,
)

type Floats = NDArray[np.float64]

TRIALS, QUICK_TRIALS = 10_000, 2_000
_AT_ONCE = 1000  # trials, so that all workers have some to the end
_FEWEST_TRIALS = 4  # two choose rules, two price them
_GRID_STEPS = 60  # of the bound
_ALIKE = 5e-5  # mm by which costs differ that look alike in tables


@dataclass(frozen=True)
class RegretSettings:
    """Settings of the regret study.

    Attributes:
        trials: Of each policy where costs are drawn; half of them choose rules, the others price them.
        seed: Of the trials.
    """

    trials: int = TRIALS
    seed: int = 0


class Priced(NamedTuple):
    """A policy with the cheapest rule of a kind.

    Attributes:
        policy: Its name.
        kind: Of the rule.
        rule: Threshold or number of taps; empty where nothing is chosen.
        judged: Mean cost that made it the cheapest, which it flatters where costs are drawn.
        each: Cost of each of the trials that price it, the same for all policies, shape (trials,); an exact cost is
            alone.
    """

    policy: str
    kind: str
    rule: str
    judged: float
    each: Floats

    @property
    def cost(self) -> float:
        """The mean cost."""
        return float(self.each.mean())


class Regrets(NamedTuple):
    """Costs of all policies in a case at one cost of taps.

    Attributes:
        world: The case.
        problem: With the costs.
        bounds: Costs that no strategy stays below, the largest first: that of the exact rule, or bounds by name.
        best: What the cost of the exact rule is made of; `None` where it is not known.
        prices: Of every policy with every kind of rule.
    """

    world: PreparedProblem
    problem: RiskProblem
    bounds: Mapping[str, float]
    best: Cost | None
    prices: tuple[Priced, ...]

    @property
    def least(self) -> float:
        """What costs are held against."""
        return next(iter(self.bounds.values()))

    @property
    def cheapest(self) -> Priced:
        """What the trials that chose the rules choose among all."""
        return min(self.prices, key=lambda price: price.judged)

    def equals(self, price: Priced) -> bool:
        """Whether a price is that of the cheapest, in every trial, but for what no table shows."""
        return bool(np.abs(price.each - self.cheapest.each).max() < _ALIKE)


def regret_study(settings: RegretSettings, progress: Progress, crew: Crew = THREADS) -> list[Regrets]:
    """All cases at all costs of taps, on the threads or the cluster given.

    Raises:
        InputError: There are too few trials.
    """
    if settings.trials < _FEWEST_TRIALS:
        raise InputError(f"Regret needs {_FEWEST_TRIALS} trials or more, got {settings.trials}.")
    with one_blas_thread():
        *small, large = crew(_world, (*SMALL, LARGE), None)
        tasks = len(TAP_COSTS) * sum(len(policies(one)) for one in small)
        advance = progress("regret", tasks + len(policies(large)) * len(_parts(settings.trials)))
        return exact_regrets(small, TAP_COSTS, crew, advance) + drawn_regrets(large, settings, crew, advance)


def _world(case: ProblemSize, _: None) -> PreparedProblem:
    return world(case)


def exact_regrets(
    worlds: Sequence[PreparedProblem], tap_costs: Sequence[float], crew: Crew, advance: Callable[[int], object]
) -> list[Regrets]:
    """Every policy with every kind of rule, and the exact rule, in each case at each cost of taps."""
    cases = [(number, cost) for number in range(len(worlds)) for cost in tap_costs]
    items = [(number, cost, name) for number, cost in cases for name in policies(worlds[number])]
    prices = crew(exact_prices, items, worlds, advance)
    found = []
    for number, cost in cases:
        problem = problem_of(worlds[number], cost)
        own = tuple(price for of in islice(prices, len(policies(worlds[number]))) for price in of)
        rule = exact_rule(problem)
        found.append(Regrets(worlds[number], problem, {"exact": rule.value}, expected_cost(problem, rule), own))
    return found


def exact_prices(item: tuple[int, float, str], worlds: Sequence[PreparedProblem]) -> list[Priced]:
    """One policy with every kind of rule, exact, from the number of its case and the cost of a tap."""
    number, tap_cost, name = item
    world = worlds[number]
    problem = problem_of(world, tap_cost)
    policy, chances = policy_of(name, world, problem)
    tried = list(rules(world, problem))
    found = expected_costs(problem, policy, [rule for *_, rule in tried], watch_of(problem), chances)
    costs: dict[str, list[Priced]] = {}
    for (kind, label, _), cost in zip(tried, found, strict=True):
        costs.setdefault(kind, []).append(Priced(name, kind, label, cost.total, np.array([cost.total])))
    return _cheapest_rules(costs)


def _cheapest_rules(prices: Mapping[str, Sequence[Priced]]) -> list[Priced]:
    return [min(of, key=lambda price: price.judged) for of in prices.values()]


def drawn_regrets(
    world: PreparedProblem, settings: RegretSettings, crew: Crew, advance: Callable[[int], object]
) -> list[Regrets]:
    """Every policy with every kind of rule at each cost of taps, on drawn trials, the same for all."""
    names, parts = policies(world), _parts(settings.trials)
    items = [(name, part) for name in names for part in parts]
    costs = batched(crew(drawn_costs, items, (world, settings.seed), advance), len(parts))
    problems = [problem_of(world, cost) for cost in TAP_COSTS]
    prices: list[list[Priced]] = [[] for _ in problems]
    for name, of in zip(names, costs, strict=True):
        for number, each in enumerate(zip(*of, strict=True)):
            prices[number] += drawn_prices(world, problems[number], name, np.concatenate(each, axis=1))
    return [
        Regrets(world, problem, bound, None, tuple(of))
        for problem, bound, of in zip(problems, crew(_bounds, TAP_COSTS, world), prices, strict=True)
    ]


def _bounds(tap_cost: float, world: PreparedProblem) -> dict[str, float]:
    return lower_bounds(problem_of(world, tap_cost))


def _parts(trials: int) -> list[range]:
    return [range(start, min(start + _AT_ONCE, trials)) for start in range(0, trials, _AT_ONCE)]


def drawn_costs(item: tuple[str, range], shared: tuple[PreparedProblem, int]) -> list[Floats]:
    """What trials of one policy cost under each of `rules`, shape (rules, trials) for each of `TAP_COSTS`.

    Args:
        item: The policy and which trials.
        shared: The case, and the seed of the trials.
    """
    (name, part), (world, seed) = item, shared
    problems = [problem_of(world, cost) for cost in TAP_COSTS]
    first = problems[0]  # no policy minds what a tap costs
    table, watch = world.symbols.table, watch_of(first)
    plan = plan_trials(table.pool, len(part), seed, first_stream=part.start)
    move, _ = policy_of(name, world, first)
    record = play(table, plan, move, border="clamp", deadline=first.most_taps, seed=seed, watch=watch)
    return [
        np.array([trial_costs(problem, record, rule) for *_, rule in rules(world, problem)]) for problem in problems
    ]


def trial_costs(problem: RiskProblem, record: Record, rule: StopRule) -> Floats:
    """What each recorded trial costs under a rule, shape (n,); one decides for the object of least expected loss.

    As beliefs are right here, the expected loss stands for the one that is met, and varies less.
    """
    found = stops(rule, record)
    last = np.arange(len(found.taps)), found.taps - 1
    loss = (record.what_marginal[last] @ problem.loss.T).min(axis=1)
    return loss + problem.tap_cost * found.taps + problem.class_cost * record.travelled[last]


def drawn_prices(world: PreparedProblem, problem: RiskProblem, name: str, costs: Floats) -> list[Priced]:
    """One policy with every kind of rule, from what trials cost under each of `rules`, shape (rules, trials).

    Half of the trials choose the rule of a kind, the others price it.
    """
    found: dict[str, list[Priced]] = {}
    for (kind, label, _), each in zip(rules(world, problem), costs, strict=True):
        chosen_by, priced_by = np.array_split(each, 2)
        found.setdefault(kind, []).append(Priced(name, kind, label, float(chosen_by.mean()), priced_by))
    return _cheapest_rules(found)


def lower_bounds(problem: RiskProblem) -> dict[str, float]:
    """Costs that no strategy stays below, by what becomes known to it."""
    depths = {"the position known after two taps": 2, "the position known after one tap": 1}
    bounds = {name: known_place_bound(problem, depth, _GRID_STEPS) for name, depth in depths.items()}
    return bounds | {"QMDP or the fast informed bound after two": alpha_cost_bound(problem, qmdp(problem), 2)}
