"""The conformance kit for Python: the functions of `solidtouch.conformance`."""

import shlex
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from numbers import Real
from pathlib import Path
from typing import Any

from ...models.errors import InputError
from ...models.progress import Progress, no_progress
from ...models.storage import check_folder
from ..page.stages import counted
from .answers import FIT, OPTIONAL, QUANTITIES
from .case import BASIC, LEVELS, Case
from .catalogue import Kit, listed, own_kit
from .catalogue import expected as exact_answers
from .causes import with_causes
from .dataset.export import export_kit
from .dataset.pinned import read_kit
from .engines import ROUTES
from .program import split_command
from .report import ConformanceReport
from .run import Asked, Implementation, check_answers, check_function, check_program, run_route
from .tolerance import Precision
from .verdict import Verdict


def cases(*names: str, levels: Sequence[str] = (), kit: str | Path | None = None) -> list[Case]:
    """The cases of these names and levels, or all, of this version or of an exported kit; they are copies.

    >>> import solidtouch as st
    >>> st.conformance.cases("root-j")
    [<Case root-j: 4 taps. The likelihood is the J-th root of the product, as printed.>]

    Raises:
        InputError: There is no such case.
    """
    return deepcopy([case for case in open_kit(kit).select(names, levels) if not case.absent])


def expected(name: str, kit: str | Path | None = None) -> list[dict[str, Any]]:
    """The exact answers to a case, as an implementation gives them; large cases have them for some taps only.

    >>> import solidtouch as st
    >>> [answer["move"] for answer in st.conformance.expected("root-j")]
    [1, 1, 1, 1]

    Raises:
        InputError: There is no such case.
    """
    (case,) = open_kit(kit).select([name])
    if case.absent:
        raise InputError(f"case {name}: kit {kit} leaves it out, as 32 bits cannot do it.")
    answers = (({} if answer.error is None else {"error": answer.error}, answer) for answer in exact_answers(case))
    return [{"tap": answer.tap, **error, **deepcopy(dict(answer.values))} for error, answer in answers]


def run(
    implementation: Implementation,
    names: Sequence[str] = (),
    *,
    levels: Sequence[str] = (),
    kit: str | Path | None = None,
    precision: Precision = "double",
    without: Sequence[str] = (),
    causes: bool = True,
    progress: Progress = no_progress,
) -> ConformanceReport:
    """Checks an implementation in Python against the exact answers.

    It is called with a `Case` and returns, or yields, a mapping for each tap, in their order: `log_likelihood`,
    `log_evidence`, `posterior`, `where`, `what`, `decisions` (`None` or -1 for none) and `move`, as
    docs/reference/conformance/README.md defines them. A case with `training` has one more before the first tap:
    `edges` and `counts`. At a tap that is impossible under every class it raises `ZeroEvidenceError`, or gives
    `{"error": "zero_evidence"}`.

    >>> import solidtouch as st
    >>> def wrong(case):
    ...     for answer in st.conformance.expected(case.name):
    ...         yield answer | {"move": -answer["move"]}
    >>> report = st.conformance.run(wrong, ["root-j"])
    >>> report.passed
    False
    >>> report.found["root-j"].about
    'the move has the wrong sign'

    Args:
        implementation: The function.
        names: Cases; default all.
        levels: Levels whose cases are checked, with those of `names`; default `core`, `episodes`, `borders`, `limits`.
        kit: Folder of an exported kit, whose cases and answers count; default the kit of this version.
        precision: Precision of its numbers; `"single"` has wider tolerances.
        without: Quantities that it does not answer, such as `"log_evidence"`.
        causes: Whether to look for likely causes, which takes longer the more cases differ.
        progress: Called with the name and size of every stage; returns the function that advances it.

    Raises:
        InputError: There is no such case, level or quantity, or the implementation is no function.
    """
    if not callable(implementation):
        raise InputError(f"implementation must be a function of a case, got {implementation!r}.")
    title = f"Conformance of {getattr(implementation, '__name__', type(implementation).__name__)}"
    asked = _asked(precision, without, causes)
    return _report(
        title, (kit, names, levels), asked, progress, lambda chosen: check_function(implementation, chosen, asked)
    )


