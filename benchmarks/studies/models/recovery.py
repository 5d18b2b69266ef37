"""Model recovery: every model is fitted to taps simulated from every model.

Each model is fitted once to simulated sessions of preset `paper`. Parameters are drawn from its posterior and sessions
of taps from these parameters; all models are fitted to the training sessions and predict the session left out. A
session is predicted as a whole, since its taps share a state under `session:profile`. With `--own` taps come from the
models of docs/how-to/your-own-model.md.

`--document docs/explanation/model-studies.md` updates its tables and figure; with `--redraw` only the figure, from the
table that the page has.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import ICUB_FINGERTIP, PAPER_RODS, RigSettings, preset
from solidtouch.models import seeds
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.draws import integrated
from solidtouch.models.measurement.generic.story import GenericModel
from solidtouch.models.measurement.likelihood.bins import TableForm
from solidtouch.models.measurement.likelihood.forms import GaussianForm
from solidtouch.models.measurement.likelihood.shapes import Parameters
from solidtouch.models.measurement.model import Fitted
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.measurement.smooth import CurvePosterior
from solidtouch.models.measurement.states import States
from solidtouch.models.measurement.story import ParametricModel
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import block_of, parsed, publish, share_interval, table, table_rows, write_block
from benchmarks.studies.models import user_stories
from benchmarks.studies.models.figures import recovery_figure
from benchmarks.study import thinned, until_interrupted, write_json

MODELS = (
    "histogram",
    "gaussian",
    "student",
    "profile",
    "profile-ar",
    "profile-mvn",
    "matrix-normal",
    "smooth",
    "session:profile",
)
DRAWS, COVERED = 99, (5, 95)
"""Draws of a posterior, and the ranks among them that a true value has in the central 90%."""

BESIDE = ("histogram", "gaussian", "profile-mvn")
"""Built-in models beside which models of users are compared."""

OFFSET_SD = 0.5
"""Of the sessions of `session:profile`, in counts."""


class Sizes(NamedTuple):
    """How much is simulated.

    Attributes:
        positions: `L`, 1 mm each, in the middle of the range.
        rods: `M`, at most 3: 4, 8 and 12 mm.
        step: Every how manyth of 50 samples is kept.
        every: Every how manyth of 12 taxels is there.
        sessions: That train; one more is left out.
        repeats: Taps of each class in a session.
    """

    positions: int = 6
    rods: int = 3
    step: int = 3
    every: int = 2
    sessions: int = 3
    repeats: int = 7


OWN_SIZES = Sizes(positions=4, step=4, every=4, repeats=6)


class Source(NamedTuple):
    """A model that taps come from.

    Attributes:
        name: Its name.
        fitted: To taps of the simulated rig.
        template: Those taps.
        grid: The classes.
    """

    name: str
    fitted: Fitted
    template: TapSet
    grid: ClassGrid


class Replicate(NamedTuple):
    """What one data set said.

    Attributes:
        source: Model that it came from.
        scores: Log probability of the session left out under every model, in nats.
        taps: Of that session.
        covered: Of each kind of parameter, how many are in the central 90% of the posterior, and of how many.
        unfinished: Models whose fit had not converged when it ended.
    """

    source: str
    scores: dict[str, float]
    taps: int
    covered: dict[str, tuple[int, int]]
    unfinished: list[str]


def reduced_rig(sizes: Sizes) -> RigSettings:
    """The rig of preset `paper` with fewer positions, rods and taxels."""
    first = 8 - sizes.positions // 2
    return replace(
        preset("paper"),
        rods=PAPER_RODS[::2][: sizes.rods],
        taxels=ICUB_FINGERTIP[:: sizes.every],
        start_mm=float(first),
        end_mm=float(first + sizes.positions),
    )


def sources(models: Sequence[str], sizes: Sizes, seed: int) -> list[Source]:
    """Every model, fitted to the same taps."""
    rig = reduced_rig(sizes)
    sessions = [thinned(simulate_session(rig, seed, session), sizes.step) for session in range(sizes.sessions)]
    template = concatenate(sessions)
    grid = template.grid()
    # The sessions of one data set say little of how much sessions differ, so what they come from is given.
    settings = FitSettings(gain_sd=rig.session_gain_log_sd, offset_sd=OFFSET_SD)
    return [Source(name, fit_model(name, template, grid, settings), template, grid) for name in models]


def replicate(source: Source, models: Sequence[str], sizes: Sizes, seed: int, number: int) -> Replicate:
    """One data set from a model, and what all models make of it."""
    generator = seeds.generator(seed, seeds.Purpose.STUDY, (*MODELS, *user_stories.NAMES).index(source.name), number)
    posterior: Any = source.fitted.posterior
    if posterior is None:
        raise ValueError(f"{source.name} has no posterior to draw parameters from.")
    truth = getattr(posterior, "inner", posterior).draw(generator)  # without a new session, which each draws for itself
    sessions = [simulated(source, truth, sizes.repeats, session, generator) for session in range(sizes.sessions + 1)]
    train, left_out = concatenate(sessions[:-1]), sessions[-1]
    # The bins are those of the source, which for a histogram are part of what it says.
    settings = FitSettings(edges=source.fitted.model.edges, unconverged=True)
    scores, covered, unfinished = {}, {}, []
    for name in models:
        fitted = fit_model(name, train, source.grid, settings)
        if not fitted.convergence.converged:
            unfinished.append(name)
        scores[name] = session_score(fitted, left_out, seeds.generator(seed, seeds.Purpose.SCORES, number))
        if name == source.name:
            covered = coverage(source, truth, fitted, generator)
    return Replicate(source.name, scores, len(left_out), covered, unfinished)


def simulated(
    source: Source, parameters: Parameters, repeats: int, session: int, generator: np.random.Generator
) -> TapSet:
    """A session of `repeats` taps of every class, all in one state."""
    L, M = source.grid.shape
    where, what = (np.repeat(index.ravel(), repeats) for index in np.indices((L, M)))
    model = source.fitted.model
    states = model.states
    state = generator.choice(len(states.gain), p=np.exp(states.log_prior))
    place = _places(source.grid, where, repeats)
    samples = _draw(source, parameters, where, what, place, generator)
    samples = states.gain[state] * samples + states.offset[state]
    edges = source.grid.where_edges
    return TapSet.from_arrays(
        samples,
        what,
        source.template.what_name,
        preprocessing=source.template.preprocessing,
        where=place,
        where_value=source.grid.where_value,
        where_edges=edges,
        where_unit=source.grid.where_unit,
        session=np.full(len(where), session),
    )


def _places(grid: ClassGrid, where: NDArray[np.intp], repeats: int) -> NDArray[np.float64]:
    """Positions spread evenly over each where class."""
    if grid.where_edges is None:
        return grid.where_value[where]
    share = np.tile((np.arange(repeats) + 0.5) / repeats, len(where) // repeats)
    return grid.where_edges[where] + share * np.diff(grid.where_edges)[where]


def _draw(
    source: Source,
    parameters: Parameters,
    where: NDArray[np.intp],
    what: NDArray[np.intp],
    place: NDArray[np.float64],
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Taps of one class each in the state of gain 1 and offset 0, with values between those of the bins too."""
    model, J = source.fitted.model, source.template.preprocessing.samples
    if isinstance(model, GenericModel):
        return user_stories.drawn_session(model, parameters, where, what, generator)
    shape = len(where), J, model.K
    if isinstance(model, ParametricModel) and model.kind in ("gaussian", "student"):
        if model.kind == "gaussian":
            scale, noise = np.sqrt(parameters["variance"]), generator.standard_normal(shape)
        else:
            scale = parameters["scale"]
            noise = generator.standard_t(np.broadcast_to(parameters["freedom"], shape))
        scaled = parameters["level"][where, what] + scale[where, what] * noise
        return scaled * model.scaling.unit + model.scaling.centre
    form = model.form_of(parameters)
    if isinstance(source.fitted.posterior, CurvePosterior) and isinstance(form, GaussianForm):
        basis = source.fitted.posterior.basis.at(place)
        mean = np.einsum("nd,njkd->njk", basis, parameters["weight"][what])
        noise = form.scale[0][where, what] * generator.standard_normal(shape)
        return mean * model.scaling.unit + model.scaling.centre + noise
    samples = form.sample(where, what, model.edges, J, generator)
    if isinstance(form, TableForm):
        width = np.broadcast_to(np.diff(model.edges), (model.K, model.edges.shape[-1] - 1)).mean(axis=1)
        samples = samples + width * (generator.random(shape) - 0.5)
    return samples


