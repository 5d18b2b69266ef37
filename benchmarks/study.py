"""Helpers of the studies: progress, processes, commands of this program, recorded data sets, JSON output."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.storage import complete_file
from solidtouch.models.taps import TapSet

OUT = Path("runs/studies")
RECORDED = {
    "barrett_ballcyl.npz": (None, None),
    "barrett_boxes.npz": (None, None),
    "eflesh_grid.npz": ("3mm", "3mm"),
    "icub_grasp.npz": (None, None),
    "braille_icub.npz": (None, None),
}
"""Recorded sets that are not part of this software: files, and the widths of their where and what cells."""


def until_interrupted[T](name: str, tasks: Sequence[Callable[[], T]]) -> Iterator[T]:
    """What each task returns, with a progress bar; Ctrl-C ends it after those that are finished."""
    try:
        for task in track(tasks, name, console=Console(file=sys.stderr)):
            yield task()
    except KeyboardInterrupt:
        print("Interrupted; the results cover the finished part only.", file=sys.stderr)


def processes() -> ProcessPoolExecutor:
    """A process for each core, kept to it: what they run would otherwise start as many threads each."""
    free = list(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    queue = get_context("spawn").Queue()
    for core in free:
        queue.put(core)
    return ProcessPoolExecutor(len(free) or None, get_context("spawn"), _keep_to_core, (queue,) if free else ())


def _keep_to_core(queue: Any = None) -> None:
    if queue is not None:
        os.sched_setaffinity(0, {queue.get()})


def solidtouch(*words: Any) -> None:
    """Runs a command in silence, and ends with it where it fails."""
    command = [sys.executable, "-m", "solidtouch.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - this program itself


def write_json(name: str, measured: Any, folder: Path = OUT) -> None:
    """Writes what was measured into a folder, as `name.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    with complete_file(folder / f"{name}.json", force=True) as temporary:
        temporary.write_text(json.dumps(measured, indent=1), encoding="utf-8")


def thinned(taps: TapSet, step: int) -> TapSet:
    """Taps with every `step`th sample only."""
    data = taps.dataset.isel(sample=slice(None, None, step))
    old = taps.preprocessing
    rate = None if old.rate_hz is None else old.rate_hz / step
    new = Preprocessing(data.sizes["sample"], rate, highpass_hz=old.highpass_hz, trigger=old.trigger)
    return TapSet(data.assign_attrs(preprocessing=new.to_json()))
