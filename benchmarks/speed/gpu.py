"""Trials, likelihood tables and fits on the cores and on a GPU of one machine; without one, the GPU's code on the CPU.

Trials are those of `decisions`, in the largest batch; the transfer of tables, plans and decisions counts. Functions are
those of docs/how-to/your-own-model.md, on taps of the paper's task. What a first call compiles does not count, but
chains compile in every fit.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from solidtouch.models.measurement.fits.device import on_device

import solidtouch as st
from benchmarks.own_stories import stories
from benchmarks.speed.rows import ALL_CORES, LIMIT, Row, interleaved, on_cores, per_unit
from benchmarks.speed.trials.decisions import THRESHOLD, UNIT
from benchmarks.speed.trials.job import POLICIES, SEED, Decisions, Job, make_job, ours, paper_table

BATCH = 1 << 20
STEPS = {"svi": 800, "nuts": 50}
_COPIED = 1 << 28
"""Numbers that are copied at once to measure the bandwidth: 1 GiB, far more than caches hold."""


def rows(quick: bool = False) -> list[Row]:
    """Every work on one core and on the device, trials also on all cores."""
    return [*_trials(quick), *_functions(quick)]


def _device():
    """The GPU, or the processor where there is none."""
    return next((device for device in jax.devices() if device.platform == "gpu"), jax.devices("cpu")[0])


def _name() -> str:
    device = _device()
    return f"solidtouch, {device.device_kind}" if device.platform == "gpu" else "solidtouch, arrays by XLA"


def _trials(quick: bool) -> list[Row]:
    found = []
    for policy in POLICIES:
        job = make_job(paper_table(), 1000 if quick else BATCH, policy, (THRESHOLD,))
        there = "gpu" if _device().platform == "gpu" else "xla-cpu"
        ways = {
            "solidtouch, one core": partial(ours, job),
            f"solidtouch, {len(ALL_CORES)} cores": partial(_on_all, job),
            _name(): partial(ours, job, device=there),
        }
        played = {method: way() for method, way in ways.items()}  # compiles
        expected = played["solidtouch, one core"]
        taps = int(expected.taps.sum())
        numbers = jax.device_put(np.zeros(1 << 10 if quick else _COPIED, np.float32), _device())
        size = 3 * job.prior.nbytes * taps
        _moved(numbers.nbytes, numbers)  # compiles
        copies = {f"{LIMIT}memory of the device": partial(_moved, numbers.nbytes if quick else size, numbers)}
        seconds = interleaved(ways | copies, 2 if quick else 5)
        for method, times in seconds.items():
            if method in played:
                differing = np.count_nonzero((played[method].taps != expected.taps).any(axis=1))
                note = f"{len(job.number) / np.median(times):,.0f} trials/s; {differing} of {len(job.number)} otherwise"
            else:
                note = "copies as many bytes as beliefs before and after taps, and their likelihoods, have"
            found.append(Row(f"trials to {THRESHOLD}, {policy}, one batch", method, per_unit(times, taps), UNIT, note))
    return found


def _on_all(job: Job) -> Decisions:
    with on_cores(len(ALL_CORES)):
        return ours(job, len(ALL_CORES))


def _moved(size: int, numbers: jax.Array) -> None:
    """Reads and writes so many bytes of the device's memory in all."""
    for _ in range(max(1, round(size / (2 * numbers.nbytes)))):
        numbers = _negative(numbers)
    numbers.block_until_ready()


_negative = jax.jit(jnp.negative)


def _functions(quick: bool) -> list[Row]:
    """A table of `walk`, which is computed tap by tap, and fits of `laplace`."""
    train, test = st.simulate("paper", sessions=2, seed=SEED)
    if quick:
        train, test = (taps.select((taps.where < 2) & (taps.what < 2)) for taps in (train, test))
    few, functions = train.select(slice(0, None, 20)), stories()
    model = st.fit(train, functions["walk"], method="map", steps=STEPS["svi"], unconverged=True)
    classes = np.prod(model.grid.shape)
    works: dict[str, tuple[Callable[[str], NDArray[np.float64]], str]] = {
        f"log-likelihoods of the function walk: {len(test)} taps x {classes} classes x {test.taps[0].size} samples": (
            lambda device: _table(model, test, device),
            "table",
        ),
        f"variational fit of the function laplace to {len(train)} taps": (
            lambda device: _levels(train, functions["laplace"], "svi", device),
            "fit",
        ),
        f"chains of the function laplace on {len(few)} taps, {STEPS['nuts']} steps of each of 4": (
            lambda device: _levels(few, functions["laplace"], "nuts", device),
            "fit",
        ),
    }
    found = []
    for work, (compute, unit) in works.items():
        ways = {"solidtouch, one core": partial(compute, "cpu"), _name(): partial(compute, _device().platform)}
        note = ""
        if not work.startswith("chains"):  # which differ by more than rounding, and compile in every fit
            here, there = (way() for way in ways.values())
            note = f"largest difference {np.abs(here - there).max():.0e}"
        seconds = interleaved(ways, 3 if note and not quick else 1)
        found += [Row(work, method, times, unit, note) for method, times in seconds.items()]
    return found


def _table(model: st.TapModel, taps: st.TapSet, device: str) -> NDArray[np.float64]:
    with on_device(device):
        return model.log_likelihood(taps.taps)


def _levels(taps: st.TapSet, story: Callable[..., object], method: str, device: str) -> NDArray[np.float64]:
    """Levels of the classes by a fit."""
    fitted = st.fit(taps, story, method=method, steps=STEPS[method], unconverged=True, device=device, seed=SEED)
    return fitted.parameters["loc"]
