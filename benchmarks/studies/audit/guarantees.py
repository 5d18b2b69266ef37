"""Whether the guarantees of the stopping rule hold for a correct model, and by what factor they fail for a wrong one.

Correct model: taps are drawn from the fitted histogram, each sample independently, and the filter multiplies their
likelihoods without an exponent. The proofs assume fresh taps, but trials draw with replacement from a stored pool.
Therefore a pool has a thousand taps per class, and every number comes from several pools; `repeats` is the fraction of
taps seen before in a trial if all of them came from one class. t-intervals over pools cover the drawing of both taps
and trials.

`--document docs/explanation/audit-studies.md` updates the tables of that page.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import t
from solidtouch.analysis.audit.guarantees import PROMISED, USED, guarantees
from solidtouch.analysis.experiment.sources import right_model
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.trials.records import tap_table
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.seeds import Purpose, data_set_seed, derived_seed
from solidtouch.models.settings import PlaySettings

from benchmarks.page import check_block, table, write_block
from benchmarks.study import until_interrupted, write_json

SAMPLES = (1, 2, 3, 4, 5)
THETAS = (0.8, 0.95, 0.99)
BORDERS = {PROMISED: "clamp", USED: "uniform"}
DEADLINE = 200
"""Taps that hardly any trial reaches."""


class Sizes(NamedTuple):
    """Of the study: pools, taps of each class in one, trials on each; simulated data sets of a rig, trials on each."""

    pools: int = 6
    taps_per_class: int = 1000
    trials: int = 6000
    data_sets: int = 6
    rig_trials: int = 4000


class Drawn(NamedTuple):
    """Taps from the model itself.

    Attributes:
        samples: J, of a tap.
        repeats: Share of repeated taps by (policy, theta), see the head of this file.
        pools: From `guarantees`, with the dim `pool`; setups differ in the border alone.
    """

    samples: int
    repeats: NDArray[np.float64]
    pools: xr.Dataset


def of_samples(model: HistogramModel, samples: int) -> HistogramModel:
    """The same model for taps of fewer samples."""
    return replace(model, preprocessing=model.preprocessing.of_length(samples))


def drawn(model: HistogramModel, samples: int, sizes: Sizes, seed: int) -> Drawn:
    """Guarantees on several pools of taps that the model is right about."""
    own, parts = of_samples(model, samples), []
    for pool in range(sizes.pools):
        taps = draw_session(own, sizes.taps_per_class, seed, 100 * samples + pool)
        trial_seed = derived_seed(seed, Purpose.REPEAT, pool)
        seen = tap_table(own, taps)
        parts.append(
            guarantees(
                seen,
                seen,
                own.grid,
                THETAS,
                trial_seed,
                trials=sizes.trials,
                play=PlaySettings(deadline=DEADLINE),
                resamples=1,
            )
        )
    pools = over("pool", parts)
    taps = pools["taps"].sel(setup=PROMISED, what="all").mean("pool").values
    return Drawn(samples, (taps - 1) / 2 / sizes.taps_per_class, pools)


def on_rig(name: str, sizes: Sizes, seed: int) -> xr.Dataset:
    """Guarantees on simulated data sets of a rig, with the dim `pool` for the data sets."""
    parts = []
    for number in range(sizes.data_sets):
        own = data_set_seed(seed, number)
        train, test = (simulate_session(preset(name), own, session) for session in (0, 1))
        model = fit(train, train.grid())
        test = model.usable(test)
        tables = tap_table(replace(model, power="none"), test), tap_table(model, test)
        parts.append(guarantees(*tables, model.grid, THETAS, own, trials=sizes.rig_trials, resamples=1))
    return over("pool", parts)


def over(dim: str, parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Guarantees along a dim; the limits are the same for all."""
    return xr.concat([part.drop_vars("limit") for part in parts], dim=dim).assign(limit=parts[0]["limit"])


def over_pools(values: NDArray[np.float64]) -> tuple[float, float, float]:
    """Mean of values over pools and the ends of its 95% t-interval."""
    n = len(values)
    half = t.ppf(0.975, n - 1) * values.std(ddof=1) / np.sqrt(n) if n > 1 else np.inf
    return float(values.mean()), float(values.mean() - half), float(values.mean() + half)


def holds(part: xr.Dataset) -> bool:
    """Whether all bounds of one setup, policy and threshold hold within Monte Carlo error.

    The error is a one-sided t-test of each object and of all, at 5% divided by their number.
    """
    wrong, limit = part["wrong"].transpose("pool", "what").values, part["limit"].values
    n, tests = wrong.shape
    error = wrong.std(axis=0, ddof=1) / np.sqrt(n)
    return bool((wrong.mean(axis=0) <= limit + t.isf(0.05 / tests, n - 1) * error).all())


def calibration(part: xr.Dataset) -> tuple[float, float, float]:
    """Wrong decisions over 1 - belief, all objects together, with an interval over the pools.

    Pools are resampled in pairs of both numbers by the delta method, as a pool without an error has a ratio of 0.
    """
    wrong, doubt = (part[name].sel(what="all").values for name in ("wrong", "doubt"))
    ratio = wrong.mean() / doubt.mean()
    _, low, high = over_pools((wrong - ratio * doubt) / doubt.mean())
    return float(ratio), float(ratio + low), float(ratio + high)


