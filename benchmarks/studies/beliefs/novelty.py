"""How often known and new taps are flagged, and how often known and new objects are called unknown.

Simulates data sets, or splits the recordings it is given. Counts have 95% Wilson intervals that treat all taps and
episodes as independent, which those of one session are not quite.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.sensor import TouchSensor
from solidtouch.hardware.simulator.rig import SimulatedRig
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import steps
from solidtouch.inference.moves.control import MovePolicy, default_fixation, fixation, passive
from solidtouch.inference.novelty import Novelty, UnknownTest, can_tell
from solidtouch.models import seeds
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import HistogramModel, fit, trim
from solidtouch.models.settings import Division
from solidtouch.models.splits import load_experiment
from solidtouch.models.taps import TapSet, concatenate

PAPER = preset("paper")
UNTOUCHED = replace(PAPER, depth_mm=0.0)
BEYOND = replace(PAPER, start_mm=16.0, end_mm=20.0)
ALPHA, THETA, DEADLINE, RECORDED_DEADLINE = 0.05, 0.95, 30, 10


def calibrated(train: TapSet, grid: ClassGrid | None = None) -> HistogramModel:
    """A model with novelty scores."""
    model = fit(train, train.grid() if grid is None else grid)
    return model.with_scores(train)


def p_values(model: HistogramModel, taps: TapSet) -> NDArray[np.float64]:
    """Of taps that nothing is known about, under the class that each fits best, shape (N,)."""
    novelty = Novelty(model)
    return novelty.p_values(novelty.misfit(taps.taps)).max(axis=(1, 2))


def single_taps(seed: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """P-values of known taps and of new ones, by name."""
    sessions = [simulate_session(PAPER, seed, session) for session in range(4)]
    first, new = sessions[0], sessions[3]
    odd = np.arange(len(first)) % 2 == 1
    yield "known: other taps of the training session", p_values(calibrated(first.select(~odd)), first.select(odd))
    yield "known: new session, 1 trained", p_values(calibrated(first), new)
    model = calibrated(concatenate(sessions[:3]))
    yield "known: new session, 3 trained", p_values(model, new)
    untouched = simulate_session(UNTOUCHED, seed, 3)
    yield "new: no contact", p_values(model, untouched)
    yield "new: 16 to 20 mm, beyond the range", p_values(model, simulate_session(BEYOND, seed, 3))
    grid = model.grid.select(range(4, 12), range(model.grid.M))
    central = calibrated(concatenate(sessions[:3]), grid)
    centre = new.select(np.minimum(*new.indices(grid)) >= 0)
    yield "4 to 12 mm only, known: new session", p_values(central, centre)
    yield "4 to 12 mm only, new: no contact", p_values(central, untouched)
    yield "4 to 12 mm only, new: 0 to 4 mm", p_values(central, new.select(new.where < 4))
    for m in (0, 2, 4):
        rest = concatenate([part.select(part.what != m) for part in sessions[:3]])
        kept = model.grid.select(range(model.grid.L), [i for i in range(model.grid.M) if i != m])
        yield f"new: {new.what_name[m]}, left out", p_values(calibrated(rest, kept), new.select(new.what == m))


class Vanishing:
    """A rig whose object is taken away after some taps."""

    def __init__(self, rig: SimulatedRig, taps: int) -> None:
        self._rig, self._left = rig, taps
        self.preprocessing = rig.preprocessing

    @property
    def step(self) -> float:
        """As the rig's."""
        return self._rig.step

    @property
    def room(self) -> tuple[int, int]:
        """As the rig's."""
        return self._rig.room

    def move(self, delta: int) -> int:
        """As the rig's."""
        return self._rig.move(delta)

    def tap(self) -> NDArray[np.float64]:
        """One more tap."""
        self._left -= 1
        if self._left == -1:
            self._rig = SimulatedRig(UNTOUCHED, 0, 3, self._rig.position_mm, self._rig.what)
        return self._rig.tap()