def session_score(fitted: Fitted, taps: TapSet, generator: np.random.Generator) -> float:
    """Log probability of the bins of all taps of one session, which share their state, integrated over parameters."""
    own, model = taps.indices(fitted.model.grid), fitted.model
    if isinstance(model, GenericModel) and model.program.structure.by_session:
        return user_stories.session_log_probability(fitted, taps, generator)
    streams = generator.spawn(len(model.states.gain))
    parts = []
    for gain, offset, log_prior, stream in zip(*model.states, streams, strict=True):
        state = States(np.array([gain]), np.array([offset]), np.zeros(1))
        one = fitted._replace(model=replace(model, states=state))  # pyright: ignore[reportArgumentType]
        parts.append(log_prior + integrated(one, taps.taps, own, stream).sum())
    return float(np.logaddexp.reduce(parts))


def coverage(
    source: Source, truth: Parameters, fitted: Fitted, generator: np.random.Generator
) -> dict[str, tuple[int, int]]:
    """Of each kind of parameter, how many lie in the central 90% of the posterior, and how many there are."""
    if fitted.posterior is None:
        return {}
    true = quantities(source.fitted, truth)
    rank = {kind: np.zeros(values.shape, dtype=int) for kind, values in true.items()}
    for _ in range(DRAWS):
        drawn = quantities(fitted, fitted.posterior.draw(generator))
        for kind, values in drawn.items():
            rank[kind] += values < true[kind]
    low, high = COVERED
    return {kind: (int(((low <= r) & (r < high)).sum()), r.size) for kind, r in rank.items()}


