"""Results of `solidtouch reproduce` on simulated taps and on recordings: the tables of docs/reference/results.md.

`--document docs/reference/results.md --recorded FOLDER` updates them and the figure of the README.
"""

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import xarray as xr
from solidtouch.analysis.page.page import Row
from solidtouch.analysis.reproduce.record import AccuracyRow, ReproductionSummary
from solidtouch.models.storage import complete_file

from benchmarks.page import parsed, table, write_block
from benchmarks.study import solidtouch

_FRESH_DIGITS = {"what_error": 2, "where_error": 3, "taps": 1}
BLOCKS = PAPER, FRESH, RECORDED, CONTACTS = "paper", "fresh", "recorded", "contacts"
SHOWN = (0.1, 0.5, 0.9, 0.95, 0.995)
AFTER = (1, 2, 5, 10)
FIGURE = ("fig7", "active-versus-passive.svg")
_FOLDS = ("--split", "leave-one-session-out")
_CELLS = ("--where-cell", "3mm", "--what-cell", "3mm")


class Recording(NamedTuple):
    """A recorded set that is not part of this software.

    Attributes:
        name: In words.
        file: Its file.
        options: Of `reproduce`.
        baseline: Joint accuracy of a plain histogram classifier after one contact, given with the recording.
        later: Likewise after more contacts, in words.
        pseudocount: Counts that come nearest to what the baseline adds to its normalised bins.
    """

    name: str
    file: str
    options: tuple[str, ...]
    baseline: str
    later: str
    pseudocount: float


RECORDINGS = (
    Recording(
        "Barrett hand, balls and cylinders", "barrett_ballcyl.npz", _FOLDS, ".30 (what .81, where .33)", "", 0.24
    ),
    Recording("Barrett hand, boxes", "barrett_boxes.npz", _FOLDS, ".50 (what 1.0)", "", 0.48),
    Recording("eFlesh grid, day 1 to day 2", "eflesh_grid.npz", _CELLS, ".43", ".43 at 1, .61 at 10", 0.04),
    Recording("iCub hand, grasps", "icub_grasp.npz", (), ".92", ".92 at 1", 0.16),
    Recording("iCub fingertip, Braille", "braille_icub.npz", (), ".63", ".63, .74, .87, .89", 0.51),
)


def reproduced(out: Path, words: Sequence[Any]) -> ReproductionSummary:
    """The summary of a run into a folder."""
    solidtouch("reproduce", *words, "--out", out)
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


def told(row: Row, name: str, digits: int) -> str:
    """A value with its interval, where it has one."""
    ends = [row[name], row[f"{name}_low"], row[f"{name}_high"]]
    value, *_ = words = [f"{end:.{digits}f}" for end in ends if end is not None]
    return value if len(words) < len(ends) or len(set(words)) == 1 else f"{value} [{words[1]}, {words[2]}]"


def of_thresholds(summary: ReproductionSummary, file: Path) -> str:
    """Passive and active errors at some thresholds, and what differs at the one that is shown; `file` has the data."""
    rows = {(row["policy"], row["theta"]): row for row in summary["results"]}
    lines = [
        [
            f"{theta:g}",
            *(
                told(rows[policy, theta], name, digits)
                for name, digits in (("what_error", 2), ("where_error", 3), ("taps", 1))
                for policy in ("passive", "active")
            ),
        ]
        for theta in SHOWN
    ]
    head = [
        f"{of}, {policy}{unit}"
        for of, unit in (("object", " (mm)"), ("position", " (mm)"), ("taps", ""))
        for policy in ("passive", "active")
    ]
    theta = summary["shown_theta"]
    gain = next(row for row in summary["differences"] if row["theta"] == theta)
    share = rows["active", theta]["what_error"] / rows["passive", theta]["what_error"]
    with xr.open_dataset(file, group="active/data_sets", engine="h5netcdf") as sets:
        errors = sets["what_error"].sel(theta=theta).isel(place=summary["fixation"]["index"])
        least, most = float(errors.min()), float(errors.max())
    said = (
        f"At threshold {theta:g} the active object error is {share:.2f} times the passive one, "
        f"{told(gain, 'what_error', 2)} mm lower; the active position error is {told(gain, 'where_error', 2)} mm "
        f"lower. The active object error varies between data sets from {least:.2g} to {most:.2g} mm, because at the "
        "fixation point an object is nearly always or nearly never classified as its neighbour. At threshold "
        f"{SHOWN[-1]:g} the object is wrong in {rows['active', SHOWN[-1]]['what_wrong']:.0%} of the active decisions."
    )
    return f"{table(['threshold', *head], lines)}\n\n{said}"


def on_fresh_taps(summary: ReproductionSummary) -> str:
    """Where no tap is drawn twice in a trial: at a threshold for which the test taps suffice, and at the shown one."""
    headline = summary["headline"]
    lines = [
        [
            f"{row['theta']:g}",
            row["policy"].replace(" - ", " − "),
            *(told(row, name, digits) for name, digits in _FRESH_DIGITS.items()),
        ]
        for side in (headline["enough"], headline["fresh"])
        if side is not None
        for row in side["rows"]
    ]
    head = ["threshold", "policy", "object (mm)", "position (mm)", "taps"]
    few = headline["few"] or ""
    return f"{table(head, lines)}\n\n{few and f'At threshold {headline["theta"]:g}: {few}'}".strip()


def joint(row: AccuracyRow) -> str:
    """A joint accuracy with its interval."""
    return told(row, "joint", 2).replace("0.", ".")


def main() -> None:
    """Runs everything and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    options = parsed(parser, *BLOCKS)

    def write(block: str, text: str) -> None:
        print(text, flush=True)
        write_block(options.document, block, text)

    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        summary = reproduced(folder / "paper", ())
        write(PAPER, of_thresholds(summary, folder / "paper" / "results.nc"))
        write(FRESH, on_fresh_taps(summary))
        if options.document is not None:
            figure, picture = FIGURE
            with complete_file(options.document.parent / "images" / picture, force=True) as unfinished:
                shutil.copyfile(folder / "paper" / f"{figure}.svg", unfinished)
        first, later = [], []
        for one in RECORDINGS if options.recorded is not None else ():
            words, own = ["--data", options.recorded / one.file, *one.options], folder / one.file
            plain = reproduced(own, words)["accuracy"]
            near = reproduced(own.with_suffix(".near"), [*words, "--pseudocount", one.pseudocount])["accuracy"]
            parts = f" (what {plain[0]['what']:.2f}, where {plain[0]['where']:.2f})".replace("0.", ".")
            named = f"`{' '.join(one.options)}`" if one.options else ""
            mine = joint(plain[0]) + (parts if "what" in one.baseline else "")
            first.append([one.name, named, one.baseline, mine, f"{joint(near[0])} at {one.pseudocount:g}"])
            for rows, how in ((plain, ""), (near, f", pseudocount {one.pseudocount:g}")):
                after = {row["contacts"]: joint(row) for row in rows}
                if len(after) > 1:
                    later.append([one.name + how, *(after.get(n, "") for n in AFTER), one.later])
            print(first[-1], *later[-2:], sep="\n", flush=True)
        if first:
            head = ["recording", "options", "baseline", "ours, default", "ours, `--pseudocount`"]
            write(RECORDED, table(head, first))
            write(CONTACTS, table(["recording", *(f"after {n}" for n in AFTER), "baseline"], later))


if __name__ == "__main__":
    main()
