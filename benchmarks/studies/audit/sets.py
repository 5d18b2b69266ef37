"""Audits of simulated rigs, of taps drawn from a model, and of recordings.

The rigs are three sessions of a preset, seed 0. `model` is taps drawn from histograms fitted to the first two sessions
of preset `paper`: 400 per class for training, and 40 each for tuning and testing.

`--document docs/how-to/audit.md --recorded FOLDER` updates its table and figures.
"""

import argparse
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from solidtouch.analysis.page.page import Row
from solidtouch.models.storage import complete_file

from benchmarks.page import parsed, table, write_block
from benchmarks.study import RECORDED, solidtouch

PRESETS = ("ideal", "paper", "broken")
BLOCK = "sets"
SHOWN, FIGURES = "preset paper", ("causes", "remedies")


def sets(folder: Path, recorded: Path | None) -> Iterator[tuple[str, list[Any]]]:
    """Name and arguments of each audit; simulates what it needs into a folder."""
    for name in PRESETS:
        solidtouch("simulate", "--preset", name, "--sessions", 3, "--out", folder / name)
    model, train, rest = folder / "model.nc", folder / "train", folder / "rest"
    solidtouch("fit", *(folder / "paper" / f"session-{i}.nc" for i in range(2)), "--out", model)
    drawn = ("simulate", "--preset", "model", "--model", model, "--samples", 4)
    solidtouch(*drawn, "--taps-per-class", 400, "--sessions", 1, "--seed", 1, "--out", train)
    solidtouch(*drawn, "--taps-per-class", 40, "--sessions", 2, "--seed", 2, "--out", rest)
    yield "preset model", [train / "session-0.nc", rest / "session-0.nc", rest / "session-1.nc"]
    for name in PRESETS:
        yield f"preset {name}", [folder / name / f"session-{i}.nc" for i in range(3)]
    for name, cells in RECORDED.items():
        if recorded is not None and (recorded / name).exists():
            options = zip(("--where-cell", "--what-cell"), cells, strict=True)
            yield Path(name).stem, [recorded / name, *(word for pair in options if pair[1] for word in pair)]


def line(name: str, found: Row) -> list[str]:
    """A row of the table."""
    judged = found["verdict"]["evidence"]["judged"]
    value, low, high = (number(one) for one in judged["factor"])
    ends = "" if None in judged["factor"] else f" [{low}, {high}]"
    median, least, most = (number(judged["beside"][one]) for one in ("median", "low", "high"))
    return [
        name,
        "infinite" if judged["unbounded"] else f"{value}{ends}",
        f"{median} ({least} to {most})",
        found["verdict"]["state"],
        found["first_cause"]["words"] or "nothing",
        found["remedy"]["chosen"] or "nothing",
    ]


def number(value: float | None) -> str:
    """Two digits, and a dash for what is not known."""
    return "–" if value is None else f"{value:.2g}"


def main() -> None:
    """Audits and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    parser.add_argument("--out", type=Path, help="keep the audits in this folder")
    options = parsed(parser, BLOCK)
    rows, said = [], []
    with TemporaryDirectory() as temporary:
        out = options.out or Path(temporary) / "audits"
        for name, words in sets(Path(temporary), options.recorded):
            kept = out / name.replace(" ", "-")
            solidtouch("audit", *words, "--out", kept)
            found = json.loads((kept / "audit.json").read_text(encoding="utf-8"))
            rows.append(line(name, found))
            said.append(f"- **{name}.** {' '.join(found['verdict']['sentences'])}")
            print(*rows[-1], said[-1], sep=" | ", flush=True)
        if options.document is not None:
            for figure in FIGURES:
                picture = options.document.parent / "images" / f"audit-{figure}.svg"
                with complete_file(picture, force=True) as temporary_file:
                    shutil.copyfile(out / SHOWN.replace(" ", "-") / f"{figure}.svg", temporary_file)
    head = ["data", "factor", "a correct model gives", "beliefs are", "main cause", "recommended"]
    text = f"{table(head, rows)}\n\nThe verdicts in full:\n\n" + "\n".join(said)
    write_block(options.document, BLOCK, text)


if __name__ == "__main__":
    main()
