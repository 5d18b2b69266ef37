"""`solidtouch conformance`: cases with exact answers, for the engines of this package and other programs."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Argument, Option

from ..models.errors import InputError, counted
from .shared.interrupt import loading
from .shared.options import Force

if TYPE_CHECKING:
    from ..analysis.conformance.report import ConformanceReport

app = typer.Typer(
    help="Check implementations in any language against cases with exact answers.",
    no_args_is_help=True,
    add_completion=False,
)
Cases = Annotated[list[str] | None, Option("--case", metavar="NAME", help="Only this case; repeatable.")]
Levels = Annotated[
    list[str] | None,
    Option(
        "--level",
        metavar="LEVEL",
        help="Cases of this level, with those of --case: core, episodes, borders, limits, continuous or strategies; "
        "repeatable. Default: all; in check, the first four.",
    ),
]
KitFolder = Annotated[
    Path | None,
    Option(
        "--kit",
        metavar="DIR",
        help="Exported kit whose cases and answers count; default: the kit of this version.",
        show_default=False,
    ),
]
Precision = Annotated[
    Literal["double", "single"], Option(help="Floating-point precision of the program; single gets wider tolerances.")
]


@app.command("list")
def list_cases(
    case: Cases = None,
    level: Levels = None,
    kit: KitFolder = None,
) -> None:
    """List the cases, their levels and what each tests."""
    with loading():
        from rich.console import Console
        from rich.table import Table

        from ..analysis.conformance.case import LEVELS
        from ..analysis.conformance.front import open_kit
    table = Table("case", "level", "equations", "taps", "what it tests", box=None)
    of = open_kit(kit)
    chosen = [one for one in of.select(case or (), level or ()) if not one.absent]
    for one in chosen:
        table.add_row(one.name, one.level, _equations(one.equations), str(len(one.taps)), one.about)
    console = Console()
    console.print(table)
    sizes = Counter(one.level for one in chosen)
    for name, about in LEVELS.items():
        if sizes[name]:
            console.print(f"{name}: {counted(sizes[name], 'case')}; {about}.", highlight=False)
    for sentence in (*of.sentences, f"{counted(len(chosen), 'case')} of kit {of.version}."):
        console.print(sentence, highlight=False)


@app.command("export")
def export_cases(
    folder: Annotated[Path, Argument(metavar="DIR", help="Folder to write.", show_default=False)],
    case: Cases = None,
    level: Levels = None,
    precision: Precision = "double",
    force: Force = False,
) -> None:
    """Write the cases with exact answers: JSON, input lines for a program, and NPZ for large cases."""
    with loading():
        from ..analysis.conformance.front import export
    from .shared.progress import bars

    with bars() as progress:
        written = export(folder, case or (), levels=level or (), precision=precision, force=force, progress=progress)
    print(f"Cases in {folder}: {written}; {folder / 'index.json'} lists them.")


@app.command("run")
def run_engines(
    engine: Annotated[
        Literal["numpy", "numpyro", "montecarlo"] | None, Option(help="Only this engine; default: all.")
    ] = None,
    case: Cases = None,
    level: Levels = None,
    kit: KitFolder = None,
    verbose: Annotated[bool, Option("--verbose", help="Also print the cases that pass.")] = False,
) -> None:
    """Check the engines of this package; exit code 1 if one differs."""
    with loading():
        from ..analysis.conformance.engines import ROUTES
        from ..analysis.conformance.front import run_engine
    from .shared.progress import bars

    passed = True
    for name in (engine,) if engine else ROUTES:
        with bars() as progress:
            report = run_engine(name, case or (), levels=level or (), kit=kit, progress=progress)
        print(f"Engine {name}")
        passed &= _printed(report, verbose)
    if not passed:
        raise typer.Exit(1)


@app.command("check")
def check(
    command: Annotated[
        str | None,
        Option(
            "--command",
            help="Program with arguments, quoted as in a shell; `sh -c` does pipes and variables.",
            show_default=False,
        ),
    ] = None,
    answers: Annotated[
        Path | None,
        Option(
            "--answers",
            metavar="DIR",
            help="Folder with answers of the program, NAME.jsonl for each case, instead of --command.",
        ),
    ] = None,
    case: Cases = None,
    level: Levels = None,
    kit: KitFolder = None,
    precision: Precision = "double",
    without: Annotated[
        list[str] | None,
        Option(
            metavar="QUANTITY", help="Quantity that the program does not compute, such as log_evidence; repeatable."
        ),
    ] = None,
    causes: Annotated[
        bool, Option("--causes/--no-causes", help="Look for likely causes, which takes longer the more cases differ.")
    ] = True,
    timeout: Annotated[
        float | None, Option(min=0.1, help="Time limit per case in seconds; default: 10.", show_default=False)
    ] = None,
    together: Annotated[bool, Option("--together", help="Start the program once for all cases.")] = False,
    report_as: Annotated[
        Literal["json", "junit"] | None,
        Option("--report", help="Write the verdicts as JSON or as JUnit XML, on standard output in place of the text."),
    ] = None,
    report_file: Annotated[
        Path | None,
        Option(
            "--report-file",
            metavar="FILE",
            help="File for --report, which is replaced; the text then stays on standard output.",
        ),
    ] = None,
    verbose: Annotated[bool, Option("--verbose/--quiet", help="Also print the cases that pass.")] = True,
) -> None:
    """Check a program in any language; report the first difference, its size and likely cause."""
    with loading():
        from ..analysis.conformance.front import run_files, run_program
        from ..models.storage import check_writable, complete_file
    from .shared.progress import bars

    if (command is None) == (answers is None):
        raise InputError("Give either --command PROGRAM or --answers DIR.")
    for option, does, given in (("together", "starts", together), ("timeout", "stops", timeout is not None)):
        if given and answers is not None:
            raise InputError(f"--{option} {does} a program and does not go with --answers.")
    if report_file is not None:
        if report_as is None:
            raise InputError("--report-file needs --report json or --report junit.")
        check_writable(report_file, force=True)
    how: dict[str, Any] = {
        "levels": level or (),
        "kit": kit,
        "precision": precision,
        "without": without or (),
        "causes": causes,
    }
    with bars() as progress:
        if answers is not None:
            report = run_files(answers, case or (), **how, progress=progress)
        else:
            seconds = 10.0 if timeout is None else timeout
            report = run_program(
                command or "", case or (), **how, timeout=seconds, together=together, progress=progress
            )
    if report_as is None or report_file is not None:
        _printed(report, verbose)
    if report_as is not None:
        text = report.as_json() if report_as == "json" else report.as_junit()
        if report_file is None:
            print(text, end="")
        else:
            with complete_file(report_file, force=True) as temporary:
                temporary.write_text(text, encoding="utf-8")
    if not report.passed:
        raise typer.Exit(1)


@app.command("posteriors")
def posteriors(
    folder: Annotated[
        Path | None,
        Argument(
            metavar="[DIR]", help="Folder to write all of them into; default: only list them.", show_default=False
        ),
    ] = None,
    force: Force = False,
) -> None:
    """List the reference posteriors of the measurement models, or write their data, moments and draws into a folder."""
    with loading():
        from ..analysis.posteriors.catalogue import NAMES, export, posterior
    if folder is not None:
        print(f"Files in {folder}: {export(folder, force)}; SHA256SUMS lists them.")
        return
    for name in NAMES:
        known = posterior(name)
        print(f"{name}: {len(known.numbers)} numbers, {'exact' if known.method == 'exact' else 'by chains of NUTS'}")
        print(*(f"  {line}" for line in known.model), sep="\n")


@app.command("draws")
def draws(
    name: Annotated[str, Argument(metavar="NAME", help="Of the reference posterior.", show_default=False)],
    files: Annotated[
        list[Path],
        Argument(
            metavar="FILE...",
            help="CSV of each chain, as Stan writes it, JSON or netCDF of all, as of ArviZ.",
            show_default=False,
        ),
    ],
) -> None:
    """Compare draws of a program with a reference posterior; exit code 1 if they differ or have not mixed."""
    with loading():
        from ..analysis.posteriors.catalogue import posterior
        from ..analysis.posteriors.comparison import compare_draws
        from ..analysis.posteriors.files import read_draws
    verdict = compare_draws(posterior(name), read_draws(files))
    print(*verdict.sentences, sep="\n")
    if verdict.status != "pass":
        raise typer.Exit(1)


def _printed(report: "ConformanceReport", verbose: bool) -> bool:
    """Whether all cases pass; prints the verdicts."""
    print("\n".join(report.lines(verbose)))
    return report.passed


def _equations(numbers: tuple[int, ...]) -> str:
    """Equation numbers as text; consecutive ones as a range."""
    if len(numbers) > 2 and numbers == tuple(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(map(str, numbers))
