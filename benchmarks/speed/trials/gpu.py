"""The same trials on the processor and on a GPU in one run; without a GPU no times are given."""

import jax
import numpy as np

from benchmarks.speed.rows import ALL_CORES, Row, interleaved, on_cores, per_unit
from benchmarks.speed.trials.decisions import THRESHOLD, UNIT
from benchmarks.speed.trials.job import POLICIES, make_job, ours, paper_table

BATCH = 1 << 20


def rows(quick: bool = False) -> list[Row]:
    """Trials in the largest batch; the transfer of tables, plans and decisions counts."""
    found = []
    for policy in POLICIES:
        work = f"trials to {THRESHOLD}, {policy}, in one batch on a GPU"
        cores = f"solidtouch, {len(ALL_CORES)} cores"
        device = next((device for device in jax.devices() if device.platform == "gpu"), None)
        if device is None:
            found += [Row(work, "solidtouch, GPU", [], UNIT, "JAX finds no GPU on this machine")]
            continue
        job = make_job(paper_table(), 1000 if quick else BATCH, policy, (THRESHOLD,))
        with on_cores(len(ALL_CORES)):
            ways = {
                cores: lambda job=job: ours(job, len(ALL_CORES)),
                "solidtouch, GPU": lambda job=job: ours(job, device="gpu"),
            }
            played = {method: way() for method, way in ways.items()}  # compiles
            seconds = interleaved(ways, 2 if quick else 5)
        differing = np.count_nonzero((played[cores].taps != played["solidtouch, GPU"].taps).any(axis=1))
        for method, times in seconds.items():
            note = f"{len(job.number) / np.median(times):,.0f} trials/s"
            if method != cores:
                note += f" on {device.device_kind}; {differing} of {len(job.number)} trials take other taps"
            found.append(Row(work, method, per_unit(times, played[method].taps.sum()), UNIT, note))
    return found
