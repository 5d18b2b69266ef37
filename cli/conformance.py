"""`solidtouch conformance`: cases with exact answers, for this software's engines and for programs of others."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Argument, Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import Force

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..analysis.conformance.run import Asked
    from ..analysis.conformance.verdict import Verdict

app = typer.Typer(
    help="Cases with exact answers, to check this algorithm in any language.",
    no_args_is_help=True,
    add_completion=False,
)
Cases = Annotated[list[str] | None, Option("--case", metavar="NAME", help="Only this case; may stand several times.")]
Precision = Annotated[
    Literal["double", "single"], Option(help="Numbers of the program: of 64 or of 32 bits, which get wider tolerances.")
]


@app.command("list")
def list_cases(
    case: Cases = None,
) -> None:
    """What each case tests."""
    with loading():
        from rich.console import Console
        from rich.table import Table

        from ..analysis.conformance.catalogue import select
    table = Table("case", "equations", "taps", "what it tests", box=None)
    cases = select(case or [])
    for one in cases:
        table.add_row(one.name, _equations(one.equations), str(len(one.taps)), one.about)
    console = Console()
    console.print(table)
    console.print(f"{len(cases)} cases.", highlight=False)


@app.command("export")
def export_cases(
    folder: Annotated[Path, Argument(metavar="DIR", help="Where to write.", show_default=False)],
    case: Cases = None,
    precision: Precision = "double",
    force: Force = False,
) -> None:
    """The cases with their right answers as files: JSON, lines for a program to read, and NPZ for large ones."""
    with loading():
        from ..analysis.conformance.catalogue import select
        from ..analysis.conformance.kit import export_kit
        from ..models.storage import check_folder
    from .shared.progress import bars

    check_folder(folder, force)
    cases = select(case or [])
    with bars() as progress:
        written = export_kit(folder, cases, precision, force, progress("Computing answers", len(cases)))
    print(f"Cases in {folder}: {written}; {folder / 'index.json'} lists them.")


@app.command("run")
def run_engines(
    engine: Annotated[
        Literal["numpy", "numpyro", "montecarlo"] | None, Option(help="Only this engine; default all.")
    ] = None,
    case: Cases = None,
    verbose: Annotated[bool, Option("--verbose", help="Print the cases that pass, too.")] = False,
) -> None:
    """This software's own engines on all cases; exit code 1 if one differs."""
    with loading():
        from ..analysis.conformance.catalogue import select
        from ..analysis.conformance.routes import ROUTES
        from ..analysis.conformance.run import Asked, run_route

    cases = select(case or [])
    fine = True
    for route in (engine,) if engine else ROUTES:
        print(f"Engine {route}")
        verdicts = _with_progress(len(cases), verbose, lambda told, route=route: run_route(route, cases, told), Asked())
        fine &= _summary(verdicts)
    if not fine:
        raise typer.Exit(1)


@app.command("check")
def check(
    command: Annotated[
        str | None, Option("--command", help="The program and its arguments, as in a shell.", show_default=False)
    ] = None,
    answers: Annotated[
        Path | None,
        Option("--answers", metavar="DIR", help="In place of a program: a folder with its answers, NAME.jsonl each."),
    ] = None,
    case: Cases = None,
    precision: Precision = "double",
    without: Annotated[
        list[str] | None,
        Option(metavar="QUANTITY", help="A quantity that the program does not answer, such as log_evidence."),
    ] = None,
    timeout: Annotated[float, Option(min=0.1, help="Seconds that the program has for a case.")] = 10.0,
    together: Annotated[bool, Option("--together", help="Start the program once, with all cases one by one.")] = False,
    verbose: Annotated[bool, Option("--verbose/--quiet", help="Print the cases that pass, too.")] = True,
) -> None:
    """A program in any language on all cases: what differs first, by how much, and the likely cause."""
    with loading():
        from ..analysis.conformance.answers import FIT, QUANTITIES
        from ..analysis.conformance.catalogue import select
        from ..analysis.conformance.program import split_command
        from ..analysis.conformance.run import Asked, check_answers, check_program
    if (command is None) == (answers is None):
        raise InputError("check needs either --command PROGRAM or --answers DIR.")
    if answers is not None and not answers.is_dir():
        raise InputError(f"--answers {answers} is no folder.")
    for name in without or []:
        if name not in set(QUANTITIES) - set(FIT):
            known = ", ".join(name for name in QUANTITIES if name not in FIT)
            raise InputError(f"--without {name}: it must be one of {known}.")
    cases = select(case or [])
    asked = Asked(precision, tuple(without or ()), timeout)

    def work(told: "Callable[[Verdict], None]") -> "list[Verdict]":
        if answers is not None:
            return check_answers(answers, cases, asked, told)
        return check_program(split_command(command or ""), cases, asked, together, told)

    if not _summary(_with_progress(len(cases), verbose, work, asked)):
        raise typer.Exit(1)


def _with_progress(
    cases: int, verbose: bool, work: "Callable[[Callable[[Verdict], None]], list[Verdict]]", asked: "Asked"
) -> "list[Verdict]":
    """The verdicts with their causes, printed when all are there, as a cause is likelier the more it explains."""
    from ..analysis.conformance.causes import with_causes
    from ..analysis.conformance.verdict import described
    from .shared.progress import bars

    with bars() as progress:
        advance = progress("Cases", cases)
        verdicts = work(lambda _: advance(1))
        wrong = sum(verdict.quantity != "" for verdict in verdicts)
        if wrong:
            verdicts = with_causes(verdicts, asked.precision, asked.without, progress("Looking for causes", wrong))
    width = max((len(verdict.case) for verdict in verdicts), default=0)
    for verdict in verdicts:
        if verbose or verdict.status != "pass":
            print(f"{verdict.case:{width}}  {described(verdict)}")
    return verdicts


def _summary(verdicts: "list[Verdict]") -> bool:
    from ..analysis.conformance.verdict import summary

    lines, fine = summary(verdicts)
    print("\n".join(lines))
    return fine


def _equations(numbers: tuple[int, ...]) -> str:
    """Numbers of equations, those in a row as a range."""
    if len(numbers) > 2 and numbers == tuple(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(map(str, numbers))