def run_program(
    command: str | Path | Sequence[str | Path],
    names: Sequence[str] = (),
    *,
    levels: Sequence[str] = (),
    kit: str | Path | None = None,
    precision: Precision = "double",
    without: Sequence[str] = (),
    causes: bool = True,
    timeout: float = 10.0,
    together: bool = False,
    progress: Progress = no_progress,
) -> ConformanceReport:
    """Checks a program in any language, which reads cases on standard input and writes answers.

    >>> import solidtouch as st
    >>> st.conformance.run_program("true", ["root-j"]).found["root-j"]
    <Verdict root-j: DIFFERS tap 1: there is no answer>

    Args:
        command: The program and its arguments, quoted as in a shell, which does not run it, or one by one.
        names: As in `run`.
        levels: As in `run`.
        kit: As in `run`.
        precision: As in `run`.
        without: As in `run`.
        causes: As in `run`.
        timeout: Seconds that it has for a case.
        together: Whether to start it once, with all cases one by one.
        progress: As in `run`.

    Raises:
        InputError: There is no such program, case, level or quantity.
    """
    asked = _asked(precision, without, causes, timeout)
    words = split_command(command)
    title = f"Conformance of {shlex.join(words)}"
    return _report(
        title, (kit, names, levels), asked, progress, lambda chosen: check_program(words, chosen, asked, together)
    )


def run_files(
    folder: str | Path,
    names: Sequence[str] = (),
    *,
    levels: Sequence[str] = (),
    kit: str | Path | None = None,
    precision: Precision = "double",
    without: Sequence[str] = (),
    causes: bool = True,
    progress: Progress = no_progress,
) -> ConformanceReport:
    r"""Checks the answers of a program in files, `NAME.jsonl` for each case.

    >>> import json
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import solidtouch as st
    >>> with TemporaryDirectory() as folder:
    ...     _ = st.conformance.export(Path(folder, "kit"), ["root-j"])
    ...     answers = json.loads(Path(folder, "kit", "root-j.json").read_text())["expected"]
    ...     _ = Path(folder, "root-j.jsonl").write_text("\n".join(map(json.dumps, answers)))
    ...     st.conformance.run_files(folder, ["root-j"]).passed
    True

    Args:
        folder: Where they are.
        names: As in `run`.
        levels: As in `run`.
        kit: As in `run`.
        precision: As in `run`.
        without: As in `run`.
        causes: As in `run`.
        progress: As in `run`.

    Raises:
        InputError: There is no such folder, case, level or quantity.
    """
    if not Path(folder).is_dir():
        raise InputError(f"answers {folder}: not a folder.")
    asked = _asked(precision, without, causes)
    title = f"Conformance of answers in {folder}"
    return _report(
        title, (kit, names, levels), asked, progress, lambda chosen: check_answers(Path(folder), chosen, asked)
    )


def run_engine(
    engine: str,
    names: Sequence[str] = (),
    *,
    levels: Sequence[str] = (),
    kit: str | Path | None = None,
    progress: Progress = no_progress,
) -> ConformanceReport:
    """Checks an engine of this software.

    >>> import solidtouch as st
    >>> st.conformance.run_engine("numpy", ["root-j", "ties"]).passed
    True

    Args:
        engine: `"numpy"`, `"numpyro"` or `"montecarlo"`.
        names: As in `run`.
        levels: As in `run`.
        kit: As in `run`.
        progress: As in `run`.

    Raises:
        InputError: There is no such engine, case or level.
    """
    if engine not in ROUTES:
        raise InputError(f"engine {engine}: it must be one of {', '.join(ROUTES)}.")
    title = f"Conformance of engine {engine}"
    wanted = kit, names, levels or (() if names else tuple(LEVELS))
    return _report(title, wanted, Asked(), progress, lambda chosen: run_route(engine, chosen))


