"""Trials, fits and likelihood tables on the cores and on a GPU of one machine; without one, the GPU's code on the CPU.

Trials are those of `decisions`, in the largest batch; the transfer of tables, plans and decisions counts. Functions are
those of docs/how-to/your-own-model.md, on taps of the paper's task. What a first call compiles does not count.
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

ONE = "solidtouch, one core"
BATCH = 1 << 20
STEPS = 800
_COPIED = 1 << 28
"""Numbers that are copied at once to measure the bandwidth: 1 GiB, far more than caches hold."""


def rows(quick: bool = False) -> list[Row]:
    """Every work on all cores and on the device, trials also on one core."""
    return [*_trials(quick), *_functions(quick)]


def _device():
    """The GPU, or the processor where there is none."""
    return next((device for device in jax.devices() if device.platform == "gpu"), jax.devices("cpu")[0])


def _name() -> str:
    device = _device()
    return f"solidtouch, {device.device_kind}" if device.platform == "gpu" else "solidtouch, arrays by XLA"


def _cores() -> str:
    return f"solidtouch, {len(ALL_CORES)} cores"


def _trials(quick: bool) -> list[Row]:
    found = []
    for policy in POLICIES:
        job = make_job(paper_table(), 1000 if quick else BATCH, policy, (THRESHOLD,))
        there = "gpu" if _device().platform == "gpu" else "xla-cpu"
        ways = {
            ONE: partial(_on_one, job),
            _cores(): partial(ours, job, len(ALL_CORES)),
            _name(): partial(ours, job, device=there),
        }
        played = {method: way() for method, way in ways.items()}  # compiles
        expected = played[ONE]
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


def _on_one(job: Job) -> Decisions:
    with on_cores(1):
        return ours(job)


def _moved(size: int, numbers: jax.Array) -> None:
    """Reads and writes so many bytes of the device's memory in all."""
    for _ in range(max(1, round(size / (2 * numbers.nbytes)))):
        numbers = _negative(numbers)
    numbers.block_until_ready()


_negative = jax.jit(jnp.negative)


def _functions(quick: bool) -> list[Row]:
    """A variational fit of `laplace` and a table of `walk`, which is computed tap by tap."""
    train, test = st.simulate("paper", sessions=2, seed=SEED)
    if quick:
        train, test = (taps.select((taps.where < 2) & (taps.what < 2)) for taps in (train, test))
    functions = stories()
    model = st.fit(train, functions["walk"], method="map", steps=STEPS, unconverged=True)
    size = f"{len(test)} taps x {np.prod(model.grid.shape)} classes x {test.taps[0].size} samples"
    return [
        *_compared(
            f"variational fit of the function laplace to {len(train)} taps",
            "fit",
            lambda device: _levels(train, functions["laplace"], device),
            quick,
        ),
        *_compared(
            f"log-likelihoods of the function walk: {size}", "table", lambda device: _table(model, test, device), quick
        ),
    ]


def _compared(work: str, unit: str, compute: Callable[[str], NDArray[np.float64]], quick: bool) -> list[Row]:
    ways = {_cores(): partial(compute, "cpu"), _name(): partial(compute, _device().platform)}
    here, there = (way() for way in ways.values())  # compiles
    note = f"largest difference {np.abs(here - there).max():.0e}"
    seconds = interleaved(ways, 1 if quick else 3)
    return [Row(work, method, times, unit, note if method != _cores() else "") for method, times in seconds.items()]


def _levels(taps: st.TapSet, story: Callable[..., object], device: str) -> NDArray[np.float64]:
    """Levels of the classes by a fit."""
    return st.fit(taps, story, steps=STEPS, unconverged=True, device=device, seed=SEED).parameters["loc"]


def _table(model: st.TapModel, taps: st.TapSet, device: str) -> NDArray[np.float64]:
    with on_device(device):
        return model.log_likelihood(taps.taps)
