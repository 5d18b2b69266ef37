"""What strategies cost more than need be: than the exact rule on small cases, than a lower bound on a larger one.

Both are preset `model`: taps drawn from histograms of the simulated rig, as symbols, so that the filter with border
`clamp` is exactly right and any strategy's cost can be computed or bounded. `python benchmarks/regret.py --document
docs/strategies.md` writes the tables of that page.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from solidtouch.hardware.data_collection import simulate_session
from solidtouch.hardware.presets import preset
from solidtouch.inference.bayes_risk import exact_rule
from solidtouch.inference.control import MovePolicy, fixation, passive, random_place
from solidtouch.inference.control_information import informative
from solidtouch.inference.exact_cost import Cost, course, expected_cost
from solidtouch.inference.expected_gain import gain_watch, risk_mover
from solidtouch.inference.lockstep import Record, play
from solidtouch.inference.recorded_stops import stops
from solidtouch.inference.risk_bounds import alpha_cost_bound, known_place_bound, qmdp
from solidtouch.inference.risk_problem import RiskProblem, risk_problem
from solidtouch.inference.stopping import StopRule, after, divergences, lookahead, msprt, what_above
from solidtouch.inference.tap_symbols import TapSymbols, quantised
from solidtouch.inference.trial_plan import plan_trials
from solidtouch.models.histogram import HistogramModel, fit
from solidtouch.models.threads import one_blas_thread
from studies import check_block, table, until_interrupted, write_block, write_json

BLOCK = "regret"
SEED = 4
WAY_COST = 0.005
"""Of a millimetre, in millimetres of error."""
TAP_COSTS = (0.02, 0.1)
DRAWN = 2000
"""Taps of each class."""
THETAS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
RULES = ("best theta", "best number", "lookahead", "MSPRT")


class Case(NamedTuple):
    """Sizes of a problem.

    Attributes:
        cell: Width of a where class.
        places: Which of those of the range, neighbours.
        rods: Which of the paper's five.
        samples: Of a tap, few so that errors occur.
        symbols: Of a tap.
        taps: At most, of a trial.
        starts: Of the search for symbols.
    """

    cell: str
    places: range
    rods: tuple[int, ...]
    samples: int
    symbols: int
    taps: int
    starts: int = 1


SMALL = (Case("5mm", range(3), (2, 3), 2, 4, 6, 20), Case("5mm", range(3), (1, 3), 1, 4, 6, 20))
LARGE = Case("2mm", range(1, 7), (0, 2, 4), 2, 64, 20)


class World(NamedTuple):
    """A case with everything that is computed for it once."""

    case: Case
    model: HistogramModel
    symbols: TapSymbols


class Priced(NamedTuple):
    """A policy with a kind of stopping rule: the rule taken, its mean cost, and half its interval."""

    policy: str
    kind: str
    rule: str
    cost: float
    half: float


def world(case: Case) -> World:
    """Histograms of a simulated session in the classes of a case, and taps drawn from them."""
    taps = simulate_session(preset("paper"), SEED, 0)
    grid = taps.grid(case.cell)
    model = fit(taps, grid.select(case.places, case.rods), power="none")
    model = replace(model, preprocessing=replace(model.preprocessing, samples=case.samples))
    return World(case, model, quantised(model, case.symbols, SEED, DRAWN, case.starts))


def problem_of(world: World, tap_cost: float) -> RiskProblem:
    """With the error in millimetres as the loss."""
    size, where = world.model.grid.what_value, world.model.grid.where_value
    return risk_problem(
        world.symbols.channel,
        np.abs(np.subtract.outer(size, size)),
        tap_cost=tap_cost,
        class_cost=WAY_COST * float(np.diff(where).mean()),
        most_taps=world.case.taps,
    )


def policies(world: World, problem: RiskProblem) -> dict[str, tuple[MovePolicy, int]]:
    """Policies by name, each with the number of equal parts of its random number."""
    grid, outcomes = world.model.grid, problem.outcomes
    return {
        "passive": (passive, 1),
        "random": (random_place(), grid.L),
        **{f"fixation at {grid.where_label(l)}": (fixation(l), 1) for l in range(grid.L)},
        **{f"information, {about}": (informative(outcomes, about, "clamp"), 1) for about in ("joint", "where", "what")},
        "risk": (risk_mover(outcomes, problem.loss, step_cost=problem.class_cost, border="clamp"), 1),
    }


def rules(world: World, problem: RiskProblem) -> Iterator[tuple[str, str, StopRule]]:
    """Stopping rules with their kind; of those of a kind the cheapest counts."""
    for theta in THETAS:
        yield "best theta", f"{theta:g}", what_above(theta)
    for number in range(1, world.case.taps + 1):
        yield "best number", str(number), after(number)
    yield "lookahead", "", lookahead(problem.tap_cost)
    M = len(problem.loss)
    wrong = problem.loss[~np.eye(M, dtype=bool)].mean()
    yield "MSPRT", "", msprt(_divergences(world.model), problem.tap_cost / wrong)


def _divergences(model: HistogramModel) -> NDArray[np.float64]:
    """At the place where they are largest on the whole; of the taps themselves."""
    each = [divergences(model, l) for l in range(model.grid.L)]
    return max(each, key=lambda values: float(values.min()))


def watch_of(problem: RiskProblem) -> Any:
    """Records the gain for `lookahead`."""
    return gain_watch(
        problem.outcomes, problem.loss, step_cost=problem.class_cost, negligible=min(TAP_COSTS) / 2, border="clamp"
    )


def exact_prices(world: World, problem: RiskProblem) -> list[Priced]:
    """Every policy with every kind of rule, exact."""
    found = []
    for name, (policy, chances) in policies(world, problem).items():
        costs: dict[str, list[tuple[float, str]]] = {}
        for kind, label, rule in rules(world, problem):
            cost = expected_cost(problem, course(policy, rule, watch_of(problem)), chances)
            costs.setdefault(kind, []).append((cost.total, label))
        found += [Priced(name, kind, min(of)[1], min(of)[0], 0.0) for kind, of in costs.items()]
    return found


def drawn_prices(world: World, trials: int, policy: str) -> list[list[Priced]]:
    """One policy with every kind of rule at each cost of taps, on drawn trials, the same for all.

    Half of the trials choose the rule of a kind, the others price it.
    """
    problems = [problem_of(world, cost) for cost in TAP_COSTS]
    first = problems[0]
    plan = plan_trials(world.symbols.table.pool, trials, SEED)
    move, watch = policies(world, first)[policy][0], watch_of(first)
    record = play(world.symbols.table, plan, move, border="clamp", deadline=first.most_taps, seed=SEED, watch=watch)
    return [_prices(world, problem, record, policy) for problem in problems]


def _prices(world: World, problem: RiskProblem, record: Record, policy: str) -> list[Priced]:
    costs: dict[str, list[tuple[float, Priced]]] = {}
    for kind, label, rule in rules(world, problem):
        each = trial_costs(problem, record, rule)
        chosen_by, priced_by = np.array_split(each, 2)
        half = float(norm.ppf(0.975) * priced_by.std(ddof=1) / np.sqrt(len(priced_by)))
        price = Priced(policy, kind, label, float(priced_by.mean()), half)
        costs.setdefault(kind, []).append((float(chosen_by.mean()), price))
    return [min(of, key=lambda found: found[0])[1] for of in costs.values()]


def trial_costs(problem: RiskProblem, record: Record, rule: StopRule) -> NDArray[np.float64]:
    """What each recorded trial costs under a rule, shape (n,); one decides for the object of least expected loss.

    As beliefs are right here, the expected loss stands for the one that is met, and varies less.
    """
    found = stops(rule, record)
    last = np.arange(len(found.taps)), found.taps - 1
    loss = (record.what_marginal[last] @ problem.loss.T).min(axis=1)
    return loss + problem.tap_cost * found.taps + problem.class_cost * record.travelled[last]


def price_table(prices: Sequence[Priced], least: float) -> str:
    """Costs above the least one possible, policies by kinds of rule; the best of a table in bold."""
    names = list(dict.fromkeys(price.policy for price in prices))
    best = min(price.cost for price in prices)
    lines = []
    for name in names:
        cells = {price.kind: _cell(price, least, best) for price in prices if price.policy == name}
        lines.append([name, *(cells[kind] for kind in RULES)])
    return table(["policy", *RULES], lines)


def _cell(price: Priced, least: float, best: float) -> str:
    text = f"{price.cost - least:.3f}"
    if price.half:
        text += f" [{price.cost - price.half - least:.3f}, {price.cost + price.half - least:.3f}]"
    if price.cost == best:
        text = f"**{text}**"
    return f"{text} ({price.rule})" if price.rule else text


def described(world: World) -> str:
    """A case in a sentence."""
    case, grid = world.case, world.model.grid
    rods = ", ".join(f"{size:g}" for size in grid.what_value)
    return (
        f"{grid.L} places {np.diff(grid.where_value).mean():g} mm apart, rods of {rods} mm, {case.samples} "
        f"sample{'s' if case.samples > 1 else ''} per tap, {world.symbols.channel.shape[2]} symbols that keep "
        f"{world.symbols.kept:.0%} of what a tap tells, {case.taps} taps at most"
    )


def small_page(world: World, tap_cost: float) -> str:
    """The regrets of one small case at one cost of taps."""
    problem = problem_of(world, tap_cost)
    rule = exact_rule(problem)
    best: Cost = expected_cost(problem, rule)
    head = (
        f"*{described(world)}; a tap costs {tap_cost:g} mm.* The exact rule costs {rule.value:.4f} mm: errors of "
        f"{best.loss:.3f} mm, {best.taps:.2f} taps, {best.steps * problem.class_cost / WAY_COST:.2f} mm of way."
    )
    return f"{head} Cost above that in mm, exact:\n\n{price_table(exact_prices(world, problem), rule.value)}"


def large_page(world: World, tap_cost: float, prices: Sequence[Priced], trials: int) -> str:
    """The costs of the large case above its lower bound, at one cost of taps."""
    problem = problem_of(world, tap_cost)
    bounds = [known_place_bound(problem, depth, 60) for depth in (1, 2)]
    weak = alpha_cost_bound(problem, qmdp(problem), 2)
    best = min(prices, key=lambda price: price.cost)
    low, high = (best.cost + sign * best.half - bounds[1] for sign in (-1, 1))
    head = (
        f"*{described(world)}; a tap costs {tap_cost:g} mm.* No strategy costs less than {bounds[1]:.4f} mm (place "
        f"known after two taps; {bounds[0]:.4f} after one; QMDP after two, and the fast informed bound, {weak:.4f}). "
        f"The cheapest found, {best.policy} with {best.kind}, costs {best.cost:.4f} ± {best.half:.4f} mm: a gap of "
        f"{best.cost - bounds[1]:.4f} [{low:.4f}, {high:.4f}] mm or {best.cost / bounds[1] - 1:.0%}, which is the most "
        "that any strategy could save."
    )
    return f"{head} Cost above the bound in mm, {trials // 2:,} trials each:\n\n{price_table(prices, bounds[1])}"


def page(trials: int) -> str:
    """All tables; of what was finished if it is interrupted."""
    small, large = [world(case) for case in SMALL], world(LARGE)
    with one_blas_thread():
        parts = list(
            until_interrupted("small", [partial(small_page, one, cost) for one in small for cost in TAP_COSTS])
        )
        names = policies(large, problem_of(large, TAP_COSTS[0]))
        found = list(until_interrupted("large", [partial(drawn_prices, large, trials, name) for name in names]))
    for cost, prices in zip(TAP_COSTS, zip(*found, strict=True), strict=False):
        parts.append(large_page(large, cost, [price for of in prices for price in of], trials))
    return "\n\n".join([INTRODUCTION, *parts])


INTRODUCTION = f"""A millimetre of error costs 1, one of way {WAY_COST:g}, taps as said; the first tap is always made, \
and who stops decides for the rod of least expected error. "Best theta" and "best number" are the threshold and the \
number of taps, in brackets, that are cheapest for that policy (in the larger case in as many other trials); \
lookahead and MSPRT are as they come. Errors of drawn trials are those expected under the beliefs, which are right \
here. Intervals are 95 %, normal, over trials; the best of a table is bold."""


def main() -> None:
    """Prints the tables, or writes them into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--document", type=Path, help="page that gets the tables, such as docs/strategies.md")
    parser.add_argument("--trials", type=int, default=20000, help="trials of each policy in the large case")
    arguments = parser.parse_args()
    check_block(arguments.document, BLOCK)
    text = page(arguments.trials)
    write_json(BLOCK, text)
    if arguments.document is None:
        print(text)
    else:
        write_block(arguments.document, BLOCK, text)


if __name__ == "__main__":
    main()
