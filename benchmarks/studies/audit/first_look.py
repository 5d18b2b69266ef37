"""Whether the quick rule of `inspect` finds the miscalibration that an audit can detect.

Simulated sessions of the paper's rig train a histogram; as many taps as a design has are drawn from it, so that beliefs
are right, and are played as `audit` does. The smallest detectable factor of that simulation (`audit.detectable`) is
compared with the closed form of `inspect`, which knows taps to a decision and the doubt left, and no data sets.

`--document docs/how-to/recording.md` updates the table of that page.
"""

import argparse
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from solidtouch.analysis.audit.detectable import detectable_factor
from solidtouch.analysis.inspect.quick_fit import quick_fit
from solidtouch.analysis.stats.detection import LEVEL
from solidtouch.analysis.stats.right_model import reference_factors
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.trials.records import tap_table
from solidtouch.models.grid import tap_pool
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import parsed, table, write_block
from benchmarks.study import until_interrupted, write_json

PRESETS, OBJECTS, TAPS = ("paper", "ideal", "broken"), (2, 5), (5, 10, 20, 60)


class FirstLook(NamedTuple):
    """One design.

    Attributes:
        rig: Preset.
        objects: Number of objects, at 16 positions each.
        taps: Taps of each class that beliefs are judged on.
        quick: Detectable factor by the closed form.
        passive: The same by simulation, without moves.
        active: With moves.
    """

    rig: str
    objects: int
    taps: int
    quick: float
    passive: float
    active: float


def look(rig: str, objects: int, taps: int, seed: int, trials: int, simulations: int) -> FirstLook:
    """Both factors of one design."""
    sessions = [simulate_session(preset(rig), seed, session) for session in range(2)]
    train, test = (part.select(part.what < objects) for part in sessions)
    grid = train.grid("1mm")
    fit = quick_fit(concatenate([train, _session(test, 1)]), grid, judged=taps)
    if fit is None:
        raise ValueError("The sessions allow no quick fit.")
    model = fit_model("histogram", train, grid, FitSettings()).model
    l, m = (np.repeat(index, taps) for index in np.nonzero(model.trained))
    design = tap_table(model, test)._replace(pool=tap_pool(l, m, grid.shape))

    def simulated(policy: str) -> float:
        factors = reference_factors(model, design, Setting(), policy, trials, seed, simulations)[:, 0]
        return detectable_factor(factors[np.isfinite(factors)], LEVEL / 2)

    return FirstLook(rig, objects, taps, fit.right.factor(len(l)), simulated("passive"), simulated("active"))


def _session(taps: TapSet, number: int) -> TapSet:
    return TapSet(taps.dataset.assign_coords(session=("tap", np.full(len(taps), number))))


def page(found: list[FirstLook], seed: int, trials: int, simulations: int) -> str:
    """What the page says of the results."""
    lines = [[str(value) for value in one[:3]] + [f"{factor:.1f}" for factor in one[3:]] for one in found]
    ratio = np.array([one.quick / one.passive for one in found])
    return (
        f"Seed {seed}, {simulations} data sets of {trials} trials for each simulated factor. The closed form is "
        f"{ratio.min():.2f} to {ratio.max():.2f} times the factor of trials without moves, the median "
        f"{np.median(ratio):.2f}.\n\n"
        + table(["preset", "objects", "taps per class", "closed form", "passive", "active"], lines)
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=500, help="trials per data set")
    parser.add_argument("--simulations", type=int, default=39, help="data sets per design")
    parser.add_argument("--seed", type=int, default=470)
    options = parsed(parser, "first-look")
    run = partial(look, seed=data_set_seed(options.seed, 0), trials=options.trials, simulations=options.simulations)
    tasks: list[Callable[[], FirstLook]] = [
        partial(run, rig, objects, taps) for rig in PRESETS for objects in OBJECTS for taps in TAPS
    ]
    found = list(until_interrupted("First look", tasks))
    if not found:
        return
    write_json("first-look", [one._asdict() for one in found])
    ordered = sorted(found, key=lambda one: (PRESETS.index(one.rig), *one[1:3]))
    text = page(ordered, options.seed, options.trials, options.simulations)
    print(text)
    if options.document is not None and len(found) == len(tasks):
        write_block(options.document, "first-look", text)


if __name__ == "__main__":
    main()