class Ending(NamedTuple):
    """How an episode ended: after how many taps, and whether with `unknown`."""

    taps: int
    unknown: bool


def ending(model: HistogramModel, sensor: TouchSensor, policy: MovePolicy, deadline: int = DEADLINE) -> Ending:
    """Runs an episode as `solidtouch perceive --unknown` does."""
    test, number = UnknownTest(Novelty(model), ALPHA), 0
    for step in steps(sensor, make_engine("numpy", model), THETA, policy, deadline, test.add):
        number = step.number
        if test.unknown:
            break
    return Ending(number, test.unknown)


class Trained(NamedTuple):
    """The models of one data set: of three sessions, of the first, and without some rods by number."""

    three: HistogramModel
    one: HistogramModel
    less: dict[int, HistogramModel]


def trained(seed: int) -> Trained:
    """Fits the models of a data set."""
    parts = [simulate_session(PAPER, seed, session) for session in range(3)]
    three = calibrated(concatenate(parts))
    M = three.grid.M
    less = {}
    for m in (0, 2, 4):
        kept = three.grid.select(range(three.grid.L), [i for i in range(M) if i != m])
        less[m] = calibrated(concatenate([part.select(part.what != m) for part in parts]), kept)
    return Trained(three, calibrated(parts[0]), less)


def episodes(seed: int, n: int) -> Iterator[tuple[str, list[Ending]]]:
    """Episodes of one data set, by name."""
    models = trained(seed)
    generator = seeds.generator(seed, seeds.Purpose.STUDY)
    starts = [(float(generator.uniform(0, 16)), int(generator.integers(5)), run) for run in range(n)]

    def run(name: str, model: HistogramModel, policy: MovePolicy, make: Callable[[float, int, int], TouchSensor]):
        return name, [ending(model, make(*start), policy) for start in starts]

    def live(at: float, what: int, run: int, session: int = 3) -> SimulatedRig:
        return SimulatedRig(PAPER, seed, session, at, what, run)

    def untouched(at: float, what: int, run: int) -> SimulatedRig:
        return SimulatedRig(UNTOUCHED, seed, 3, at, what, run)

    active = fixation(7)
    yield run("known, active", models.three, active, live)
    yield run("known, passive", models.three, passive(), live)
    yield run("known, active, one session trained and tested", models.one, active, lambda *s: live(*s, 0))
    yield run("known, active, one session trained, another tested", models.one, active, live)
    for m, model in models.less.items():
        name = models.three.grid.what_name[m]
        yield run(f"new: {name}, left out, active", model, active, lambda at, _, i, m=m: live(at, m, i))
    yield run("new: object taken away after tap 3, active", models.three, active, lambda *s: Vanishing(live(*s), 3))
    yield run("new: no object at all, active", models.three, active, untouched)
    yield run("new: no object at all, passive", models.three, passive(), untouched)


class Case(NamedTuple):
    """An object of a recording before a model that knows it or not."""

    what: int
    model: HistogramModel


def recorded(path: str, where_cell: str | None, most: int, runs: int) -> None:
    """Rows for a recording: taps and episodes of known objects, and of objects left out of training one at a time."""
    for method in ("parity", "sessions"):
        parts, grid = load_experiment([path], Division(where_cell=where_cell, what_cell=where_cell, split=method))
        fold = parts.folds[0]
        grid, _ = trim(grid, [fold.train])
        what = fold.train.indices(grid)[1]
        objects = np.unique(np.linspace(0, grid.M - 1, min(most, grid.M)).round().astype(int)).tolist()
        known = calibrated(fold.train, grid)
        fewer = [grid.select(range(grid.L), [i for i in range(grid.M) if i != m]) for m in objects]
        others = [calibrated(fold.train.select(what != m), g) for m, g in zip(objects, fewer, strict=True)]
        name = f"{path.rsplit('/', 1)[-1]}, {method}"
        cases = [Case(m, known) for m in objects]
        row(f"{name}: known", fold.test, grid, cases, runs)
        row(f"{name}: left out", fold.test, grid, [Case(*pair) for pair in zip(objects, others, strict=True)], runs)


