"""The kit as files, for machines without Python: cases with exact answers, the input of a program, and descriptions.

The same bytes come out each time, on any machine: no clock, no compression, line ends of one byte.
"""

import json
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from ....models.storage import complete_folder
from ..answers import Answer
from ..case import FORMAT, LEVELS, Case, to_line
from ..catalogue import Kit, expected
from ..tolerance import Precision, allowed_decisions, allowed_moves, needs_double, tolerances
from .checksums import write_sums
from .descriptions import CRATE, CROISSANT, KitFile, croissant, ro_crate
from .version import LICENSE, RELEASED, provenance

_CONVENTIONS = {"format": FORMAT, "index_base": 0, "numbers": "IEEE 754 binary64", "logarithms": "natural"}
_LARGE = 200_000  # bytes of a case above which it comes as NPZ too
STATIC = {
    "README.md": "What the files are",
    "RULES.md": "What a program reads and writes, and the rules of its answers",
    "CHANGELOG.md": "What each version of the kit changed",
    "LICENSE": "CC0 1.0 Universal",
    "case.schema.json": "JSON Schema of NAME.json",
    "index.schema.json": "JSON Schema of index.json",
    "header.schema.json": "JSON Schema of the first line that a program reads",
    "tap.schema.json": "JSON Schema of the other lines that a program reads",
    "answer.schema.json": "JSON Schema of a line that a program writes",
    "report.schema.json": "JSON Schema of the report of a check",
}
"""Files of the package that an export holds as they are."""


def export_kit(
    folder: str | Path,
    kit: Kit,
    cases: Sequence[Case],
    precision: Precision = "double",
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> int:
    """Writes cases into a folder, all or none.

    Args:
        folder: Where to.
        kit: Which one.
        cases: Which of its cases.
        precision: For which the tolerances are.
        force: Whether files may be replaced.
        progress: Called with the number of further cases written.

    Returns:
        How many cases were written; those that the precision cannot do are not.

    Raises:
        InputError: The folder cannot be written.
    """
    entries, left_out = [], []
    with complete_folder(folder, force) as temporary:
        for case in cases:
            if reason := _obstacle(case, precision):
                left_out.append({**_about(case), "reason": reason})
            else:
                entries.append(_export(temporary, case, precision))
            progress(1)
        _write(temporary / "index.json", json.dumps(_index(kit, precision, entries, left_out), indent=1))
        for name in STATIC:
            (temporary / name).write_bytes(files(__package__).joinpath(name).read_bytes())
        _write(temporary / ".gitattributes", "* -text")
        _describe(temporary, entries)
        write_sums(temporary)
    return len(entries)


def _obstacle(case: Case, precision: Precision) -> str:
    return needs_double(case, expected(case)) if precision == "single" else ""


def _about(case: Case) -> dict[str, Any]:
    return {"case": case.name, "level": case.level, "about": case.about, "equations": list(case.equations)}


def _index(
    kit: Kit, precision: Precision, entries: list[dict[str, Any]], left_out: list[dict[str, Any]]
) -> dict[str, Any]:
    return {
        **_CONVENTIONS,
        "kit": kit.version,
        "released": RELEASED,
        "license": LICENSE,
        "precision": precision,
        "levels": {level: kit.sizes[level] for level in LEVELS},
        "provenance": provenance(),
        "cases": entries,
        "left_out": left_out,
    }


def _describe(folder: Path, entries: list[dict[str, Any]]) -> None:
    """Writes the descriptions of all files."""
    held = {"index.json": "Version of the kit, levels, and the cases with their files", **STATIC}
    kinds = {".json": "{} With its exact answers", ".jsonl": "{} Lines that a program reads", ".npz": "{} Arrays"}
    for entry in entries:
        held |= {name: kinds[Path(name).suffix].format(entry["about"]) for name in entry["files"]}
    described = [KitFile(folder / name, about) for name, about in held.items()]
    _write(folder / CROISSANT, json.dumps(croissant(described), indent=1))
    described.append(KitFile(folder / CROISSANT, "Description by Croissant 1.0"))
    _write(folder / CRATE, json.dumps(ro_crate(described), indent=1))


def _export(folder: Path, case: Case, precision: Precision) -> dict[str, Any]:
    whole = as_object(case, precision)
    text = to_line(whole)
    _write(folder / f"{case.name}.json", text)
    _write(folder / f"{case.name}.jsonl", "\n".join(case.lines()))
    names = [f"{case.name}.json", f"{case.name}.jsonl"]
    if len(text) > _LARGE:
        np.savez(folder / f"{case.name}.npz", **_arrays(case), **_settings(case, precision))
        names.append(f"{case.name}.npz")
    return _about(case) | {"taps": len(case.taps), "files": names}


def as_object(case: Case, precision: Precision) -> dict[str, Any]:
    """A case with its right answers, as JSON has it."""
    right = expected(case)
    allowed = tolerances(case, right, precision)
    return {
        **case.header(),
        **_CONVENTIONS,
        "level": case.level,
        "about": case.about,
        "equations": list(case.equations),
        "precision": precision,
        "strict_ties": case.strict_ties,
        "taps": list(case.tap_lines()),
        "tolerances": {name: tolerance._asdict() for name, tolerance in allowed.items()},
        "expected": [_expected_line(case, answer, precision) for answer in right],
        "provenance": provenance(),
    }


def _expected_line(case: Case, answer: Answer, precision: Precision) -> dict[str, Any]:
    line = answer.line(case.name)
    if "decisions" not in answer.values:
        return line
    allowed = tolerances(case, expected(case), precision)
    decisions = [sorted(choices) for choices in allowed_decisions(case, answer, allowed["what"])]
    moves = sorted(allowed_moves(case, answer, allowed["where"]))
    if any(len(choices) > 1 for choices in decisions):
        line["allowed_decisions"] = [[None if m < 0 else m for m in choices] for choices in decisions]
    if len(moves) > 1:
        line["allowed_moves"] = moves
    return line


def _arrays(case: Case) -> dict[str, Any]:
    """What a case holds as arrays; answers by the taps that have one."""
    names = ("edges", "counts", "probabilities", "mean", "sd", "pool", "prior", "taps", "moves")
    given = {name: getattr(case, name) for name in names}
    arrays = {name: value for name, value in given.items() if value is not None}
    answers = [answer for answer in expected(case) if "posterior" in answer.values]
    arrays["expected_tap"] = np.array([answer.tap for answer in answers])
    for name in answers[0].values:
        arrays[f"expected_{name}"] = np.array([answer.values[name] for answer in answers])
    return arrays


def _settings(case: Case, precision: Precision) -> dict[str, Any]:
    """What a case holds as single numbers and words, and how near an answer must come."""
    header = case.header()
    names = [
        "case",
        "where_value",
        "where_unit",
        "pseudocount",
        "power",
        "border",
        "thresholds",
        "theta_x",
        "fixation",
        "strategy",
    ]
    allowed = tolerances(case, expected(case), precision)
    given = {**_CONVENTIONS, **{name: header[name] for name in names if name in header}, "precision": precision}
    near = {f"tolerance_{name}": tuple(tolerance) for name, tolerance in allowed.items()}
    origin = {f"provenance_{name}": value for name, value in provenance().items()}
    return {name: np.array(value) for name, value in (given | near | origin).items()}


def _write(path: Path, text: str) -> None:
    path.write_text(text + "\n", encoding="utf-8", newline="\n")
