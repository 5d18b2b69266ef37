"""Results of `solidtouch compare` for all measurement models on simulated taps and on two recordings.

`--document docs/explanation/comparison.md --recorded FOLDER` updates its tables and figures.
"""

import argparse
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from solidtouch.analysis.compare.page import best_models
from solidtouch.analysis.page.page import Row
from solidtouch.models.storage import complete_file

from benchmarks.page import parsed, table, write_block
from benchmarks.study import solidtouch

SIMULATED, SKIN, BRAILLE = BLOCKS = "simulated", "skin", "braille"
FIGURES = {"sessions": "comparison-taps.svg", "decisions": "comparison-decisions.svg"}
"""Figures of the simulated taps, and what they are called in the page."""


def comparisons(folder: Path, recorded: Path | None) -> Iterator[tuple[str, list[Any]]]:
    """Block and arguments of each comparison; simulates what it needs into a folder."""
    solidtouch("simulate", "--out", folder / "data")
    yield SIMULATED, [folder / "data" / f"session-{i}.nc" for i in range(2)]
    if recorded is not None:
        yield SKIN, [recorded / "eflesh_grid.npz", "--where-cell", "3mm", "--what-cell", "3mm", "--draws", 100]
        yield BRAILLE, [recorded / "braille_icub.npz"]


def told(summary: Row) -> str:
    """Ranks with what is ranked, the best models beside the second and the reference, and the sentences about them."""
    head = ["model", *(f"{one['title']} ({one['unit'] or 'P(wrong)'})" for one in summary["levels"])]
    lines = [
        [row["name"], *("–" if at is None else f"{at['rank']} ({number(at['value'])})" for at in row["levels"])]
        for row in summary["ranks"]
    ]
    best = best_models(summary)
    said = filter(None, [summary["headline"], summary["overconfident"], *summary["warnings"]])
    tables = table(head, lines), table(best.head, best.rows)
    return "\n\n".join([*tables, "\n".join(f"- {one}" for one in said)])


def number(value: float) -> str:
    """Three digits, and whole numbers from a hundred on."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def main() -> None:
    """Compares and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    parser.add_argument("--only", choices=BLOCKS, help="update one block only")
    options = parsed(parser, *BLOCKS)
    with TemporaryDirectory() as temporary:
        for block, words in comparisons(Path(temporary), options.recorded):
            if options.only not in (None, block):
                continue
            out = Path(temporary) / block
            solidtouch("compare", *words, "--models", "all", "--out", out)
            text = told(json.loads((out / "summary.json").read_text(encoding="utf-8")))
            print(block, text, sep="\n\n", flush=True)
            if options.document is None:
                continue
            write_block(options.document, block, text)
            for figure, picture in FIGURES.items() if block == SIMULATED else ():
                with complete_file(options.document.parent / "images" / picture, force=True) as unfinished:
                    shutil.copyfile(out / f"{figure}.svg", unfinished)


if __name__ == "__main__":
    main()
