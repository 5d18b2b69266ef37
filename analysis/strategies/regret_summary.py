"""Summary of the regret of strategies, for page and document."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ...inference.bayes_risk.exact_cost import Cost
from ..page.numbers import interval, listed, percent
from ..page.page import Row
from ..stats.metrics import CONFIDENCE
from .regret import Priced, Regrets, RegretSettings
from .regret_cases import KINDS, THRESHOLD, WAY_COST

NEAR = 0.05
"""Of the least cost, within which a strategy is named as near it."""
RULES = (
    f"Costs: 1 per millimetre of error, {WAY_COST:g} per millimetre of travel, and the stated cost per tap. The first "
    "tap is always made, a stopped trial decides for the rod with the smallest expected error, and there are no null "
    "decisions. Taps are symbols drawn from a correct model; the border is clamp.",
    '"Best theta" and "best number" are the threshold and the number of taps (in brackets) with the lowest cost for '
    "that strategy; lookahead and MSPRT are not tuned. Where costs are sampled, half of the trials select thresholds, "
    "numbers and the strategy in bold, and the other half estimate their costs, with the same trials for all; errors "
    "are those expected under the beliefs, which are correct here. Intervals are 95% normal intervals over trials.",
    '"Risk" minimises the expected error of a decision after one more tap plus the cost of travel; fixation:0.8 moves '
    "to the middle, or the lower of two middle positions.",
)


def summarise_regret(found: Sequence[Regrets], settings: RegretSettings) -> Row:
    """Content of `strategies.json` about regret."""
    cases = [_case(one) for one in found]
    return {
        "trials": settings.trials,
        "seed": settings.seed,
        "way_cost": WAY_COST,
        "kinds": list(KINDS),
        "rules": list(RULES),
        "cases": cases,
        "findings": findings(cases),
    }


def _case(found: Regrets) -> Row:
    grid, case = found.world.model.grid, found.world.case
    rows = [_row(price, found) for price in found.prices]
    sizes = np.asarray(grid.what_value).tolist()
    return {
        "name": f"{grid.L} positions, rods {', '.join(f'{size:g}' for size in sizes)} mm",
        "exact": case.exact,
        "places": grid.where_value.tolist(),
        "rods": sizes,
        "tap_cost": found.problem.tap_cost,
        "bounds": dict(found.bounds),
        "described": described(found),
        "caption": _caption(found),
        "prices": rows,
        "strategies": list(dict.fromkeys(price.policy for price in found.prices)),
        "said": _bounded(found, rows) if found.best is None else _exactly(found, found.best, rows),
    }


def _caption(found: Regrets) -> str:
    """Of the table."""
    if found.world.case.exact:
        return "Cost above the exact rule (mm), exact"
    return f"Cost above the bound (mm), {len(found.prices[0].each):,} trials each"


def _row(price: Priced, found: Regrets) -> Row:
    """A price, its regret and by how much it is more than that of the cheapest, with 95% intervals."""
    regret = _mean(price.each - found.least, "regret")
    shown = f"{regret['regret']:.4f}" if found.world.case.exact else interval(regret, "regret")
    return {
        "strategy": price.policy,
        "kind": price.kind,
        "rule": price.rule,
        "cost": price.cost,
        "best": found.equals(price),
        "shown": f"{shown} ({price.rule})" if price.rule else shown,
        **regret,
        **_mean(price.each - found.cheapest.each, "more"),
    }


def _mean(each: NDArray[np.float64], name: str) -> dict[str, Any]:
    """A mean with its 95% interval under names that pages know; of a single number it has none."""
    mean = round(float(each.mean()), 9) + 0.0  # no rounding errors and no negative zero
    if len(each) < 2:
        return {name: mean, f"{name}_low": None, f"{name}_high": None}
    half = float(ndtri((1 + CONFIDENCE) / 2) * each.std(ddof=1) / np.sqrt(len(each)))
    return {name: mean, f"{name}_low": mean - half, f"{name}_high": mean + half}


def described(found: Regrets) -> str:
    """A case in a sentence without its end."""
    case, grid = found.world.case, found.world.model.grid
    rods = ", ".join(f"{size:g}" for size in np.asarray(grid.what_value))
    return (
        f"{grid.L} positions {np.diff(grid.where_value).mean():g} mm apart, rods of {rods} mm, {case.samples} "
        f"sample{'s' if case.samples > 1 else ''} per tap, {found.world.symbols.channel.shape[2]} symbols that keep "
        f"{percent(found.world.symbols.kept)} of the information of a tap, at most {case.taps} taps; a tap costs "
        f"{found.problem.tap_cost:g} mm"
    )


def _exactly(found: Regrets, best: Cost, rows: Sequence[Row]) -> str:
    """What the exact rule costs, and how near one comes to it."""
    alike = [row for row in rows if row["best"]]
    names = listed([row["strategy"] for row in alike if row["kind"] == alike[0]["kind"]])
    way = best.steps * found.problem.class_cost / WAY_COST
    return (
        f"The exact rule costs {found.least:.4f} mm: errors of {best.loss:.3f} mm, {best.taps:.2f} taps, {way:.2f} mm "
        f"of travel. The cheapest, {names} with {alike[0]['kind']}, cost{'' if len(alike) > 1 else 's'} "
        f"{alike[0]['regret']:.4f} mm or {percent(alike[0]['regret'] / found.least)} more."
    )


def _bounded(found: Regrets, rows: Sequence[Row]) -> str:
    """The bounds, the gap to the cheapest, and what may be as cheap."""
    best = next(row for row in rows if row["best"])
    (name, least), *weaker = found.bounds.items()
    also = ", ".join(f"{bound:.4f} with {words}" for words, bound in weaker)
    rivals = [row for row in rows if row["kind"] == best["kind"] and not row["best"]]
    alike = [row["strategy"] for row in rivals if (row["more_low"] or 0.0) <= 0]
    return (
        f"No strategy costs less than {least:.4f} mm, the bound with {name} ({also}). The cheapest, {_named(best)}, "
        f"costs {interval(best, 'regret')} mm or {percent(best['regret'] / least)} more, so no strategy can save more "
        f"than that. With {best['kind']}, the paired 95% intervals of all "
        f"others{' except ' + listed(alike) if alike else ''} show a higher cost."
    )


def findings(cases: Sequence[Row]) -> list[str]:
    """Findings over all cases, in sentences."""
    small = [case for case in cases if case["exact"]]
    said = []
    if small:
        near = [name for name in small[0]["strategies"] if all(_near(case, name) for case in small)]
        said.append(
            f"Regret relative to the exact rule: with the best threshold, {listed(near) or 'no strategy'} cost at "
            f"most {percent(NEAR)} more in every case."
        )
    gaps = [_gap(case) for case in cases if not case["exact"]]
    if gaps:
        said.append(f"Regret relative to a bound: {'; '.join(gaps)}. No strategy can save more than that.")
    return said


def _near(case: Row, strategy: str) -> bool:
    """Whether a strategy with the best threshold costs little more than the exact rule."""
    row = next(row for row in case["prices"] if (row["strategy"], row["kind"]) == (strategy, THRESHOLD))
    return row["regret"] <= NEAR * _least(case)


def _gap(case: Row) -> str:
    best = next(row for row in case["prices"] if row["best"])
    return (
        f"at {case['tap_cost']:g} mm per tap {_named(best)} costs {interval(best, 'regret')} mm "
        f"({percent(best['regret'] / _least(case))}) more"
    )


def _least(case: Row) -> float:
    return max(case["bounds"].values())


def _named(row: Row) -> str:
    return f"{row['strategy']} with {row['kind']}"