def export(
    folder: str | Path,
    names: Sequence[str] = (),
    *,
    levels: Sequence[str] = (),
    precision: Precision = "double",
    force: bool = False,
    progress: Progress = no_progress,
) -> int:
    """Writes cases and their exact answers as files, all or none.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import solidtouch as st
    >>> with TemporaryDirectory() as folder:
    ...     _ = st.conformance.export(Path(folder, "kit"), ["root-j"])
    ...     sorted(path.name for path in Path(folder, "kit").glob("root*"))
    ['root-j.json', 'root-j.jsonl']

    Args:
        folder: Where to.
        names: As in `run`.
        levels: As in `run`.
        precision: As in `run`.
        force: Whether files in an existing folder may be replaced.
        progress: As in `run`.

    Returns:
        The number of cases; those impossible in this precision are left out.

    Raises:
        InputError: There is no such case or level, or the folder cannot be written.
    """
    _check_precision(precision)
    kit = own_kit()
    chosen = kit.select(names, levels)
    check_folder(folder, force)
    return export_kit(folder, kit, chosen, precision, force, progress("Computing answers", len(chosen)))


def open_kit(folder: str | Path | None, precision: Precision | None = None) -> Kit:
    """The kit of this version, or one in a folder.

    Raises:
        InputError: The folder is damaged, incomplete, of a newer format or for another precision.
    """
    if folder is None:
        return own_kit()
    kit = read_kit(folder)
    if precision is not None and kit.precision != precision:
        raise InputError(f"kit {folder}: its tolerances are for precision {kit.precision}, not {precision}.")
    return kit


def _asked(precision: Precision, without: Sequence[str], causes: bool, timeout: float = 10.0) -> Asked:
    """What is asked of an implementation.

    Raises:
        InputError: There is no such precision or quantity, nothing is left to compare, or the timeout is not positive.
    """
    _check_precision(precision)
    if not (isinstance(timeout, Real) and timeout > 0):
        raise InputError(f"timeout must be a positive number, got {timeout!r}.")
    known = [name for name in QUANTITIES if name not in FIT]
    without = listed("without", without)
    for name in without:
        if name not in known:
            raise InputError(f"without must be one of {', '.join(known)}, got {name!r}.")
    if {*known} <= {*without, *OPTIONAL, "information"}:  # the last is of level strategies alone
        raise InputError("without names everything that a program must answer; at least one quantity must be compared.")
    return Asked(precision, without, timeout, causes)


def _check_precision(precision: str) -> None:
    if precision not in ("double", "single"):
        raise InputError(f"precision {precision}: it must be one of double, single.")


def _report(
    title: str,
    wanted: tuple[str | Path | None, Sequence[str], Sequence[str]],
    asked: Asked,
    progress: Progress,
    work: Callable[[list[Case]], Iterator[Verdict]],
) -> ConformanceReport:
    """The verdicts, with their causes if wanted, which are likelier the more cases they explain."""
    folder, *lists = wanted
    names, levels = map(listed, ("names", "levels"), lists)
    kit = open_kit(folder, asked.precision)
    asked_levels = levels or (() if names else BASIC)
    chosen = kit.select(names, asked_levels)
    if not chosen:
        held = (
            ", ".join(dict.fromkeys([*(case.level for case in kit.cases.values()), *map(repr, kit.unknown)])) or "none"
        )
        raise InputError(f"kit {folder}: no case of level {', '.join(asked_levels)}; its levels are {held}.")
    found = work(chosen)  # a program that is not there is refused before a bar begins
    verdicts = list(counted(found, progress("Cases", len(chosen))))
    wrong = sum(verdict.quantity != "" for verdict in verdicts)
    if wrong and asked.causes:
        verdicts = with_causes(
            verdicts, kit.cases, asked.precision, asked.without, progress("Looking for causes", wrong)
        )
    return ConformanceReport(
        title, {verdict.case: verdict for verdict in verdicts}, kit, asked.precision, asked.without
    )
