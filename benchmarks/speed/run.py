"""Runs all benchmarks next to their baselines, peers and limits; `make bench`.

Prints tables and writes them, the times of every round and a figure into a folder. Within a round all methods of a work
run one after another and ratios are taken; only these ratios are comparable between machines. Everything runs on one
core unless its row says otherwise.
"""

import argparse
import json
import os
import shutil
import sys
from importlib import import_module
from pathlib import Path

WORKS = {
    **{name: f"trials.{name}" for name in ("decisions", "peers", "whole")},
    **{name: name for name in ("likelihood", "likelihood_peers", "information", "startup")},
}
"""Modules by the names of their works."""
ALONE = {"gpu": "gpu"}
"""Likewise those that `--only` measures alone, on all cores, as they need another machine."""
PARTS = ("machine", "works", "exponents", "memory")
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main() -> None:
    """Runs the benchmarks as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="tiny sizes, to test that everything runs")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks"), help="output folder")
    parser.add_argument("--document", type=Path, help="page to update")
    parser.add_argument("--only", choices=WORKS | ALONE, help="run one work and update its block of the page")
    options = parser.parse_args()
    if options.only in ALONE:
        run_one(options.only, options.quick, options.document)
        return
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read when NumPy and its libraries are loaded, below
    from benchmarks.speed.rows import on_cores  # noqa: PLC0415

    with on_cores(1):
        if options.only is not None:
            run_one(options.only, options.quick, options.document)
        else:
            run(options.quick, options.out, options.document)


def run_one(work: str, quick: bool, document: Path | None) -> None:
    """Measures one work, prints it with the machine, and writes it into a page."""
    from benchmarks.page import check_block, write_block  # noqa: PLC0415
    from benchmarks.speed.report import all_works, machine_list  # noqa: PLC0415
    from benchmarks.speed.rows import machine  # noqa: PLC0415

    check_block(document, work)
    where = "\n".join(machine_list(machine()).splitlines()[:2])  # processor and vector instructions
    text = f"{where}\n\n{all_works(_say(work, _module(work).rows)(quick))}"
    print(text)
    write_block(document, work, text)


def run(quick: bool, out: Path, document: Path | None) -> None:
    """Measures, prints and writes."""
    from benchmarks.page import check_block, write_block  # noqa: PLC0415
    from benchmarks.speed.figures import draw  # noqa: PLC0415
    from benchmarks.speed.memory import peaks  # noqa: PLC0415
    from benchmarks.speed.report import all_works, exponents, machine_list, memory_table  # noqa: PLC0415
    from benchmarks.speed.rows import machine  # noqa: PLC0415
    from benchmarks.speed.scaling import curves  # noqa: PLC0415

    check_block(document, *PARTS)
    rows = [row for work in WORKS for row in _say(work, _module(work).rows)(quick)]
    grown = _say("scaling", curves)(quick)
    memory = _say("memory", peaks)(quick)
    texts = machine_list(machine()), all_works(rows), exponents(grown), memory_table(memory)
    parts = dict(zip(PARTS, texts, strict=True))
    out.mkdir(parents=True, exist_ok=True)
    measured = {
        "quick": quick,
        "machine": machine()._asdict(),
        "rows": [row._asdict() for row in rows],
        "curves": [curve._asdict() for curve in grown],
        "memory": memory,
    }
    (out / "benchmarks.json").write_text(json.dumps(measured, indent=1), encoding="utf-8")
    page = "\n\n".join(["# Benchmarks", *texts])
    (out / "benchmarks.md").write_text(page + "\n", encoding="utf-8")
    picture = draw(grown, out)
    if document is not None:
        for name, text in parts.items():
            write_block(document, name, text)
        images = document.parent / "images"
        images.mkdir(exist_ok=True)
        shutil.copyfile(picture, images / picture.name)
    print(page)


def _module(work):
    return import_module(f"benchmarks.speed.{(WORKS | ALONE)[work]}")


def _say(name, measure):
    print(f"Measuring {name} ...", file=sys.stderr)
    return measure


if __name__ == "__main__":
    main()
