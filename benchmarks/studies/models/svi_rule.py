"""The rule that ends variational fits of users' models, against the optimum that many more steps reach.

Models are those of docs/how-to/your-own-model.md, taps come from their priors and from the simulated rig. A fit goes on
after the rule has ended it. Its losses there and much later are compared by the same draws from its guide.

`--document docs/explanation/model-studies.md` updates the table and the figure of that page.
"""

from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import numpy as np
import numpyro
from numpy.typing import NDArray
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic.contract import StoryFunction
from solidtouch.models.measurement.generic.story import batch_of
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.bins import bin_edges
from solidtouch.models.measurement.scaling import Scaling
from solidtouch.models.seeds import Purpose, derived_seed
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.own_stories import stories
from benchmarks.page import parsed, publish, share_interval, table, write_block
from benchmarks.studies.models import sbc
from benchmarks.studies.models.figures import RulePanel, rule_figure
from benchmarks.studies.models.recovery import OWN_SIZES, reduced_rig
from benchmarks.studies.models.user_sbc import fit_of
from benchmarks.studies.models.user_stories import NAMES
from benchmarks.study import thinned, until_interrupted, write_json

SIZES = sbc.Sizes(L=2, M=3, J=5, K=4, repeats=9)
FEW = SIZES._replace(repeats=2)
LONG = 30
"""Runs of the long fit, six times as many as a fit has at most."""
NEAR = (0.1, 0.5)
"""Gaps to the long fit that are counted, in nats per tap."""
FORMER = 0.5
"""The rule's limit in earlier versions, in nats per tap."""
_LOSSES = 500  # draws from the guide of which a loss is the mean
_EVERY = 4  # how manyth tap of the rig is kept


class Ended(NamedTuple):
    """A fit after every run.

    Attributes:
        model: Its name.
        source: Where its taps are from.
        change: Change of the loss that the rule looks at after every run, in nats per tap.
        limit: What the rule allows.
        gap: Loss after every run less that of the long fit, in nats per tap.
        distance: From there to the end of the long fit, in posterior standard deviations, root mean square of all
            latent variables.
    """

    model: str
    source: str
    change: list[float]
    limit: float
    gap: list[float]
    distance: list[float]

    @property
    def end(self) -> int:
        """Number of the run after which the rule ends the fit, from 0."""
        return next((i for i, change in enumerate(self.change) if change <= self.limit), len(self.change) - 1)

    @property
    def converged(self) -> bool:
        """Whether the rule calls it so."""
        return self.change[self.end] <= self.limit

    def near(self, gap: float) -> bool:
        """Whether it ends at most so far from the long fit."""
        return self.gap[self.end] <= gap


class Data(NamedTuple):
    """Data sets of one shape for one model.

    Attributes:
        model: Name of the model.
        source: Where they are from.
        fits: What to fit, from the number of a data set.
    """

    model: str
    source: str
    fits: Callable[[int], fits.Fit]


def from_prior(name: str, sizes: sbc.Sizes, seed: int, n: int) -> Data:
    """Taps drawn from the prior of a model."""
    begun = fit_of(name, sizes)

    @cache
    def drawn() -> NDArray[np.float64]:
        samples = sbc.from_story(partial(begun.story, begun.batch), seed, n)[1].astype(np.float64)
        return samples.swapaxes(2, 3) if begun.structure.swapped else samples

    taps = f"prior, {len(begun.batch.where)} taps"
    return Data(name, taps, lambda number: begun._replace(samples=drawn()[number]))


def from_rig(name: str, seed: int) -> Data:
    """Taps of the simulated rig, standardised as in a fit."""
    story = StoryFunction.of(stories()[name], name)

    def fit(number: int) -> fits.Fit:
        taps = _rig_taps(derived_seed(seed, Purpose.REPEAT, number))
        grid, K = taps.grid(), taps.dataset.sizes["taxel"]
        known = Taps(taps.taps.astype(np.float64), *taps.indices(grid), grid.shape, taps.where)
        batch = replace(batch_of(grid, taps.preprocessing, K), where=known.where, what=known.what, session=taps.session)
        samples = Scaling.of(known, bin_edges(taps.taps, 100, "global")).scaled(known).samples
        return fits.Fit(story, structure_of(story, batch), batch, samples, 0)

    return Data(name, "simulated rig", fit)


@cache
def _rig_taps(seed: int) -> TapSet:
    rig = reduced_rig(OWN_SIZES)
    sessions = [thinned(simulate_session(rig, seed, number), OWN_SIZES.step) for number in range(OWN_SIZES.sessions)]
    taps = concatenate(sessions)
    return taps.select(np.arange(0, len(taps), _EVERY))


def followed(program: fits.Variational, fit: fits.Fit, data: Data) -> Ended:
    """One fit to its end and beyond."""
    state, losses, _ = program.best_start(fit)
    states, changes = [], []
    for _ in range(LONG):
        state, more = program.run(fits.STEPS, state, fit)
        losses = np.append(losses, more)
        states.append(state)
        changes.append(fits.last_change(losses))
    *gap, last = (_loss(program, one, fit) for one in (*states[: fits.RUNS], state))
    *places, end = (program.svi.get_params(one) for one in (*states[: fits.RUNS], state))
    return Ended(
        data.model,
        data.source,
        changes[: fits.RUNS],
        fits.largest_change(fit),
        [one - last for one in gap],
        [_distance(one, end, fit.names) for one in places],
    )