def quantities(fitted: Fitted, parameters: Parameters) -> dict[str, NDArray[np.float64]]:
    """Parameters in units of the samples, by kind, so that fits in different units compare."""
    model = fitted.model
    if isinstance(model, GenericModel):
        return user_stories.own_quantities(model, parameters)
    form = model.form_of(parameters)
    if isinstance(form, GaussianForm):
        return _gaussian_quantities(form)
    if isinstance(model, ParametricModel):
        centre, unit = model.scaling
        scale = parameters["scale"] if "scale" in parameters else np.sqrt(parameters["variance"])
        found = {"mean": parameters["level"] * unit + centre, "deviation": scale * unit}
        return found | ({"degrees of freedom": parameters["freedom"]} if "freedom" in parameters else {})
    B = form.log_prob.shape[-1]
    probability = np.exp(form.log_prob)
    mean = probability @ np.arange(B)
    deviation = np.sqrt(probability @ np.arange(B) ** 2 - mean**2)
    return {"mean": mean, "deviation": deviation}


def _gaussian_quantities(form: GaussianForm) -> dict[str, NDArray[np.float64]]:
    found = {"mean": form.mean, "deviation": form.scale[0]}
    J, K = form.mean.shape[3:]
    if len(form.time) > 1:
        found["slope in time"] = -form.time[:, 1, 0]
    elif np.any(form.time[0] != np.eye(J)):
        found["slope in time"] = -form.time[0][np.tril_indices(J, -1)]
    if form.taxel.shape[-1]:
        rows, columns = np.tril_indices(K, -1)
        found["slope across taxels"] = -form.taxel[..., rows, columns]
    return found


def winners_table(replicates: Sequence[Replicate], models: Sequence[str]) -> str:
    """How often each model won for taps of each model."""
    count = wins(replicates, models)
    lines = [[name, *(str(n) if n else "." for n in row)] for name, row in zip(models, count, strict=True)]
    return table(["taps from", *models], [line for line, row in zip(lines, count, strict=True) if row.sum()])


def wins_in(text: str) -> tuple[NDArray[np.intp], list[str]]:
    """Numbers of data sets as in `wins` and the models, from a block of the page."""
    drawn = text.split("\n\n")[1]
    models = [cell.strip() for cell in drawn.partition("\n")[0].strip("|").split("|")[1:]]
    rows, none = table_rows(drawn), ["."] * (1 + len(models))
    return np.array([[int(cell.replace(".", "0")) for cell in rows.get(name, none)[1:]] for name in models]), models


