"""Results of commands on grids with holes: every second class, half the positions of an object, or one class missing.

Runs `crosscheck`, `reproduce --quick` and `audit` on preset `paper`, seed 0, and on recordings with several positions,
after removing all taps of some classes. No command may fail, and no trial may end without a class.

`--document docs/reference/results.md --recorded FOLDER` updates the table of that page.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from solidtouch.models.grid import ClassGrid
from solidtouch.models.io.load import load_taps
from solidtouch.models.taps import TapSet

from benchmarks.page import parsed, table, write_block
from benchmarks.studies.results.reproduce import told
from benchmarks.study import RECORDED, solidtouch

BLOCK = "holes"
HEAD = (
    "data",
    "without",
    "classes left",
    "routes agree",
    "object error, passive",
    "object error, active",
    "no class left",
    "beliefs are",
)
type Indices = NDArray[np.intp]
HOLES: dict[str, Callable[[Indices, Indices, ClassGrid], NDArray[np.bool_]]] = {
    "every second class": lambda where, what, _: (where + what) % 2 == 1,
    "half the positions of an object": lambda where, what, _: (what == 0) & (where % 2 == 1),
    "one class": lambda where, what, grid: (what == grid.M - 1) & (where == grid.L // 2),
}


def cut(taps: TapSet, grid: ClassGrid, holes: str) -> tuple[TapSet, int]:
    """The taps without those of some classes, and how many classes are left."""
    where, what = taps.indices(grid)
    kept = ~HOLES[holes](where, what, grid) & (where >= 0) & (what >= 0)
    return taps.select(kept), len(np.unique(where[kept] * grid.M + what[kept]))


def sets(folder: Path, recorded: Path | None) -> Iterator[tuple[str, list[TapSet], tuple[Any, ...]]]:
    """Name, files and options of each set with several positions and objects."""
    solidtouch("simulate", "--preset", "paper", "--sessions", 3, "--out", folder / "paper")
    yield "preset paper", [load_taps(folder / "paper" / f"session-{i}.nc") for i in range(3)], ()
    for name, cells in RECORDED.items():
        if recorded is None or not (recorded / name).exists():
            continue
        options = [pair for pair in zip(("--where-cell", "--what-cell"), cells, strict=True) if pair[1]]
        taps = load_taps(recorded / name)
        if taps.grid(*cells).L > 1:
            yield Path(name).stem, [taps], tuple(word for pair in options for word in pair)


def line(folder: Path, name: str, files: list[TapSet], options: tuple[Any, ...], holes: str) -> list[str]:
    """A row of the table."""
    cells = dict(zip(options[::2], options[1::2], strict=True))
    grid = files[0].grid(cells.get("--where-cell"), cells.get("--what-cell"))
    paths = []
    for i, taps in enumerate(files):
        fewer, left = cut(taps, grid, holes)
        fewer.save(folder / f"{i}.nc", force=True)
        paths.append(folder / f"{i}.nc")
    out = folder / "out"
    solidtouch("crosscheck", *paths[:2], *options)
    solidtouch("reproduce", "--data", *paths[:2], "--quick", *options, "--out", out / "reproduce", "--force")
    solidtouch("audit", *paths, *options, "--out", out / "audit", "--force")
    summary = json.loads((out / "reproduce" / "summary.json").read_text(encoding="utf-8"))
    verdict = json.loads((out / "audit" / "audit.json").read_text(encoding="utf-8"))["verdict"]["state"]
    shown = {row["policy"]: row for row in summary["headline"]["fresh"]["rows"]}
    return [
        name,
        holes,
        f"{left} of {grid.L * grid.M}",
        "yes" if summary["crosscheck"]["passed"] else "no",
        *(told(shown[policy], "what_error", 2) if policy in shown else "–" for policy in ("passive", "active")),
        f"{max(row['no_class_left_fraction'] for row in summary['results']):.1%}",
        verdict,
    ]


def main() -> None:
    """Runs the commands and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    options = parsed(parser, BLOCK)
    lines = []
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name, files, words in sets(folder, options.recorded):
            for holes in HOLES:
                lines.append(line(folder, name, files, words, holes))
                print(*lines[-1], sep=" | ", flush=True)
    write_block(options.document, BLOCK, table(HEAD, lines))


if __name__ == "__main__":
    main()