def drawn_table(results: Sequence[Drawn]) -> str:
    """A line for each number of samples, border, policy and threshold."""
    lines = []
    for result in results:
        for setup, border in BORDERS.items():
            for i, policy in enumerate(result.pools["policy"].values):
                if border == "uniform" and policy == "passive":
                    continue  # without moves there is no border
                for j, theta in enumerate(THETAS):
                    part = result.pools.sel(setup=setup, policy=policy, theta=theta)
                    everything = part.sel(what="all")
                    each = (part["wrong"].mean("pool") / part["limit"]).isel(what=slice(1, None))
                    worst = part.sel(what=each["what"].values[each.values.argmax()])
                    ratio, low, high = calibration(part)
                    lines.append(
                        [
                            str(result.samples),
                            border,
                            str(policy),
                            f"{theta:g}",
                            f"{float(everything['taps'].mean()):.1f} ({result.repeats[i, j]:.1%})",
                            _share(float(everything["wrong"].mean()), 1 - theta),
                            f"{ratio:.2f} [{low:.2f}, {high:.2f}]",
                            _share(float(worst["wrong"].mean()), float(worst["limit"])),
                            "yes" if holds(part) else "no",
                        ]
                    )
    head = ["J", "border", "policy", "theta", "taps (repeats)", "wrong / limit", "wrong over 1 - belief"]
    return table([*head, "worst object / limit", "holds"], lines)


def rig_table(results: dict[str, xr.Dataset]) -> str:
    """Ratio of wrong decisions to the bounds on simulated rigs."""
    lines = []
    for name, data in results.items():
        for setup in data["setup"].values:
            for policy in data["policy"].values:
                for theta in THETAS:
                    part = data.sel(setup=setup, policy=policy, theta=theta)
                    overall = over_pools(part["factor"].sel(what="all").values)
                    worst = over_pools(part["factor"].isel(what=slice(1, None)).max("what").values)
                    power = "power none, clamp" if setup == PROMISED else "power J, uniform"
                    cells = [f"{m:.2g} [{max(low, 0.0):.2g}, {high:.2g}]" for m, low, high in (overall, worst)]
                    wrong = float(part["wrong"].sel(what="all").mean())
                    lines.append([name, power, str(policy), f"{theta:g}", f"{wrong:.3f}", *cells])
    return table(["data", "filter", "policy", "theta", "wrong", "factor, all", "factor, worst object"], lines)


def page(results: Sequence[Drawn], rigs: dict[str, xr.Dataset], sizes: Sizes, seed: int) -> str:
    """What the page says of the results."""
    kept = [
        holds(one.pools.sel(setup=PROMISED, policy=policy, theta=theta))
        for one in results
        for policy in one.pools["policy"].values
        for theta in THETAS
    ]
    gaps = [
        calibration(one.pools.sel(setup=USED, policy="active", theta=theta))[0] for one in results for theta in THETAS
    ]
    return (
        f"Taps of J samples drawn from a fitted histogram, power none: {sizes.pools} pools of {sizes.taps_per_class} "
        f"taps per class, {sizes.trials} trials on each, seed {seed}. *Repeats* is the fraction of taps seen before in "
        f"a trial. With border clamp, the bounds hold in {sum(kept)} of {len(kept)} rows. With border uniform, "
        f"active decisions are wrong {min(gaps):.2f} to {max(gaps):.2f} times as often as the belief says.\n\n"
        f"{drawn_table(results)}\n\nSimulated rigs, {sizes.data_sets} data sets each with {sizes.rig_trials} trials: "
        f"wrong decisions divided by the bound, which holds up to 1.\n\n{rig_table(rigs)}"
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pools", type=int, default=Sizes().pools, help="number of pools")
    parser.add_argument("--trials", type=int, default=Sizes().trials, help="trials per pool")
    parser.add_argument("--taps-per-class", type=int, default=Sizes().taps_per_class, help="taps per class in a pool")
    parser.add_argument("--data-sets", type=int, default=Sizes().data_sets, help="data sets per simulated rig")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    if min(options.pools, options.data_sets) < 2:
        parser.error("intervals need two pools and two data sets")
    check_block(options.document, "guarantees")
    sizes = Sizes(options.pools, options.taps_per_class, options.trials, options.data_sets)
    model = right_model(options.seed)
    tasks = [partial(drawn, model, samples, sizes, options.seed) for samples in SAMPLES]
    results = list(until_interrupted("Drawn from the model", tasks))
    names: tuple[str, ...] = ("ideal", "paper") if len(results) == len(SAMPLES) else ()
    rig_tasks: list[Callable[[], xr.Dataset]] = [partial(on_rig, name, sizes, options.seed) for name in names]
    rigs: dict[str, xr.Dataset] = dict(zip(names, until_interrupted("Simulated rigs", rig_tasks), strict=False))
    if not results:
        return
    measured = {f"J={one.samples}": one.pools.to_dict() for one in results}
    write_json("guarantees", measured | {name: data.to_dict() for name, data in rigs.items()})
    text = page(results, rigs, sizes, options.seed)
    print(text)
    if options.document is not None and len(rigs) == 2:
        write_block(options.document, "guarantees", text)


def _share(wrong: float, limit: float) -> str:
    return f"{wrong:.4f} / {limit:.4f}"


if __name__ == "__main__":
    main()
