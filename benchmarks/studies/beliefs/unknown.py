"""Level and power of the answer "unknown" on data of known truth, for every object.

The truth of a class is a large pool of simulated taps. Training taps and the taps of episodes are drawn from it
independently and with replacement, so false alarms are those of fresh taps from the distribution used for calibration.
Each data set has one draw of training taps and one episode per object, so episodes of an object are independent and
their counts have exact binomial (Clopper-Pearson) intervals. Episodes last 300 taps or until an alarm.

`--document docs/explanation/unknown-objects.md` updates the tables of that page.
"""

import argparse
from functools import partial
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest
from solidtouch.analysis.experiment.sources import right_model
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.novelty import Novelty, log_mixture, ranks
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.seeds import Purpose, generator
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import check_block, table, write_block
from benchmarks.study import thinned, until_interrupted, write_json

ALPHA = 0.05
TIMES = (30, 100, 300)
TAPS = (5, 20, 60)
"""Training taps per class, half of which calibrate."""
PLACES = range(5, 11)
KNOWN, NEW = (0, 1, 2), 4
"""Objects by their number among the rods of 4, 6, 8, 10 and 12 mm."""
BINS = 30
"""Bins of the histograms."""
SPREAD = 0.2
"""What is added to all samples of a tap of the object that varies more: its deviation in counts, for each place."""
POLICIES = ("active", "passive", "worst")
TRUTHS = ("model", "ideal", "varied")


class PerObject(Novelty):
    """Bets from the calibration taps of an object at all places together."""

    def _set_bets(self, misfit: NDArray[np.float64], cell: NDArray[np.intp]) -> None:
        L, M = self.trained.shape
        super()._set_bets(misfit, cell % M)
        self._threshold = np.tile(self._threshold[:M], (L, 1))
        self._log_bet = np.tile(self._log_bet[:, :M], (1, L, 1))


class Unbounded(Novelty):
    """Bets from the usual p-values, (1 + j)/(n + 1)."""

    def _set_bets(self, misfit: NDArray[np.float64], cell: NDArray[np.intp]) -> None:
        with patch("solidtouch.inference.novelty.upper_bounds", lambda n, _: ranks(n) / (n + 1)):
            super()._set_bets(misfit, cell)


RULES = {"class": Novelty, "object": PerObject, "no bounds": Unbounded}


class Truth(NamedTuple):
    """Pools of taps that stand for the distributions of classes.

    Attributes:
        grid: Of the known objects.
        taps: All taps.
        pool: For each place and object, known ones first, the taps by their number.
    """

    grid: ClassGrid
    taps: TapSet
    pool: dict[tuple[int, int], NDArray[np.intp]]


def truth(name: str, sessions: int, seed: int = 0) -> Truth:
    """Pools of a preset, `model`, `varied` or one of the simulated rig, of 20 taps per class in each session."""
    if name == "model":
        taps = draw_session(right_model(seed, 10), 20 * sessions, seed)
    else:
        rig = preset("ideal" if name == "varied" else name)
        taps = concatenate([thinned(simulate_session(rig, seed, number), 5) for number in range(sessions)])
    whole = taps.grid()
    where, what = taps.indices(whole)
    taps = taps.select(np.isin(where, PLACES) & np.isin(what, (*KNOWN, NEW)))
    dataset = taps.dataset.isel(taxel=slice(None, None, 3))
    dataset = dataset.assign(session=("tap", np.zeros(len(taps), dtype=np.int64)))
    where, what = taps.indices(whole)
    if name == "varied":
        spread = SPREAD * (where - PLACES[0]) * (what == KNOWN[-1])
        shift = generator(seed, Purpose.STUDY, 0).normal(0, 1, len(taps)) * spread
        dataset["taps"] = dataset["taps"] + shift[:, np.newaxis, np.newaxis]
    cells = [(l, m) for l in PLACES for m in (*KNOWN, NEW)]
    pool = {(l - PLACES[0], (*KNOWN, NEW).index(m)): np.flatnonzero((where == l) & (what == m)) for l, m in cells}
    return Truth(whole.select(PLACES, KNOWN), TapSet(dataset), pool)


