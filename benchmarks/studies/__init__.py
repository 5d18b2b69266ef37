"""What the studies of models share: tables in Markdown, intervals, progress, and their places in a page."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console
from rich.progress import track
from scipy.stats import binomtest, t
from solidtouch.analysis.page.figure_style import save
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
        print("Interrupted; what follows is of the finished part.", file=sys.stderr)


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


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *lines))


def mean_interval(values: ArrayLike, digits: int = 2) -> str:
    """A mean with its 95 % t-interval, `-` for less than two values."""
    values = np.asarray(values, dtype=np.float64)
    if len(values) < 2:
        return "-"
    half = t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    low, high = values.mean() - half, values.mean() + half
    return f"{values.mean():.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def share_interval(hits: int, n: int) -> str:
    """A proportion with its 95 % Wilson interval."""
    interval = binomtest(hits, n).proportion_ci(method="wilson")
    return f"{hits / n:.3f} [{interval.low:.3f}, {interval.high:.3f}]"


def check_block(document: Path | None, name: str) -> None:
    """Makes sure that a page has a place for a block, before hours are spent on what stands there.

    Raises:
        ValueError: It has not.
    """
    if document is not None and not _place(name).search(document.read_text(encoding="utf-8")):
        raise ValueError(f"{document} has no lines <!-- begin {name} --> and <!-- end {name} -->.")


def write_block(document: Path, name: str, text: str) -> None:
    """Replaces what stands between the lines `<!-- begin NAME -->` and `<!-- end NAME -->` of a page."""
    page = document.read_text(encoding="utf-8")
    page = _place(name).sub(lambda found: f"{found[1]}{text}\n{found[2]}", page)
    with complete_file(document, force=True) as temporary:
        temporary.write_text(page, encoding="utf-8")


def publish(figure: Any, document: Path, name: str) -> None:
    """Writes a figure beside what was measured, and as `images/NAME.svg` beside the page."""
    OUT.mkdir(parents=True, exist_ok=True)
    _, picture = save(figure, OUT, name)
    images = document.parent / "images"
    images.mkdir(exist_ok=True)
    with complete_file(images / picture.name, force=True) as temporary:
        shutil.copyfile(picture, temporary)


def _place(name: str) -> re.Pattern[str]:
    return re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)


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
