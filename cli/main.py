"""The command `solidtouch`."""

import errno
import os
import sys
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Annotated, Any, NoReturn

from .shared.interrupt import INTERRUPTED, MESSAGE, TERMINATED, loading, repeated, terminable
from .shared.process import collect_seldom, keep_programs, leave, switch_often, without

with loading():
    import typer

    from ..models.errors import InputError, printable
    from .audit import audit
    from .collect import collect
    from .compare import compare
    from .conformance import app as conformance
    from .convert import convert
    from .crosscheck import crosscheck
    from .emulate import app as emulate
    from .export_model import export_model
    from .fit import fit
    from .inspect import inspect
    from .perceive import perceive
    from .redraw import redraw
    from .reproduce import reproduce
    from .rig import app as rig
    from .sensitivity import sensitivity
    from .shared.usage import PlainGroup
    from .simulate import simulate
    from .strategies import strategies
    from .sweep import sweep
    from .trials import trials
    from .tune import tune
    from .validate import validate
    from .view import view

_NO_PATH = (errno.EACCES, errno.ELOOP, errno.ENAMETOOLONG)  # of a path that cannot even be looked at
_FINGER = "Finger "  # begins a note of `hardware.rig.open_rig`
app = typer.Typer(
    name="solidtouch",
    help="Active Bayesian perception for robot touch: exact posteriors over position and object.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    cls=PlainGroup,
)
_COMMANDS = (
    reproduce,
    simulate,
    collect,
    convert,
    inspect,
    fit,
    crosscheck,
    perceive,
    view,
    redraw,
    trials,
    compare,
    audit,
    sweep,
    sensitivity,
    strategies,
    tune,
    validate,
)
for command in _COMMANDS:
    app.command()(command)
app.command(name="export-model")(export_model)
app.add_typer(emulate, name="emulate")
app.add_typer(rig, name="rig")
app.add_typer(conformance, name="conformance")


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version as installed_version

        print(f"solidtouch {installed_version('solidtouch')}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Active Bayesian perception for robot touch: exact posteriors over position and object."""


@cache
def _command() -> Any:
    """All commands; Typer would read their options anew at each call."""
    return typer.main.get_command(app)


def program() -> None:
    """`run` as a process of its own."""
    keep_programs()
    collect_seldom()
    switch_often()
    code: Any = 0
    try:
        run()
    except SystemExit as stop:
        code = stop.code
    if code is None or isinstance(code, int):
        leave(code or 0)
    sys.exit(code)


def run() -> None:
    """Runs a command; reports an error as one sentence on standard error and an exit code.

    1: engines or routes disagree; 2: error in a file or argument; 3: error of a device of the rig;
    130: Ctrl-C; 143: SIGTERM.
    """
    with loading():
        from ..hardware.errors import RigError

    try:
        with _without_dask(), repeated(), terminable():
            _command()(prog_name="solidtouch")
    except RigError as error:
        _refuse(error, 3)
    except InputError as error:
        _refuse(error, 2)
    except MemoryError as error:
        _refuse(f"not enough memory ({error}).", 2)
    except OSError as error:
        if error.errno == errno.ENOSPC and error.filename is None:
            os.dup2(
                os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
            )  # what is left of the output cannot fail again
            _refuse(f"the output cannot be written: {error.strerror}.", 2)
        if error.errno not in _NO_PATH or error.filename is None:
            raise
        _refuse(f"{error.filename}: {error.strerror}.", 2)
    except Exception as error:
        from ..inference.engines.shadow import EnginesDisagree
        from ..inference.reference import ZeroEvidenceError

        if isinstance(error, EnginesDisagree):
            _refuse(error, 1)
        if isinstance(error, ZeroEvidenceError):
            _refuse(error, 2)
        raise
    except KeyboardInterrupt as stop:  # outside a command; Typer turns those inside into exit codes
        print(MESSAGE, file=sys.stderr)
        _print_place(stop)
        sys.exit(INTERRUPTED)
    except SystemExit as stop:
        if stop.code in (INTERRUPTED, TERMINATED):
            print(MESSAGE, file=sys.stderr)
            _print_place(stop)
        raise


def _refuse(reason: object, code: int) -> NoReturn:
    print(f"solidtouch: {'\n'.join(map(printable, str(reason).split('\n')))}", file=sys.stderr)
    if isinstance(reason, BaseException):
        _print_place(reason)
    sys.exit(code)


def _print_place(error: BaseException | None) -> None:
    """Prints where the finger is, if a note on an error says so, or on what it arose from."""
    while error is not None:
        for note in getattr(error, "__notes__", ()):
            if note.startswith(_FINGER):
                print(note, file=sys.stderr)
                return
        error = error.__cause__ or error.__context__


def _without_dask() -> AbstractContextManager[None]:
    """Hides dask inside the block, unless a sweep or a cluster needs it or xarray or dask is already imported.

    xarray imports dask if it is installed, even for plain arrays, which takes as long as a short command. It does so
    on its own import, so dask must not be hidden after that.
    """
    needed = any(word == "sweep" or word.startswith("--scheduler") for word in sys.argv)
    return nullcontext() if needed else without("dask", "xarray")
