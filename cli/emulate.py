"""`solidtouch emulate`: an emulated rig on pseudo-terminals, for any program that opens serial ports."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..models.errors import InputError
from .shared.interrupt import ended_by_interrupt, loading, terminable

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


def emulate(
    out: Annotated[
        Path, typer.Option(help="Folder for the ports, the control socket and rig.toml; created if needed.")
    ],
    preset: Annotated[str, typer.Option(help="Preset of the simulated finger and objects, as in simulate.")] = "paper",
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
    """Emulate a stage and a fingertip until Ctrl-C."""
    with loading():
        from ..hardware.emulator.emulated_bench import emulated_bench
        from ..hardware.emulator.faults import Switches
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
        terminable(),
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
        with Service(emulation, control, real_time) as service:
            path = out / "rig.toml"
            write_rig(path, rig, list(emulation.objects))
            print(f"Emulating {rig.name} in {out}; press Ctrl-C to stop.", flush=True)
            print(f"Try it from another terminal: solidtouch rig check {path}", flush=True)
            with ended_by_interrupt():
                service.run()


def switch_on(switches: "Switches", words: str) -> None:
    """Switches on a fault given as `NAME[:key=value,...]`; values are JSON or text.

    Raises:
        InputError: The fault or a parameter is unknown.
    """
    name, _, rest = words.partition(":")
    parameters: dict[str, Any] = {}
    for pair in filter(None, rest.split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"--fault {words}: expected key=value, got {pair!r}.")
        try:
            parameters[key.strip()] = json.loads(value)
        except json.JSONDecodeError:
            parameters[key.strip()] = value
    try:
        switches.on(name, **parameters)
    except TypeError as error:
        raise InputError(f"--fault {words}: invalid parameters.") from error