def alarms(true: Truth, n: int, rule: str, seed: int) -> dict[tuple[str, int], int]:
    """Taps after which an alarm came in an episode of each policy and object, 0 for none; n training taps per class."""
    chance = generator(seed, Purpose.STUDY, n)
    L, M = true.grid.shape
    chosen = [chance.choice(true.pool[l, m], n) for l in range(L) for m in range(M)]
    train = true.taps.select(np.concatenate(chosen))
    model = fit(train, true.grid, bins=BINS).with_scores(train)
    novelty = RULES[rule](model)
    T = max(TIMES)
    found = {}
    for m in range(M + 1):
        fresh = true.taps.taps[np.stack([chance.choice(true.pool[l, m], T) for l in range(L)])]
        misfit = novelty.misfit(fresh)
        likelihood = model.log_likelihood(fresh.reshape(-1, *fresh.shape[2:])).reshape(misfit.shape)
        start = int(chance.integers(L))
        found["active", m] = alarm(novelty, misfit, path(likelihood, start, L // 2))
        found["passive", m] = alarm(novelty, misfit, np.full(T, start))
        if m < M:
            found["worst", m] = alarm(novelty, misfit, np.full(T, worst_place(novelty, misfit, m)))
    return found


def worst_place(novelty: Novelty, misfit: NDArray[np.float64], what: int) -> int:
    """The place at which the taps of an object win most against it, known to none but an adversary."""
    places = np.arange(len(misfit))
    return int(np.argmax(novelty.log_bets(misfit)[-1, places, :, places, what].mean(axis=1)))


def path(likelihood: NDArray[np.float64], start: int, aim: int) -> NDArray[np.intp]:
    """Places of the taps of an episode that moves, from the place all taps so far make most probable, to another.

    Args:
        likelihood: Log-likelihoods of the taps at each place under each class, shape (L, T, L, M).
        start: Place of the first tap.
        aim: Where moves aim for.

    Returns:
        Shape (T,).
    """
    L, T = likelihood.shape[:2]
    log_belief = np.zeros(likelihood.shape[2:])
    places = [start]
    for t in range(T - 1):
        log_belief = log_belief + likelihood[places[-1], t]
        believed = int(log_belief.max(axis=1).argmax())
        places.append(int(np.clip(places[-1] + aim - believed, 0, L - 1)))
        log_belief = shifted(log_belief, places[-1] - places[-2])
    return np.array(places)


def alarm(novelty: Novelty, misfit: NDArray[np.float64], places: NDArray[np.intp]) -> int:
    """Taps after which `UnknownTest` gives an alarm, 0 for never; all taps at once.

    Args:
        novelty: Of the model.
        misfit: Of the taps at each place to each class, shape (L, T, L, M).
        places: Of the taps, shape (T,).
    """
    L, T = misfit.shape[:2]
    won = novelty.log_bets(misfit[places, np.arange(T)])
    at = np.arange(L) + (places - places[0])[:, np.newaxis]
    inside = (at >= 0) & (at < L)
    won = won[:, np.arange(T)[:, np.newaxis], np.clip(at, 0, L - 1)]
    won = np.where(inside[..., np.newaxis], won, novelty.log_refuted[:, np.newaxis, np.newaxis, np.newaxis])
    wealth = log_mixture(won.cumsum(axis=1)).min(axis=(1, 2))
    alarms = np.flatnonzero(wealth >= -np.log(ALPHA))
    return int(alarms[0]) + 1 if len(alarms) else 0


def shifted(log_belief: NDArray[np.float64], by: int) -> NDArray[np.float64]:
    """Beliefs moved along the first axis; nothing comes in from outside the range."""
    moved = np.full(log_belief.shape, -np.inf)
    L = len(moved)
    moved[max(by, 0) : L + min(by, 0)] = log_belief[max(-by, 0) : L - max(by, 0)]
    return moved


def share(hits: int, n: int) -> str:
    """A proportion with its exact 95% interval."""
    interval = binomtest(hits, n).proportion_ci(method="exact")
    return f"{hits / n:.3f} [{interval.low:.3f}, {interval.high:.3f}]"


def level(found: list[dict[tuple[str, int], int]], policy: str) -> list[str]:
    """False alarms of one object per data set after `TIMES`, and of each object after all taps."""
    ended = np.array([[each[policy, m] for m in range(len(KNOWN))] for each in found])
    drawn = ended[np.arange(len(found)), np.arange(len(found)) % len(KNOWN)]
    return [
        *(share(int(np.sum((drawn > 0) & (drawn <= t))), len(drawn)) for t in TIMES),
        *(share(int(np.sum(ended[:, m] > 0)), len(found)) for m in range(len(KNOWN))),
    ]


def power(found: list[dict[tuple[str, int], int]], policy: str) -> list[str]:
    """Alarms at the new object after `TIMES`, and the median taps to them."""
    ended = np.array([each[policy, len(KNOWN)] for each in found])
    rates = [share(int(np.sum((ended > 0) & (ended <= t))), len(ended)) for t in TIMES]
    return [*rates, f"{np.median(ended[ended > 0]):.0f}" if (ended > 0).any() else "-"]


def main() -> None:
    """Runs the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--document", type=Path, help="page to update")
    parser.add_argument("--data-sets", type=int, default=400, help="number of data sets")
    parser.add_argument("--sessions", type=int, default=15, help="simulated sessions of 20 taps per class in a pool")
    options = parser.parse_args()
    blocks = ("level", "power", "rules")
    check_block(options.document, *blocks)
    rows: dict[str, list[list[str]]] = {block: [] for block in blocks}
    for name in TRUTHS:
        true = truth(name, options.sessions)
        for n in TAPS:
            for rule in RULES if name == "varied" and n > TAPS[0] else ["class"]:
                tasks = [partial(alarms, true, n, rule, seed) for seed in range(options.data_sets)]
                found = list(until_interrupted(f"{name}, {n} taps per class, by {rule}", tasks))
                for policy in POLICIES:
                    kind, first = ("level", name) if rule == "class" else ("rules", rule)
                    rows[kind].append([first, str(n), policy, *level(found, policy)])
                if rule == "class":
                    rows["power"] += [[name, str(n), policy, *power(found, policy)] for policy in POLICIES[:2]]
    times = [f"{t} taps" for t in TIMES]
    objects = [f"{2 * m + 4} mm, {TIMES[-1]} taps" for m in KNOWN]
    heads = {
        "level": ["taps from", "taps per class", "moves", *times, *objects],
        "power": ["taps from", "taps per class", "moves", *times, "median taps"],
        "rules": ["rule", "taps per class", "moves", *times, *objects],
    }
    write_json("unknown", rows)
    for block in blocks:
        text = table(heads[block], rows[block])
        print(f"\n{text}")
        write_block(options.document, block, text)


if __name__ == "__main__":
    main()