def _distance(one: Any, end: Any, names: Sequence[str]) -> float:
    apart = [np.ravel((one[f"{n}_auto_loc"] - end[f"{n}_auto_loc"]) / end[f"{n}_auto_scale"]) for n in names]
    return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))


def _loss(program: fits.Variational, state: Any, fit: fits.Fit) -> float:
    """Mean loss in nats per tap over the same draws for every state."""
    return float(_losses(program.svi)(state, fit.samples).mean()) / len(fit.samples)


@cache
def _losses(svi: Any) -> Callable[[Any, Any], Any]:
    def each(state: Any, samples: Any) -> Any:
        keys = jax.random.split(jax.random.key(0), _LOSSES)
        return jax.lax.map(lambda key: svi.evaluate(state._replace(rng_key=key), samples), keys)

    return jax.jit(each)


def run(data: Data, n: int) -> list[Ended]:
    """All fits of one model to one kind of data."""
    program = cache(lambda: fits.Variational.of(data.fits(0), "svi"))

    def one(number: int) -> Ended:
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            return followed(program(), data.fits(number), data)

    return list(until_interrupted(f"{data.model}, {data.source}", [partial(one, number) for number in range(n)]))


def result_table(ended: Sequence[Ended]) -> str:
    """A line for each model and kind of data, and one for all."""
    kinds = list(dict.fromkeys((one.model, one.source) for one in ended))
    lines = [[*kind, *_cells([one for one in ended if (one.model, one.source) == kind])] for kind in kinds]
    return table(["model", "taps from", *_HEAD], [*lines, ["all", "", *_cells(ended)]])


def limits_table(ended: Sequence[Ended]) -> str:
    """The same for all fits under other limits, of which the first was that of earlier versions."""
    rules = {
        f"{FORMER:g} nats per tap": [one._replace(limit=FORMER) for one in ended],
        "the rule": ended,
        "half of the rule": [one._replace(limit=one.limit / 2) for one in ended],
    }
    lines = [[name, *_cells(under)] for name, under in rules.items()]
    return table(["limit of the change", *_HEAD], lines)


_HEAD = [
    "data sets",
    "called converged",
    *(f"of these at most {gap:g} nats per tap from the long fit" for gap in NEAR),
    f"called unconverged at a gap of at most {NEAR[0]:g}",
    "mean number of runs",
    "gap, median and largest (nats per tap)",
    "distance, median (posterior sd)",
]


def _cells(ended: Sequence[Ended]) -> list[str]:
    called = [one for one in ended if one.converged]
    near = [one for one in ended if one.near(NEAR[0])]
    gap = [one.gap[one.end] for one in called]
    return [
        str(len(ended)),
        share_interval(len(called), len(ended)),
        *(_share(sum(one.near(limit) for one in called), len(called)) for limit in NEAR),
        _share(sum(not one.converged for one in near), len(near)),
        f"{np.mean([one.end + 1 for one in ended]):.1f}",
        f"{np.median(gap):.3f}, {np.max(gap):.2f}" if gap else "",
        f"{np.median([one.distance[one.end] for one in ended]):.2f}",
    ]


def _share(hits: int, n: int) -> str:
    return share_interval(hits, n) if n else ""


def panels(ended: Sequence[Ended]) -> list[RulePanel]:
    """What the figure shows, a panel for each kind of data."""
    found = []
    for source in dict.fromkeys(one.source for one in ended):
        own = [one for one in ended if one.source == source]
        points: dict[str, NDArray[np.float64]] = {
            model: np.array([(one.change, one.gap) for one in own if one.model == model]).transpose(1, 0, 2)
            for model in dict.fromkeys(one.model for one in own)
        }
        found.append(RulePanel(source, own[0].limit, points))
    return found


def main() -> None:
    """Runs the study as the command line says."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--prior", type=int, default=40, help="data sets per model from its prior")
    parser.add_argument("--few", type=int, default=20, help="likewise, with few taps")
    parser.add_argument("--rig", type=int, default=10, help="data sets per model from the simulated rig")
    parser.add_argument("--seed", type=int, default=1)
    options = parsed(parser, "svi-rule")
    tasks = [
        *((from_prior(name, SIZES, options.seed, options.prior), options.prior) for name in NAMES),
        *((from_prior(name, FEW, options.seed, options.few), options.few) for name in NAMES),
        *((from_rig(name, options.seed), options.rig) for name in NAMES),
    ]
    ended = [one for data, n in tasks for one in run(data, n)]
    if not ended:
        return
    write_json("svi-rule", [one._asdict() for one in ended])
    L, M, J, K = SIZES[:4]
    text = (
        f"Taps from priors: {L} x {M} classes, {J} samples, {K} taxels, {SIZES.repeats} or {FEW.repeats} taps per "
        f"class; from the rig: {OWN_SIZES.positions} x {OWN_SIZES.rods} classes, every {OWN_SIZES.step}th sample and "
        f"taxel, every {_EVERY}th tap of {OWN_SIZES.sessions} sessions; seed {options.seed}. The long fit has {LONG} "
        f"runs.\n\n{result_table(ended)}\n\nAll of them under other limits:\n\n{limits_table(ended)}"
    )
    print(text)
    if options.document is not None and len(ended) == sum(n for _, n in tasks):
        publish(rule_figure(panels(ended)), options.document, "svi-rule")
        write_block(options.document, "svi-rule", text)


if __name__ == "__main__":
    main()
