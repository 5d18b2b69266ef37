"""The kit as files, for machines without Python: cases with exact answers and the input of a program."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....models.storage import complete_folder
from ..answers import Answer
from ..case import FORMAT, Case, to_line
from ..catalogue import expected
from ..tolerance import Precision, allowed_decisions, allowed_moves, needs_double, tolerances

_CONVENTIONS = {"format": FORMAT, "index_base": 0, "numbers": "IEEE 754 binary64", "logarithms": "natural"}
_LARGE = 200_000  # bytes of a case above which it comes as NPZ too


def export_kit(
    folder: str | Path,
    cases: Sequence[Case],
    precision: Precision = "double",
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> int:
    """Writes cases into a folder, all or none.

    Args:
        folder: Where to.
        cases: Which ones.
        precision: For which the tolerances are.
        force: Whether files may be replaced.
        progress: Called with the number of further cases written.

    Returns:
        How many cases were written; those that the precision cannot do are not.

    Raises:
        InputError: The folder cannot be written.
    """
    entries = []
    with complete_folder(folder, force) as temporary:
        for case in cases:
            if not (precision == "single" and needs_double(case, expected(case))):
                entries.append(_export(temporary, case, precision))
            progress(1)
        index = {**_CONVENTIONS, "precision": precision, "cases": entries}
        _write(temporary / "index.json", json.dumps(index, indent=1))
    return len(entries)


def _export(folder: Path, case: Case, precision: Precision) -> dict[str, Any]:
    whole = as_object(case, precision)
    text = to_line(whole)
    _write(folder / f"{case.name}.json", text)
    with (folder / f"{case.name}.jsonl").open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in case.lines())
    files = [f"{case.name}.json", f"{case.name}.jsonl"]
    if len(text) > _LARGE:
        np.savez_compressed(folder / f"{case.name}.npz", **_arrays(case), **_settings(case, precision))
        files.append(f"{case.name}.npz")
    about = {"case": case.name, "about": case.about, "equations": list(case.equations), "taps": len(case.taps)}
    return about | {"files": files}


def as_object(case: Case, precision: Precision) -> dict[str, Any]:
    """A case with its right answers, as JSON has it."""
    right = expected(case)
    allowed = tolerances(case, right, precision)
    return {
        **case.header(),
        **_CONVENTIONS,
        "about": case.about,
        "equations": list(case.equations),
        "precision": precision,
        "taps": list(case.tap_lines()),
        "tolerances": {name: tolerance._asdict() for name, tolerance in allowed.items()},
        "expected": [_expected_line(case, answer, precision) for answer in right],
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
    given = {name: getattr(case, name) for name in ("edges", "counts", "probabilities", "prior", "taps", "moves")}
    arrays = {name: value for name, value in given.items() if value is not None}
    answers = [answer for answer in expected(case) if "posterior" in answer.values]
    arrays["expected_tap"] = np.array([answer.tap for answer in answers])
    for name in answers[0].values:
        arrays[f"expected_{name}"] = np.array([answer.values[name] for answer in answers])
    return arrays


def _settings(case: Case, precision: Precision) -> dict[str, Any]:
    """What a case holds as single numbers and words, and how near an answer must come."""
    header = case.header()
    names = ("case", "where_value", "where_unit", "pseudocount", "power", "border", "thresholds", "theta_x", "fixation")
    allowed = tolerances(case, expected(case), precision)
    given = {**_CONVENTIONS, **{name: header[name] for name in names if name in header}, "precision": precision}
    near = {f"tolerance_{name}": tuple(tolerance) for name, tolerance in allowed.items()}
    return {name: np.array(value) for name, value in (given | near).items()}


def _write(path: Path, text: str) -> None:
    path.write_text(text + "\n", encoding="utf-8")
