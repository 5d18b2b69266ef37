"""`solidtouch conformance`: cases with exact answers, for this software's engines and for programs of others."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Argument, Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import Force

if TYPE_CHECKING:
    from ..analysis.conformance.report import ConformanceReport

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

        from ..analysis.conformance.report import cases
    table = Table("case", "equations", "taps", "what it tests", box=None)
    chosen = cases(*case or ())
    for one in chosen:
        table.add_row(one.name, _equations(one.equations), str(len(one.taps)), one.about)
    console = Console()
    console.print(table)
    console.print(f"{len(chosen)} cases.", highlight=False)


@app.command("export")
def export_cases(
    folder: Annotated[Path, Argument(metavar="DIR", help="Where to write.", show_default=False)],
    case: Cases = None,
    precision: Precision = "double",
    force: Force = False,
) -> None:
    """The cases with their right answers as files: JSON, lines for a program to read, and NPZ for large ones."""
    with loading():
        from ..analysis.conformance.report import export
    from .shared.progress import bars

    with bars() as progress:
        written = export(folder, case or (), precision=precision, force=force, progress=progress)
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
        from ..analysis.conformance.report import run_engine
        from ..analysis.conformance.routes import ROUTES
    from .shared.progress import bars

    passed = True
    for name in (engine,) if engine else ROUTES:
        print(f"Engine {name}")
        with bars() as progress:
            report = run_engine(name, case or (), progress=progress)
        passed &= _printed(report, verbose)
    if not passed:
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
        from ..analysis.conformance.report import run_files, run_program
    from .shared.progress import bars

    if (command is None) == (answers is None):
        raise InputError("check needs either --command PROGRAM or --answers DIR.")
    with bars() as progress:
        if answers is not None:
            report = run_files(answers, case or (), precision=precision, without=without or (), progress=progress)
        else:
            report = run_program(
                command or "",
                case or (),
                precision=precision,
                without=without or (),
                timeout=timeout,
                together=together,
                progress=progress,
            )
    if not _printed(report, verbose):
        raise typer.Exit(1)


def _printed(report: "ConformanceReport", verbose: bool) -> bool:
    """Prints the verdicts; whether all pass."""
    print("\n".join(report.lines(verbose)))
    return report.passed


def _equations(numbers: tuple[int, ...]) -> str:
    """Numbers of equations, those in a row as a range."""
    if len(numbers) > 2 and numbers == tuple(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(map(str, numbers))