def wins(replicates: Sequence[Replicate], models: Sequence[str]) -> NDArray[np.intp]:
    """Numbers of data sets, shape (source, winner)."""
    count = np.zeros((len(models), len(models)), dtype=np.intp)
    for one in replicates:
        count[models.index(one.source), models.index(max(one.scores, key=one.scores.__getitem__))] += 1
    return count


def margins_table(replicates: Sequence[Replicate], models: Sequence[str]) -> str:
    """By how much the true model was ahead of the best other one."""
    lines = []
    for name in models:
        own = [one for one in replicates if one.source == name]
        if not own:
            continue
        mean = {other: np.mean([one.scores[other] for one in own]) for other in models if other != name}
        ahead = {
            other: np.array([one.scores[name] - one.scores[other] for one in own])
            for other in sorted(mean, key=mean.__getitem__, reverse=True)[:2]
        }
        cells = [f"{other}: {_with_error(gap)}" for other, gap in ahead.items()]
        lines.append([name, str(own[0].taps), *cells, *[""] * (2 - len(cells))])
    head = ["taps from", "taps left out", "lead over second (nats)", "lead over third (nats)"]
    return table(head, lines)


def _with_error(gap: NDArray[np.float64]) -> str:
    error = f" ± {gap.std(ddof=1) / np.sqrt(len(gap)):.1f}" if len(gap) > 1 else ""
    return f"{gap.mean():.1f}{error}"


def coverage_table(replicates: Sequence[Replicate], models: Sequence[str]) -> str:
    """The share of true parameters in central 90% intervals, by model and kind."""
    kinds = list(dict.fromkeys(kind for one in replicates for kind in one.covered))
    lines = []
    for name in models:
        own = [one.covered for one in replicates if one.source == name]
        if own:
            cells = []
            for kind in kinds:
                pairs = [covered[kind] for covered in own if kind in covered]
                hits, n = (sum(pair[i] for pair in pairs) for i in (0, 1))
                cells.append(f"{share_interval(hits, n)} of {n}" if n else "")
            lines.append([name, *cells])
    return table(["model", *kinds], lines)


def tables(replicates: Sequence[Replicate], models: Sequence[str]) -> str:
    """All tables."""
    count = Counter(name for one in replicates for name in one.unfinished)
    listed = ", ".join(f"{number} of {len(replicates)} of {name}" for name, number in count.items())
    sentence = f"Fits that stopped before convergence and are included: {listed or 'none'}."
    parts = [part(replicates, models) for part in (winners_table, margins_table, coverage_table)]
    return "\n\n".join([*parts, sentence])


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicates", type=int, default=6, help="data sets per model")
    parser.add_argument("--models", nargs="*", default=MODELS, choices=MODELS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--own", action="store_true", help="models of users as sources, beside some built-in ones")
    parser.add_argument("--redraw", action="store_true", help="only draw the figure of the page from its table")
    options = parsed(parser, "recovery", "own-recovery")
    sizes, models, block = Sizes(), list(options.models), "recovery"
    if options.own:
        sizes, models, block = OWN_SIZES, [*user_stories.registered(), *BESIDE], "own-recovery"
    if options.redraw and options.document is not None:
        publish(recovery_figure(*wins_in(block_of(options.document, block))), options.document, block)
        return
    fitted = sources([name for name in models if not options.own or name not in BESIDE], sizes, options.seed)
    tasks: list[Callable[[], Replicate]] = [
        partial(replicate, source, models, sizes, options.seed, number)
        for number in range(options.replicates)
        for source in fitted
    ]
    found = list(until_interrupted("Recovering models", tasks))
    if not found:
        return
    write_json(block, [one._asdict() for one in found])
    L, M, J = sizes.positions, sizes.rods, fitted[0].template.preprocessing.samples
    text = (
        f"{L} positions x {M} objects, {J} samples, {fitted[0].fitted.model.K} taxels; {sizes.sessions} training "
        f"sessions of {sizes.repeats} taps per class and one left out; {len(found) // len(fitted)} data sets from each "
        f"model, seed {options.seed}.\n\n{tables(found, models)}"
    )
    print(text)
    if options.document is not None and len(found) == len(tasks):
        publish(recovery_figure(wins(found, models), models), options.document, block)
        write_block(options.document, block, text)


if __name__ == "__main__":
    main()
