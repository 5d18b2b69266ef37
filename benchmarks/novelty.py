"""Measures novelty p-values: how often known taps are flagged, and how often new things are.

`python benchmarks/novelty.py` simulates; recordings named behind it are split and measured too.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from solidtouch.hardware.data_collection import simulate_session
from solidtouch.hardware.presets import preset
from solidtouch.hardware.sensor import TouchSensor
from solidtouch.hardware.simulated import SimulatedRig
from solidtouch.inference.control import MovePolicy, fixation, passive
from solidtouch.inference.engine import make_engine
from solidtouch.inference.episode import steps
from solidtouch.inference.novelty import Novelty, UnknownTest, can_tell
from solidtouch.models.classes import ClassGrid
from solidtouch.models.experiment import load_experiment
from solidtouch.models.histogram import HistogramModel, fit, trim
from solidtouch.models.novelty import novelty_scores
from solidtouch.models.taps import TapSet, concatenate

PAPER = preset("paper")
UNTOUCHED = replace(PAPER, depth_mm=0.0)
BEYOND = replace(PAPER, start_mm=16.0, end_mm=20.0)
ALPHA, THETA, DEADLINE = 0.05, 0.95, 30


def calibrated(train: TapSet, grid: ClassGrid | None = None) -> HistogramModel:
    """A model with novelty scores."""
    model = fit(train, train.grid() if grid is None else grid)
    return replace(model, novelty=novelty_scores(model, train))


def p_values(model: HistogramModel, taps: TapSet) -> NDArray[np.float64]:
    """Of taps that nothing is known about, shape (N,)."""
    novelty = Novelty(model)
    return np.array([novelty.p_value(model.log_prior, tap) for tap in taps.taps])


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


def alarm(model: HistogramModel, sensor: TouchSensor, policy: MovePolicy) -> int | None:
    """The tap after which an episode is called unknown, or `None`."""
    novelty, test = Novelty(model), UnknownTest(ALPHA)
    for step in steps(sensor, make_engine("numpy", model), THETA, policy, DEADLINE):
        if test.add(novelty.p_value(step.log_predicted, step.tap)):
            return step.number
    return None


def episodes(n: int) -> Iterator[tuple[str, list[int | None]]]:
    """Alarms of episodes by name."""
    sessions = [[simulate_session(PAPER, seed, s) for s in range(3)] for seed in range(max(1, n // 25))]
    models = [calibrated(concatenate(parts)) for parts in sessions]
    kept = models[0].grid.select(range(models[0].grid.L), [0, 1, 2, 3])
    fewer = [calibrated(concatenate([p.select(p.what != 4) for p in parts]), kept) for parts in sessions]
    ones = [calibrated(parts[0]) for parts in sessions]
    generator = np.random.default_rng(0)
    starts = [(i % len(models), float(generator.uniform(0, 16)), int(generator.integers(5)), i) for i in range(n)]

    def run(name: str, chosen: list[HistogramModel], policy: MovePolicy, make: Callable[..., TouchSensor]):
        return name, [alarm(chosen[seed], make(seed, at, what, i), policy) for seed, at, what, i in starts]

    def live(seed: int, at: float, what: int, run: int) -> SimulatedRig:
        return SimulatedRig(PAPER, seed, 3, at, what, run)

    yield run("known, active, 3 sessions trained", models, fixation(7), live)
    yield run("known, passive, 3 sessions trained", models, passive, live)
    yield run("known, active, 1 session trained", ones, fixation(7), live)
    yield run("12 mm rod left out, active", fewer, fixation(7), lambda s, at, _, i: live(s, at, 4, i))
    yield run("object taken away after tap 3, active", models, fixation(7), lambda *a: Vanishing(live(*a), 3))
    yield run(
        "no object at all, active", models, fixation(7), lambda s, at, w, i: SimulatedRig(UNTOUCHED, s, 3, at, w, i)
    )


def recorded(path: str, where_cell: str | None) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """P-values of the test taps of a recording, all and with each object left out of training in turn."""
    for method in ("parity", "sessions"):
        parts, grid = load_experiment([path], where_cell, where_cell, method)
        fold = parts.folds[0]
        grid, _ = trim(grid, [fold.train])
        name = f"{path.rsplit('/', 1)[-1]}, {method}"
        yield f"{name}: known", known(fold.train, fold.test, grid)
        strange = [left_out(fold.train, fold.test, grid, m) for m in range(0, grid.M, max(1, grid.M // 10))]
        yield f"{name}: object left out", np.concatenate(strange)


def known(train: TapSet, test: TapSet, grid: ClassGrid) -> NDArray[np.float64]:
    """P-values of taps of trained classes."""
    model = calibrated(train, grid)
    return p_values(model, model.usable(test)) if can_tell(model) else np.empty(0)


def left_out(train: TapSet, test: TapSet, grid: ClassGrid, m: int) -> NDArray[np.float64]:
    """P-values of the taps of an object under the model of the others."""
    rest = train.select(train.indices(grid)[1] != m)
    model = calibrated(rest, grid.select(range(grid.L), [i for i in range(grid.M) if i != m]))
    where, what = test.indices(grid)
    chosen = (where >= 0) & (what == m)
    return p_values(model, test.select(chosen)) if can_tell(model) and chosen.any() else np.empty(0)


def show(name: str, p: NDArray[np.float64]) -> None:
    """One line of a table."""
    if not len(p):
        print(f"| {name} | 0 | - | - | - |")
        return
    print(f"| {name} | {len(p)} | {np.mean(p < 0.01):.3f} | {np.mean(p < 0.1):.3f} | {np.median(p):.2f} |", flush=True)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*")
    parser.add_argument("--where-cell", help="Width of the cells of a recording.")
    parser.add_argument("--data-sets", type=int, default=6)
    parser.add_argument("--episodes", type=int, default=200)
    options = parser.parse_args()
    print("| single taps | taps | p < .01 | p < .1 | median p |\n|---|---|---|---|---|")
    for path in options.recordings:
        for name, p in recorded(path, options.where_cell):
            show(name, p)
    if options.recordings:
        return
    for rows in zip(*(single_taps(seed) for seed in range(options.data_sets)), strict=True):
        show(rows[0][0], np.concatenate([p for _, p in rows]))
    print(f"\n| episodes, alpha {ALPHA} | episodes | called unknown | median tap |\n|---|---|---|---|")
    for name, alarms in episodes(options.episodes):
        taps = [tap for tap in alarms if tap is not None]
        print(f"| {name} | {len(alarms)} | {len(taps) / len(alarms):.3f} | {np.median(taps) if taps else '-'} |")


if __name__ == "__main__":
    main()
