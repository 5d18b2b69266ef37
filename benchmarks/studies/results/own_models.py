"""The models of docs/how-to/your-own-model.md from fit to audit, on simulated taps and on two recordings.

`--document docs/explanation/own-models.md --recorded FOLDER` updates the tables of that page.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
import xarray as xr
from solidtouch.analysis.page.labelled import rows
from solidtouch.analysis.page.numbers import bounded, interval, number
from solidtouch.inference.engines.shadow import ShadowEngine

import solidtouch as st
from benchmarks.own_stories import stories
from benchmarks.page import parsed, table, write_block
from benchmarks.study import thinned

SIMULATED, SKIN, BRAILLE = DATA = "simulated", "skin", "braille"
FITS, CROSSCHECK, EPISODES, AUDIT = "fits", "crosscheck", "episodes", "audit"
BLOCKS = (FITS, *DATA, CROSSCHECK, EPISODES, AUDIT)
SEED, TRIALS = 0, 1000
STEP = 5
"""Every fifth sample of a tap is used: fits take as long as there are samples."""
WHOLE_CELLS = 30
"""Positions and objects of the skin, 1 mm apart, that fill cells of 6 mm, so that all classes have as many taps."""
BUILT_IN = "histogram", "profile-mvn"
AUDITED = "laplace"
ROUTES = {
    "enumerated by NumPyro": ("numpy, numpyro", "numpy, numpyro sequence"),
    "function": ("compiled, numpyro story",),
    "compiled filter": ("numpy, filter",),
    "compiled trials": ("numpy, cpu trials", "numpy, xla-cpu trials"),
}
"""Columns of the cross-check, and the pairs of routes in each."""


def labels_ignored(where, what, taps=None, *, J, K):  # noqa: ARG001 - as the contract has it
    """Wrong on purpose: all classes are alike."""
    with numpyro.plate("K", K, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        scale = numpyro.sample("scale", dist.LogNormal(0.0, 1.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc, scale), obs=taps)


class DataSet(NamedTuple):
    """Taps on which models are compared.

    Attributes:
        taps: Training and test taps, or one set that is divided.
        division: How.
    """

    taps: Sequence[st.TapSet]
    division: st.Division = st.Division()


def sessions(number: int) -> list[st.TapSet]:
    """Simulated sessions."""
    return [thinned(taps, STEP) for taps in st.simulate("paper", number, SEED)]


def data_sets(recorded: Path | None) -> Iterator[tuple[str, DataSet]]:
    """Taps of each comparison."""
    yield SIMULATED, DataSet(sessions(2))
    if recorded is not None:
        skin, letters = (st.load_taps(recorded / name) for name in ("eflesh_grid.npz", "braille_icub.npz"))
        whole = np.maximum(*skin.indices(skin.grid())) < WHOLE_CELLS
        yield SKIN, DataSet([skin.select(whole)], st.Division(where_cell="6mm", what_cell="6mm"))
        yield BRAILLE, DataSet([thinned(letters, STEP)])


def small(taps: st.TapSet) -> st.TapSet:
    """Taps of three neighbouring positions, the first two objects and the first three taxels."""
    where, what = taps.indices(taps.grid())
    few = taps.select((abs(where - taps.grid().L // 2) <= 1) & (what < 2))
    return st.TapSet(few.dataset.isel(taxel=slice(3)))


# Fits --------------------------------------------------------------------------------------------------------------


def fit_row(taps: st.TapSet, name: str, story: Callable[..., Any], method: str) -> list[str]:
    """How a fit went."""
    begun = perf_counter()
    model = st.fit(taps, story, method=method, unconverged=True, seed=SEED)
    seconds = perf_counter() - begun
    told = model.posterior.convergence()
    found = {key: number(float(value)) for key, value in told.stats.items() if np.ndim(value) == 0}
    cells = [found.get(key, "–") for key in ("change", "r_hat", "ess", "divergences")]
    return [name, method, f"{seconds:.0f}", "yes" if told.converged else "no", *cells]


def fits(taps: st.TapSet, models: dict[str, Callable[..., Any]], methods: Sequence[str]) -> str:
    """Fits of all stories by several methods."""
    head = "model", "fit", "s", "converged", "change of loss (nat per tap)", "R-hat", "ESS", "divergences"
    return table(head, [fit_row(taps, name, story, how) for name, story in models.items() for how in methods])


# Comparison --------------------------------------------------------------------------------------------------------


def comparison(data: DataSet, models: Sequence[Any]) -> st.ComparisonReport:
    """All models on one data set; fits that have not converged are kept and marked."""
    return st.compare(
        *data.taps,
        models=models,
        division=data.division,
        fit=st.FitSettings(unconverged=True),
        draws=0,
        trials=TRIALS,
        seed=SEED,
    )


def compared(report: st.ComparisonReport, wrong: str) -> str:
    """A table of models, how the wrong one does, and which are best."""
    summary, classes, taps = report.summary, report.classes, report.taps
    contacts = [int(classes["contacts"].values[end]) for end in (0, -1)]
    after = [f"after {n} tap{'s' * (n > 1)}" for n in contacts]
    title, errors = _object_errors(report)
    head = ["model", "s", "converged", "taps left out (nat per tap)", *(f"right class {at}" for at in after)]
    head += [*(f"log score {at} (nat)" for at in after), title]
    lines = []
    for model in summary["models"]:
        name = model["name"]
        scores = classes.sel(model=name)
        lines.append(
            [
                name,
                f"{model['seconds']:.0f}",
                "yes" if model["converged"] else "no",
                "–" if taps is None else _cell(taps.sel(model=name), "integrated"),
                *(_cell(scores.sel(contacts=n), "accuracy_joint") for n in contacts),
                *(_cell(scores.sel(contacts=n), "log_score_joint") for n in contacts),
                errors[name],
            ]
        )
    trained = int(next(iter(report.models.values())).trained.sum())
    places = [place(classes.sel(contacts=n), wrong) for n in contacts]
    told = ", ".join(f"{one} of {len(lines)} {at}" for one, at in zip(places, after, strict=True))
    chance = f"By the fraction of right classes `{wrong}` is {told}; chance is {number(1 / trained)}."
    refused = [f"{one['name']} was refused: {one['reason']}" for one in summary["refused"]]
    return f"{table(head, lines)}\n\n{chance}\n\n" + "\n".join(f"- {one}" for one in [summary["headline"], *refused])


def place(scores: xr.Dataset, name: str) -> int:
    """Place of a model by the fraction of right classes, the worse one of ties."""
    accuracy = scores["accuracy_joint"]
    return int((accuracy >= accuracy.sel(model=name)).sum())


def _object_errors(report: st.ComparisonReport) -> tuple[str, dict[str, str]]:
    """Errors of decisions at the threshold that the page of `compare` shows, passive where it is never active."""
    theta, decisions = report.summary["shown_theta"], report.decisions
    policy = "active" if "active" in decisions["policy"].values else "passive"
    at = decisions.sel(theta=theta, policy=policy)
    unit = report.found.grid.what_error_unit
    cells = {str(name): _cell(at.sel(model=name), "what_error") for name in at["model"].values}
    return f"{policy} object error at threshold {theta:g} ({unit})", cells


def _row(data: xr.Dataset, name: str) -> dict[str, float]:
    return {name + end: float(data[name + end]) for end in ("", "_low", "_high") if name + end in data}


def _cell(data: xr.Dataset, name: str) -> str:
    return interval(_row(data, name), name)


# Checks, episodes, audit -------------------------------------------------------------------------------------------


def crosschecked(train: st.TapSet, test: st.TapSet, models: Sequence[Any]) -> str:
    """Largest differences between routes, by model."""
    report = st.crosscheck(
        train,
        test,
        models=models,
        fit=st.FitSettings(unconverged=True),
        episodes=3,
        length=10,
        sequence_taps=5,
        seed=SEED,
    )
    lines = []
    for name, check in report.found.items():
        lines.append([name, *(largest(check, routes) for routes in ROUTES.values()), "yes" if check.passed else "no"])
    refused = [f"{name} was refused: {reason}" for name, reason in report.refused.items()]
    return "\n\n".join([table(["model", *ROUTES, "all agree"], lines), *refused])


def largest(check: Any, routes: Sequence[str]) -> str:
    """The largest difference of some routes, a dash where they were not compared."""
    found = [row.largest for row in check.rows if row.routes in routes]
    return f"{max(found):.0e}" if found else "–"


def episode_row(name: str, model: st.TapModel, test: st.TapSet) -> list[str]:
    """An episode on recorded taps whose beliefs a second engine follows."""
    grid = model.grid
    what, start = grid.M // 2, 0
    rig = st.ReplayRig(test, grid, start=start, what=what)
    both: Any = ShadowEngine(st.make_engine("filter", model), st.make_engine("numpyro", model))
    episode = st.perceive(rig, both, stop=0.95, move=st.fixation(grid.L // 2))
    right = "right" if episode.what == what else "wrong"
    answer = f"{grid.what_name[episode.what]}, {right}" if episode.stopped else f"undecided, {right}"
    belief = float(np.exp(episode.log_beliefs[-1]).sum(axis=0).max())
    moves = " ".join(map(str, episode.moves[:5])) or "–"
    return [name, answer, str(episode.taps), moves, number(belief)]


def audited(taps: Sequence[st.TapSet], model: Callable[..., Any]) -> str:
    """Remedies of an audit, one of which is an own model."""
    report = st.audit(*taps, models=[model], permutations=99, trials=TRIALS, seed=SEED)
    head = ["remedy", "what it does", "gain (nat)", "miscalibration factor", "worthwhile"]
    lines = [
        [
            row["remedy"],
            row["title"],
            interval(row, "gain"),
            bounded(*(row.get(f"factor{end}") for end in ("", "_low", "_high"))),
            "yes" if row["worthwhile"] else "no",
        ]
        for row in rows(report.remedies, "remedy")
    ]
    said = "\n".join(f"- {sentence}" for sentence in report.verdict)
    return f"{table(head, lines)}\n\n{said}"


def main() -> None:
    """Runs and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    parser.add_argument("--only", choices=BLOCKS, help="update one block only")
    options = parsed(parser, *BLOCKS)
    for block, text in blocks(options.recorded, options.only):
        print(block, text, sep="\n\n", flush=True)
        write_block(options.document, block, text)


def blocks(recorded: Path | None, only: str | None) -> Iterator[tuple[str, str]]:
    """Name and text of each block."""
    own = stories()
    train, test, last = sessions(3)
    few = [small(taps) for taps in (train, test)]
    if only in (None, FITS):
        yield FITS, fits(few[0], own, ("svi", "nuts"))
    if only in (None, CROSSCHECK):
        yield CROSSCHECK, crosschecked(*few, list(own.values()))
    if only in (None, EPISODES):
        lines = []
        for name, story in own.items():
            model = st.fit(few[0], story, unconverged=True, seed=SEED)
            lines.append(episode_row(name, model, few[1]))
        head = ["model", "answer", "taps", "first moves", "belief in the object"]
        yield EPISODES, table(head, lines)
    if only in (None, AUDIT):
        yield AUDIT, audited([train, test, last], own[AUDITED])
    for name, data in data_sets(recorded):
        if only in (None, name):
            yield name, compared(comparison(data, [*BUILT_IN, *own.values(), labels_ignored]), labels_ignored.__name__)


if __name__ == "__main__":
    main()