def row(name: str, test: TapSet, grid: ClassGrid, cases: Sequence[Case], runs: int) -> None:
    """One line of the table of a recording; episodes draw recorded taps of the place where the sensor stands."""
    where, what = test.indices(grid)
    p, ended = [np.empty(0)], []
    for case in cases:
        chosen = test.select((where >= 0) & (what == case.what))
        if not len(chosen) or not can_tell(case.model):
            continue
        p.append(p_values(case.model, chosen))
        earliest = Novelty(case.model).promise(ALPHA).soonest
        if earliest is None or earliest > RECORDED_DEADLINE:
            continue
        policy = passive() if grid.L == 1 else fixation(default_fixation(grid.L))
        for run in range(runs):
            generator = seeds.generator(0, seeds.Purpose.STUDY, case.what, run)
            start = int(generator.integers(grid.L))
            sensor = ReplayRig(test, grid, start, case.what, generator)
            ended.append(ending(case.model, sensor, policy, deadline=RECORDED_DEADLINE))
    value = np.concatenate(p)
    if not ended:
        usual = f"{share(value < 0.1)} | {np.median(value):.2f}" if len(value) else "- | -"
        print(f"| {name} | {len(value)} | {usual} | 0 | cannot be, within {RECORDED_DEADLINE} taps |", flush=True)
        return
    unknown = share([end.unknown for end in ended])
    print(
        f"| {name} | {len(value)} | {share(value < 0.1)} | {np.median(value):.2f} | {len(ended)} | {unknown} |",
        flush=True,
    )


def share(hits: Sequence[bool] | NDArray[np.bool_]) -> str:
    """A proportion with its interval."""
    interval = binomtest(int(np.sum(hits)), len(hits)).proportion_ci(method="wilson")
    return f"{np.mean(hits):.3f} [{interval.low:.3f}, {interval.high:.3f}]"


def simulated(data_sets: int, runs: int) -> None:
    """The tables of simulated taps and episodes."""
    own = [seeds.data_set_seed(0, d) for d in range(data_sets)]
    print("| single taps | taps | p < .01 | p < .1 | median p |\n|---|---|---|---|---|")
    for rows in zip(*(single_taps(seed) for seed in own), strict=True):
        p = np.concatenate([p for _, p in rows])
        print(f"| {rows[0][0]} | {len(p)} | {np.mean(p < 0.01):.3f} | {np.mean(p < 0.1):.3f} | {np.median(p):.2f} |")
    head = f"| episodes, alpha {ALPHA} | episodes | called unknown | least, most data set | taps |"
    print(f"\n{head}\n|---|---|---|---|---|")
    for rows in zip(*(episodes(seed, runs) for seed in own), strict=True):
        ends = [end for _, part in rows for end in part]
        rates = [np.mean([end.unknown for end in part]) for _, part in rows]
        extremes = f"{min(rates):.2f}, {max(rates):.2f}"
        taps = np.mean([end.taps for end in ends])
        print(
            f"| {rows[0][0]} | {len(ends)} | {share([e.unknown for e in ends])} | {extremes} | {taps:.1f} |", flush=True
        )


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*", help="tap files; default: simulate")
    parser.add_argument("--where-cell", help="width of the position cells of a recording")
    parser.add_argument("--objects", type=int, default=12, help="maximum number of objects of a recording to leave out")
    parser.add_argument("--data-sets", type=int, default=6, help="simulated data sets")
    parser.add_argument("--episodes", type=int, default=50, help="episodes per data set, or per object of a recording")
    options = parser.parse_args()
    if not options.recordings:
        simulated(options.data_sets, options.episodes)
        return
    print("| recording | taps | p < .1 | median p | episodes | called unknown |\n|---|---|---|---|---|---|", flush=True)
    for path in options.recordings:
        recorded(path, options.where_cell, options.objects, options.episodes)


if __name__ == "__main__":
    main()
