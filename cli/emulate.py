"""`solidtouch emulate`: an emulated rig on pseudo-terminals, for any program that opens serial ports."""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..models.errors import InputError
from .shared.completion import presets
from .shared.interrupt import ended_by_interrupt, loading

if TYPE_CHECKING:
    from ..hardware.emulator.faults import Switches


def _list_faults(faults: list[str] | None) -> list[str] | None:
    if "list" not in (faults or ()):
        return faults
    from rich.console import Console
    from rich.table import Table

    from ..hardware.emulator.faults import FAULTS

    table = Table("fault", "row", "where", "effect", box=None)
    for name, known in FAULTS.items():
        table.add_row(name, str(known.number), known.where, known.meaning)
    Console().print(table)
    raise typer.Exit


app = typer.Typer(help="Emulate the devices of a rig.", invoke_without_command=True)
Bench = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the running emulator.", show_default=False)]


@app.callback()
def emulate(
    context: typer.Context,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the ports, the control socket and rig.toml; created if needed.")
    ] = None,
    preset: Annotated[
        str, typer.Option(help="Preset of the simulated finger and objects, as in simulate.", autocompletion=presets)
    ] = "paper",
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the sensor and all noise.")] = 0,
    session: Annotated[
        int, typer.Option(min=0, help="Session number, which sets gains and mounting as in simulate.")
    ] = 0,
    sensor: Annotated[
        Literal["icub", "lines"],
        typer.Option(help="Type of sensor: iCub fingertip behind a CAN adapter, or one line of text per reading."),
    ] = "icub",
    homed: Annotated[bool, typer.Option("--homed", help="Start with the stage homed.")] = False,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Run in real time, for programs that do not use the shared clock.")
    ] = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="Fault to switch on at the start, as NAME[:key=value,...]; `--fault list` lists all; repeatable.",
            callback=_list_faults,
            is_eager=True,
        ),
    ] = None,
) -> None:
    """Emulate a stage and a fingertip until Ctrl-C, and print their taps, moves and faults."""
    if context.invoked_subcommand is not None:
        return
    if out is None:
        raise InputError("emulate requires --out, a folder for the ports and rig.toml.")
    with loading():
        from ..hardware.emulator.emulated_bench import emulated_bench
        from ..hardware.emulator.faults import Switches
        from ..hardware.emulator.narrator import Narrator
        from ..hardware.emulator.rig_file import write_rig
        from ..hardware.emulator.service import Service, check_free
        from ..hardware.simulator.settings import preset as settings_of

    settings = settings_of(preset)
    control = (out / "control").absolute()
    check_free(control)  # before existing ports are replaced
    switches = Switches(seed)
    for words in fault or ():
        switch_on(switches, words)
    with (
        emulated_bench(
            out,
            settings,
            seed=seed,
            session=session,
            kind=sensor,
            name=f"emulated {preset}",
            shared_clock=not real_time,
            homed=homed,
            switches=switches,
        ) as (rig, emulation, _),
    ):
        emulation.control({})  # a port that is busy is so from the start
        narrator = Narrator(emulation, rig.tap, partial(print, flush=True))
        with Service(emulation, control, real_time, narrator.look) as service:
            path = out / "rig.toml"
            write_rig(path, rig, list(emulation.objects))
            print(f"Emulating preset {preset} in {out}; press Ctrl-C to stop.", flush=True)
            print(f"Try it from another terminal: solidtouch rig check {path}", flush=True)
            with ended_by_interrupt():
                service.run()


@app.command()
def fault(
    bench: Bench,
    faults: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME[:key=value,...]", help="Faults to switch on.", show_default=False),
    ] = None,
    off: Annotated[bool, typer.Option("--off", help="Switch these off instead, or all if none is named.")] = False,
) -> None:
    """Switch faults of a running emulator on or off; `solidtouch emulate --fault list` lists all."""
    if not faults and not off:
        raise InputError("Name a fault, or use --off for all.")
    orders: list[dict[str, Any]] = []
    for words in faults or ():
        name, parameters = fault_of(words)
        orders.append({"off": name} if off else {"on": name, **parameters})
    _order(bench, orders or [{"off": None}])


@app.command(name="object")
def change_object(
    bench: Bench,
    name: Annotated[
        str | None, typer.Argument(metavar="OBJECT", help="Its name; default: none.", show_default=False)
    ] = None,
) -> None:
    """Put an object under the finger of a running emulator, or none."""
    _order(bench, [{"object": name}])


def _order(bench: Path, orders: list[dict[str, Any]]) -> None:
    """Sends orders to a running emulator and prints what is on."""
    with loading():
        from ..hardware.emulator.shared_clock import SocketConnection

    state: dict[str, Any] = {}
    control = (bench / "control").absolute()
    if not control.exists():
        missing = "no such folder" if not bench.is_dir() else "not the folder of an emulator"
        raise InputError(f"{bench}: {missing}; name that of a running `solidtouch emulate --out`.")
    with SocketConnection(control) as connection:
        for order in orders:
            state = connection.control(order)
    print(f"object: {state['object_name'] or 'none'}; faults: {', '.join(state['faults']) or 'none'}")


def switch_on(switches: "Switches", words: str) -> None:
    """Switches on a fault given as `NAME[:key=value,...]`.

    Raises:
        InputError: The fault or a parameter is unknown.
    """
    name, parameters = fault_of(words)
    try:
        switches.on(name, **parameters)
    except TypeError as error:
        raise InputError(f"--fault {words}: invalid parameters.") from error


def fault_of(words: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters of a fault given as `NAME[:key=value,...]`; values are JSON or text.

    Raises:
        InputError: A parameter has no value.
    """
    name, _, rest = words.partition(":")
    parameters: dict[str, Any] = {}
    for pair in filter(None, rest.split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"--fault {words}: expected key=value, got {pair!r}.")
        try:
            parameters[key.strip()] = json.loads(value)
        except (ValueError, RecursionError):
            parameters[key.strip()] = value
    return name, parameters
